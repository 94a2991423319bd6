"""A channel that loses, doubles and delays frames, and says by how many others each is overtaken.

Time is not its measure: a frame, or a copy of it, comes when so many later frames of its sender
have gone. That is what the wire page promises to withstand.
"""

import random
from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine import Engine
from zacoustic.core.events import Event
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.streams import StreamTable

_LINK: Final = LinkCapabilities(mtu_bytes=64, bit_rate_bps=50_000.0, propagation_s=0.01)


class Disorder(msgspec.Struct, frozen=True, kw_only=True):
    """What becomes of frames: shares of 1."""

    lost: float = 0.0
    late: float = 0.0
    doubled: float = 0.0
    overtaken: int = 31
    """By how many later frames of its sender one is overtaken at most."""


class DisorderlyNetwork:
    """Engines on such a channel; every copy of a frame has a fate of its own at each node.

    Args:
        table: Of all nodes.
        disorder: What goes wrong.
        seed: Decides where.
        deliver: Takes the events: address of the node, event.
    """

    def __init__(
        self, table: StreamTable, disorder: Disorder, seed: object,
        deliver: Callable[[int, Event], None],
    ) -> None:  # fmt: skip
        self._disorder = disorder
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
            engine.handle_link_state(LinkState.UP, 0, _LINK)
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
            if due_at >= until:
                break
            self._now = max(self._now, due_at)
            self.engines[address].handle_timeout(self._now)
            self._service(address)
        self._now = max(self._now, until)

    def _service(self, address: int) -> None:
        engine = self.engines[address]
        while (write := engine.poll_journal()) is not None:
            engine.handle_journal_committed(write.write_id, self._now)
        while (transmission := engine.poll_transmit(self._now)) is not None:
            started_at = self._now
            self._now += _LINK.airtime_ns(len(transmission.frame_bytes))
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
            behind = rng.randint(1, disorder.overtaken) if is_late else 0
            self._late[source].append((self._gone[source] + behind, receiver, transmission))

    def _arrive(self, source: int) -> None:
        """Hand over what is overtaken by as many frames as it was to be."""
        gone, waiting = self._gone[source], self._late[source]
        self._late[source] = [each for each in waiting if each[0] > gone]
        arriving = sorted((each for each in waiting if each[0] <= gone), key=lambda each: each[0])
        for _, receiver, transmission in arriving:
            self._now += NS_PER_S // 1000
            frame = ReceivedFrame(
                frame_bytes=transmission.frame_bytes, received_at=self._now, source=source,
                destination=transmission.destination,
            )  # fmt: skip
            self.engines[receiver].handle_frame(frame, self._now)
            self._service(receiver)
