"""The shell of both bridges: an engine, a `Node`, a MAVLink port, a timer.

All inputs wait in one queue and are handled in the task that runs `Bridge.run`, one at a time. So
an engine is never entered twice, and a fault ends the bridge in place of being lost in a callback.
A bridge that cannot keep up drops MAVLink packets, as UDP does.
"""

import asyncio
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, Protocol

import msgspec

from zacoustic.config import Config, read_config
from zacoustic.config.json5 import read_zenoh_config
from zacoustic.core.base.clock import Clock
from zacoustic.core.base.linktypes import LinkState
from zacoustic.core.engine.events import LinkStateChanged
from zacoustic.errors import ZacousticError
from zacoustic.mavlink.dialect import PacketCodec, Received
from zacoustic.mavlink.outputs import Call, Notice, Output, Publish, Reply, Send
from zacoustic.mavlink.port import BAUDRATE, Port
from zacoustic.zenoh.node import Node

PACKETS_LIMIT: Final = 1000
"""Most inputs that wait."""

Tell = Callable[[Notice], None]
"""Takes each notice, on the loop."""


class Engine(Protocol):
    """What both engines have in common."""

    def is_of_other_end(self, received: Received) -> bool:
        """Return whether only the other end of the MAVLink port would send a message."""
        ...

    def handle_message(self, received: Received, now: int) -> None:
        """Take a MAVLink message."""
        ...

    def handle_timeout(self, now: int) -> None:
        """Do what is due."""
        ...

    def poll(self) -> Output | None:
        """Return what to do next."""
        ...

    def poll_timeout(self) -> int | None:
        """Return the instant of the next `handle_timeout`."""
        ...


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """What a bridge needs beside its engine."""

    config: Config
    """The file of the fleet."""
    connect: Sequence[str] | None = None
    """Zenoh endpoints, in place of the file's."""
    place: str
    """Where MAVLink is; see `port`."""
    baudrate: int = BAUDRATE
    """Of a serial port, baud."""
    address: int
    """Acoustic address of the node whose gateway is here."""


class Bridge:
    """Runs an engine; `_begin` and `_do` connect it to the node.

    Args:
        engine: The engine.
        settings: What it is connected to.
        tell: Takes notices.
        clock: Source of instants, ns.
    """

    def __init__(
        self, engine: Engine, settings: Settings, tell: Tell, clock: Clock = time.monotonic_ns
    ) -> None:
        self._engine = engine
        self._settings = settings
        self._tell = tell
        self._clock = clock
        self._packets = PacketCodec()
        self._inputs: deque[Callable[[int], None]] = deque()
        self._is_awake = asyncio.Event()
        self._refused: set[str] = set()
        self._port = Port(
            settings.place,
            receive=self._receive,
            accept=lambda data: any(
                map(engine.is_of_other_end, self._packets.feed(data, is_whole=True))
            ),
            tell=lambda event, text, is_trouble: tell(Notice(event, text, is_trouble)),
            baudrate=settings.baudrate,
            clock=clock,
        )

    async def run(self) -> None:
        """Run until cancelled.

        Raises:
            SessionError: No Zenoh router can be reached.
            LinkOpenError: The port is in use.
        """
        settings = self._settings
        node = Node(
            "mavlink", config=settings.config, connect=settings.connect, address=settings.address
        )
        try:
            await self._port.open()
            async with node, asyncio.TaskGroup() as tasks:
                self._begin(node, tasks)
                tasks.create_task(self._watch(node))
                self._tell(Notice("started", f"node {node.address}, MAVLink {self._port.name}"))
                await self._work()
        except ExceptionGroup as several:  # of the tasks, or what has ended them all
            raise several.exceptions[0] from several
        finally:
            await self._port.close()

    def put(self, take: Callable[[int], None]) -> None:
        """Queue an input; on the loop.

        Args:
            take: Gives it to the engine, with the instant.
        """
        self._inputs.append(take)
        self._is_awake.set()

    # For the two bridges

    def _begin(self, node: Node, tasks: asyncio.TaskGroup) -> None:
        """Create the endpoints."""
        raise NotImplementedError

    def _do(self, output: Publish | Call | Reply) -> None:
        """Do what the engine asks for at the node."""
        raise NotImplementedError

    # Below

    async def _work(self) -> None:
        while True:
            self._is_awake.clear()
            while self._inputs:
                self._inputs.popleft()(self._clock())
                self._carry_out()
            self._carry_out()
            due = self._engine.poll_timeout()
            delay_s = None if due is None else max(0.0, (due - self._clock()) / 1e9)
            try:
                async with asyncio.timeout(delay_s):
                    await self._is_awake.wait()
            except TimeoutError:
                self._engine.handle_timeout(self._clock())

    def _carry_out(self) -> None:
        while (output := self._engine.poll()) is not None:
            match output:
                case Send():
                    self._send(output)
                case Notice():
                    self._tell(output)
                case _:
                    self._try(output)

    def _send(self, output: Send) -> None:
        try:
            packet = self._packets.pack(
                output.message, system=output.system, component=output.component
            )
        except ValueError as error:  # a value that no such message can have
            self._complain(output.message.name, str(error))
            return
        self._port.write(packet)

    def _try(self, output: Publish | Call | Reply) -> None:
        try:
            self._do(output)
        except ZacousticError as error:
            name = output.topic if isinstance(output, Publish) else type(output).__name__
            self._complain(name, str(error))

    def _complain(self, name: str, why: str) -> None:
        """Say once for each name why something cannot be sent."""
        if name not in self._refused:
            self._refused.add(name)
            self._tell(Notice("refused", f"{name}: {why}", is_trouble=True))

    def _receive(self, data: bytes, _: int) -> None:
        if len(self._inputs) < PACKETS_LIMIT:
            self.put(lambda now: self._read(data, now))

    def _read(self, data: bytes, now: int) -> None:
        for received in self._packets.feed(data, is_whole=self._port.has_datagrams):
            self._engine.handle_message(received, now)

    async def _watch(self, node: Node) -> None:
        """Say when the router of the gateway has gone, and when it is back."""
        was_lost = False
        async for event in node.events():
            if not isinstance(event, LinkStateChanged):
                continue
            is_lost = event.state is not LinkState.UP
            if is_lost and not was_lost:
                self._tell(Notice("zenoh_lost", "the Zenoh router has gone", is_trouble=True))
            elif was_lost and not is_lost:
                self._tell(Notice("zenoh", "the Zenoh router is back"))
            was_lost = is_lost


def read_fleet(path: str | Path) -> Config:
    """Read a fleet's file, whichever node it is for: the streams say who is where.

    Raises:
        ConfigError: The file is wrong.
    """
    _, section = read_zenoh_config(path)
    address: Any = None
    if isinstance(section, dict) and section.get("address") is None:
        nodes = section.get("nodes")
        first: Any = nodes[0] if isinstance(nodes, list) and nodes else None
        address = first.get("address") if isinstance(first, dict) else 1
    return read_config(path, address=address)
