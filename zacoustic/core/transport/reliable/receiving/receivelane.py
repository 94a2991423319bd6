"""Samples of one key of one publisher, in the order of their numbers."""

from typing import Final

from zacoustic.core.transport.deliveries import SampleReceived
from zacoustic.core.transport.reliable.receiving.watch import Watch
from zacoustic.core.wire.frame import Sync
from zacoustic.core.wire.numbers import Ack

_FORMER_LINEAGES: Final = 16
"""So many are remembered: a publisher whose journal is so many lives old is recognised."""


class ReceiveLane:
    """Samples of one key of one publisher."""

    __slots__ = (
        "doubtful_end",
        "expected",
        "former",
        "held",
        "in_sync",
        "is_settled",
        "kept",
        "large_end",
        "lineage",
        "pending",
        "unheard",
        "watch",
    )

    def __init__(self, lineage: int, expected: int, *, is_settled: bool) -> None:
        self.lineage = lineage
        self.expected = expected
        """The next number to hand on."""
        self.kept = expected
        """Everything before this number is written down: it may be acknowledged."""
        self.pending: list[SampleReceived] = []
        """Samples before that number which are being written down, and handed on then."""
        self.held: dict[int, SampleReceived] = {}
        """Samples that came too early, by number."""
        self.former: tuple[int, ...] = ()
        """Lineages that are over, the last first: nothing of them is handed on any more."""
        self.is_settled = is_settled
        """In this life it has had a SYNC. A position that was kept may be an old one, and by it a
        number cannot be told from one that is 128 ahead."""
        self.doubtful_end = expected
        """A former life may have handed on samples before this number."""
        self.in_sync = True
        """The publisher's last sample came without SYNC: a short ACK is understood."""
        self.unheard = 0
        """Answers that were followed by nothing new."""
        self.watch = Watch()
        """Asks for what does not come in time."""
        self.large_end = 0
        """A large sample is on its way, the one before this number, unless it is over."""

    def settle(self, floor: int, depth: int) -> None:
        """Learn in this life where the publisher's count stands.

        Args:
            floor: Everything before this number is over.
            depth: So many samples from there on may have been sent before this life.
        """
        if not self.is_settled:
            self.is_settled = True
            self.doubtful_end = floor + depth

    @property
    def newest(self) -> int:
        """The highest number that has come, or is given up."""
        return max(self.held, default=self.expected - 1)

    @property
    def awaits_large(self) -> bool:
        """What is awaited crosses as an object, or waits for one: no ACK would bring it sooner."""
        return self.expected < self.large_end

    def hand_on(self, up_to: int) -> list[SampleReceived]:
        """Take what is in order now, and what is held below a number; what lacks there is over."""
        ready = [self.held.pop(number) for number in sorted(self.held) if number < up_to]
        self.expected = max(self.expected, up_to)
        while self.expected in self.held:
            ready.append(self.held.pop(self.expected))
            self.expected += 1
        return ready

    @classmethod
    def behind(
        cls, before: "ReceiveLane | None", lineage: int, expected: int
    ) -> tuple["ReceiveLane", list[SampleReceived]]:
        """Begin another lineage; returns what the one before holds: what it lacks never comes."""
        lane = cls(lineage, expected, is_settled=False)
        if before is None:
            return lane, []
        lane.former = (before.lineage, *before.former)[:_FORMER_LINEAGES]
        lane.pending = before.pending
        return lane, before.hand_on(max(before.held, default=before.expected))

    @property
    def sync(self) -> Sync:
        """Where its count stands, as it may be acknowledged."""
        return Sync(self.lineage, self.kept)

    def ack(self) -> Ack:
        """Return what may be acknowledged."""
        held = 0
        for number in self.held:
            # Numbers between `kept` and `expected` are being written down: they are not held.
            held |= 1 << number - self.kept - 1
        return Ack(self.kept, held if self.kept == self.expected else 0)
