"""A channel that loses, doubles and delays frames: by so many others, or by so much time.

A frame, or a copy of it, comes when so many later frames of its sender have gone, or, with
`latest_s`, within that time. That is what the wire page promises to withstand.
"""

import random
from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.streams.table import StreamTable

_LINK: Final = LinkCapabilities(mtu_bytes=64, bit_rate_bps=50_000.0, propagation_s=0.01)


class Disorder(msgspec.Struct, frozen=True, kw_only=True):
    """What becomes of frames: shares of 1."""

    lost: float = 0.0
    late: float = 0.0
    doubled: float = 0.0
    overtaken: int = 31
    """By how many later frames of its sender one is overtaken at most."""
    latest_s: float | None = None
    """How much later one comes at most, by however many it is overtaken; None: that decides."""


class DisorderlyNetwork:
    """Engines on such a channel; every copy of a frame has a fate of its own at each node.

    Args:
        table: Of all nodes.
        disorder: What goes wrong.
        seed: Decides where.
        deliver: Takes the events: address of the node, event.
        link: What all of them have.
    """

    def __init__(
        self, table: StreamTable, disorder: Disorder, seed: object,
        deliver: Callable[[int, Event], None], link: LinkCapabilities = _LINK,
    ) -> None:  # fmt: skip
        self._disorder = disorder
        self._link = link
        self._rng = random.Random(f"disorder/{seed}")
        self._deliver = deliver
        self._now = 0
        self._gone = dict.fromkeys(table.nodes, 0)
        self._late: dict[int, list[tuple[int, int, Transmission]]] = {
            address: [] for address in table.nodes
        }
        self.engines: Mapping[int, Engine] = {
            address: Engine(
                address=address, table=table, epoch=1, rng=random.Random(f"{seed}/{address}")
            )
            for address in table.nodes
        }
        for address, engine in self.engines.items():
            engine.handle_link_state(LinkState.UP, 0, link)
            self._service(address)
        self.run(1.0)

    def publish(self, address: int, stream_id: int, value: object) -> None:
        """Publish a sample from a node."""
        self.engines[address].publish(stream_id, value, self._now)
        self._service(address)

    def run(self, duration_s: float) -> None:
        """Let happen what is due."""
        until = self._now + round(duration_s * NS_PER_S)
        while True:
            due_at, address = min(
                (engine.poll_timeout() or until, address)
                for address, engine in self.engines.items()
            )
            late_at, source = self._next_late(until)
            if min(due_at, late_at) >= until:
                break
            self._now = max(self._now, min(due_at, late_at))
            if late_at < due_at:
                self._arrive(source)
                continue
            self.engines[address].handle_timeout(self._now)
            self._service(address)
        self._now = max(self._now, until)

    def _service(self, address: int) -> None:
        engine = self.engines[address]
        while (write := engine.poll_journal()) is not None:
            engine.handle_journal_committed(write.write_id, self._now)
        while (transmission := engine.poll_transmit(self._now)) is not None:
            started_at = self._now
            self._now += self._link.airtime_ns(len(transmission.frame_bytes))
            report = TransmitReport(
                transmission_id=transmission.transmission_id, outcome=TransmitOutcome.SENT,
                started_at=started_at, finished_at=self._now,
            )  # fmt: skip
            engine.handle_transmit_report(report, self._now)
            self._gone[address] += 1
            for receiver in self.engines:
                if receiver != address and transmission.destination in (receiver, BROADCAST):
                    self._spread(address, receiver, transmission)
            self._arrive(address)
        while (event := engine.poll_event()) is not None:
            self._deliver(address, event)

    def _spread(self, source: int, receiver: int, transmission: Transmission) -> None:
        """Draw when a frame comes at a node, and how often."""
        rng, disorder = self._rng, self._disorder
        copies = 2 if rng.random() < disorder.doubled else 1
        for copy in range(copies):
            if rng.random() < disorder.lost:
                continue
            is_late = copy > 0 or rng.random() < disorder.late
            due = self._place(source)
            if is_late and disorder.latest_s is None:
                due += rng.randint(1, disorder.overtaken)
            elif is_late and disorder.latest_s is not None:
                latest_ns = disorder.latest_s * NS_PER_S
                due += rng.randrange(round(latest_ns) - self._link.airtime_ns(_LINK.mtu_bytes))
            self._late[source].append((due, receiver, transmission))

    def _place(self, source: int) -> int:
        """Return how many frames of a node have gone, or what time it is, ns."""
        return self._gone[source] if self._disorder.latest_s is None else self._now

    def _next_late(self, otherwise: int) -> tuple[int, int]:
        """Return when the next frame comes that is late by time, and whose it is."""
        if self._disorder.latest_s is None:
            return otherwise, 0
        return min(
            min(((each[0], source) for each in late), default=(otherwise, 0))
            for source, late in self._late.items()
        )

    def _arrive(self, source: int) -> None:
        """Hand over what is overtaken by as many frames, or as late, as it was to be."""
        place, waiting = self._place(source), self._late[source]
        self._late[source] = [each for each in waiting if each[0] > place]
        arriving = sorted((each for each in waiting if each[0] <= place), key=lambda each: each[0])
        for _, receiver, transmission in arriving:
            self._now += NS_PER_S // 1000
            frame = ReceivedFrame(
                frame_bytes=transmission.frame_bytes, received_at=self._now, source=source,
                destination=transmission.destination,
            )  # fmt: skip
            self.engines[receiver].handle_frame(frame, self._now)
            self._service(receiver)
