"""Engines behind the stand-in for DESERT, in virtual time: what its socket would give and take."""

import random
from collections.abc import Callable
from typing import Any, TypeVar

from zacoustic.channel.agenda import Agenda
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event
from zacoustic.core.linktypes import LinkState, ReceivedFrame
from zacoustic.core.streams.table import StreamTable
from zacoustic_desert.channel import SampleChannel
from zacoustic_desert.config import DesertConfig
from zacoustic_desert.pacing import Pacer
from zacoustic_desert.standin import Observation, StandIn, StandInConfig

T = TypeVar("T")


class VirtualDesert:
    """A DESERT with one engine at each of its nodes.

    Args:
        table: Of all nodes; their addresses begin at 1.
        nodes: How many.
        seed: Everything follows from it.
        loss: Share of the packets that is lost.
        configured: What the links are told.
        script: What DESERT's script sets; without it what its sample does.
    """

    def __init__(
        self,
        table: StreamTable,
        *,
        nodes: int = 2,
        seed: int = 1,
        loss: float = 0.0,
        configured: DesertConfig | None = None,
        **script: Any,
    ) -> None:
        self.agenda = Agenda()
        self.events: list[tuple[int, int, Event]] = []
        """``(instant, address, event)``."""
        self.seen: list[Observation] = []
        """What became of the packets."""
        medium = SampleChannel(nodes, random.Random(f"water {seed}"), loss=loss)
        self.desert = StandIn(
            medium, StandInConfig(**script), rng=random.Random(seed), observer=self.seen.append
        )
        self._capabilities = (configured or DesertConfig()).capabilities()
        self._pacers = [Pacer(self._capabilities) for _ in range(nodes)]
        self._armed: dict[int, int] = {}
        self._desert_at: int | None = None
        self._engines = [
            Engine(address=1 + node, table=table, epoch=7, rng=random.Random(f"{seed}/{node}"))
            for node in range(nodes)
        ]
        for node, engine in enumerate(self._engines):
            self.desert.handle_client(node, 0)
            engine.handle_link_state(LinkState.UP, 0, self._capabilities)
            self._serve(node)

    def engine(self, address: int) -> Engine:
        """Return the engine of a node, for its getters."""
        return self._engines[address - 1]

    def apply(self, address: int, command: Callable[[Engine, int], T]) -> T:
        """Give a command to an engine and let it act."""
        result = command(self._engines[address - 1], self.agenda.now)
        self._serve(address - 1)
        return result

    def publish(self, address: int, stream_id: int, sample: bytes) -> int:
        """Publish a sample from a node; returns its delivery id."""
        return self.apply(address, lambda engine, now: engine.publish(stream_id, sample, now))

    def at(self, instant_s: float, action: Callable[[], object]) -> None:
        """Do something at an instant, s."""
        self.agenda.at(instant_s, action)

    def run(self, until_s: float) -> None:
        """Let happen what is to happen up to an instant, s."""
        self.agenda.run(seconds_to_ns(until_s))

    @property
    def frames(self) -> int:
        """Frames that all engines have transmitted."""
        return sum(each.stats.frames_transmitted for each in self._engines)

    # Below the methods above

    def _serve(self, node: int) -> None:
        engine, pacer, now = self._engines[node], self._pacers[node], self.agenda.now
        while True:
            while (write := engine.poll_journal()) is not None:
                engine.handle_journal_committed(write.write_id, now)
            while (event := engine.poll_event()) is not None:
                self.events.append((now, node + 1, event))
            transmission = engine.poll_transmit(now)
            if transmission is not None:
                pacer.submit(transmission, now)
            frame_bytes = pacer.poll_write(now)
            if frame_bytes is not None:
                self.desert.handle_write(node, frame_bytes, now)
                self._arm_desert()
            report = pacer.poll_report(now)
            if report is not None:
                engine.handle_transmit_report(report, now)
            if transmission is None and report is None:
                break
        instants = (engine.poll_timeout(), pacer.poll_timeout())
        at = min((at for at in instants if at is not None), default=None)
        if at is not None and self._armed.get(node) != at:
            self._armed[node] = at
            self.agenda.push(max(at, now), self._expire, node, at)

    def _expire(self, node: int, armed_at: int) -> None:
        if self._armed.get(node) == armed_at:
            del self._armed[node]
            self._engines[node].handle_timeout(self.agenda.now)
            self._serve(node)

    def _arm_desert(self) -> None:
        at = self.desert.poll_timeout()
        if at is not None and (self._desert_at is None or at < self._desert_at):
            self._desert_at = at
            self.agenda.push(max(at, self.agenda.now), self._go_on, at)

    def _go_on(self, armed_at: int) -> None:
        if self._desert_at != armed_at:
            return
        self._desert_at, now = None, self.agenda.now
        self.desert.handle_timeout(now)
        while (delivery := self.desert.poll_delivery()) is not None:
            frame = ReceivedFrame(frame_bytes=delivery.payload, received_at=now)
            self._engines[delivery.node].handle_frame(frame, now)
            self._serve(delivery.node)
        self._arm_desert()
