"""Emulated modems on TCP ports, and beside them the gateway's DirectIP for a shore."""

import asyncio
import random
from typing import Final

from zacoustic.link.alarm import Alarm
from zacoustic.link.serving import ScaledClock, cannot_listen, place_name
from zacoustic_iridium.directip import (
    HEAD_BYTES,
    Confirmed,
    ForModem,
    FromModem,
    decode,
    encode,
    whole_bytes,
)
from zacoustic_iridium.emulator.gateway import EmulatedGateway
from zacoustic_iridium.emulator.isu import EmulatedIsu, IsuFaults

FIRST_IMEI: Final = 300234010000001
_AGAIN_S: Final = 1.0


class SbdServer:
    """Modems, each on a port, and the gateway.

    Args:
        modems: How many.
        shore: Where the gateway delivers by DirectIP; None: modems write to each other.
        session_s: Shortest and longest session, s.
        faults: What goes wrong.
        seed: Of all draws.
        time_scale: How many times faster than real.
    """

    def __init__(
        self,
        modems: int = 2,
        *,
        shore: tuple[str, int] | None = None,
        session_s: tuple[float, float] = (6.0, 30.0),
        faults: IsuFaults | None = None,
        seed: int = 1,
        time_scale: float = 1.0,
    ) -> None:
        self._clock = ScaledClock(time_scale)
        self._shore = shore
        self.gateway = EmulatedGateway(None if shore is None else self._deliver)
        self._ports = [
            _Port(
                EmulatedIsu(
                    str(FIRST_IMEI + index),
                    self.gateway,
                    random.Random(f"{seed}/{index}"),
                    session_s=session_s,
                    faults=faults or IsuFaults(),
                ),
                self._clock,
            )
            for index in range(modems)
        ]
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def isus(self) -> list[EmulatedIsu]:
        """The modems."""
        return [each.isu for each in self._ports]

    @property
    def places(self) -> list[str]:
        """HOST:PORT of each modem, once open."""
        return [each.place for each in self._ports]

    @property
    def directip(self) -> str:
        """HOST:PORT for messages to the modems, once open."""
        assert self._server is not None
        return place_name(*self._server.sockets[0].getsockname()[:2])

    async def open(self, host: str = "127.0.0.1", first_port: int = 0) -> None:
        """Listen: each modem on a port, the gateway on the next one.

        Raises:
            LinkOpenError: A port is in use.
        """
        ports = [first_port + index if first_port else 0 for index in range(len(self._ports) + 1)]
        try:
            for port, number in zip(self._ports, ports, strict=False):
                await port.open(host, number)
            self._server = await asyncio.start_server(self._accept, host, ports[-1])
        except OSError as error:
            await self.close()
            raise cannot_listen(host, first_port, error, rival="another emulator") from error

    async def close(self) -> None:
        """Release all ports."""
        for task in self._tasks:
            task.cancel()
        if self._tasks:
            await asyncio.wait(self._tasks)
        for port in self._ports:
            await port.close()
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()
            self._server = None

    # Below the methods above

    def _deliver(self, message: FromModem) -> None:
        task = asyncio.get_running_loop().create_task(self._deliver_until_taken(message))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _deliver_until_taken(self, message: FromModem) -> None:
        assert self._shore is not None
        while True:
            try:
                _, writer = await asyncio.open_connection(*self._shore)
            except OSError:
                await asyncio.sleep(_AGAIN_S)
                continue
            writer.write(encode(message))
            writer.close()
            return

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            head = await reader.readexactly(HEAD_BYTES)
            size_bytes = whole_bytes(head)
            if size_bytes is not None:
                message = decode(head + await reader.readexactly(size_bytes - HEAD_BYTES))
                if isinstance(message, ForModem):
                    status = self.gateway.queue(message.imei, message.data)
                    writer.write(encode(Confirmed(message.client_id, status)))
        except EOFError:
            pass
        finally:
            writer.close()


class _Port:
    """One modem's port; the last host that has connected is served."""

    def __init__(self, isu: EmulatedIsu, clock: ScaledClock) -> None:
        self.isu = isu
        isu.rang = self.serve
        self.place = ""
        self._clock = clock
        self._alarm = Alarm(clock.now, self._expire, time_scale=clock.time_scale)
        self._writer: asyncio.StreamWriter | None = None
        self._server: asyncio.Server | None = None

    async def open(self, host: str, port: int) -> None:
        self._server = await asyncio.start_server(self._accept, host, port)
        self.place = place_name(*self._server.sockets[0].getsockname()[:2])

    async def close(self) -> None:
        self._alarm.stop()
        if self._writer is not None:
            self._writer.close()
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()

    def serve(self) -> None:
        """Hand over what the modem says, and set the timer."""
        while (data := self.isu.poll_write()) is not None:
            if self._writer is not None and not self._writer.is_closing():
                self._writer.write(data)
        self._alarm.set(self.isu.poll_timeout())

    def _expire(self, at: int) -> None:
        self.isu.timeout(max(at, self._clock.now()))
        self.serve()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._writer is not None:
            self._writer.close()
        self._writer = writer
        try:
            while data := await reader.read(4096):
                self.isu.receive(data, self._clock.now())
                self.serve()
        except ConnectionError:
            pass
        finally:
            writer.close()
