"""The samples of one key of one publisher, in the order of their numbers."""

from typing import Final

from zacoustic.core.base.moments import Made
from zacoustic.core.transport.deliveries import SampleReceived
from zacoustic.core.transport.reliable.receiving.watch import Watch
from zacoustic.core.wire.frame import Sync
from zacoustic.core.wire.numbers import Ack

_LINEAGES: Final = 1 << 16
_FORMER_LINEAGES: Final = 16
"""How many old lineages a receiver remembers, and so recognises if a publisher reuses one."""


class ReceiveLane:
    """The samples of one key of one publisher."""

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
        "pending_since",
        "unheard",
        "watch",
    )

    def __init__(self, lineage: int, expected: int, *, is_settled: bool) -> None:
        self.lineage = lineage
        self.expected = expected
        """The next number to deliver."""
        self.kept = expected
        """Everything before this number is journalled and may be acknowledged."""
        self.pending: list[SampleReceived] = []
        """Samples before `expected` that are being journalled and are delivered after that."""
        self.pending_since: list[Made] = []
        """When those that were found in the journal had arrived."""
        self.held: dict[int, SampleReceived] = {}
        """Samples that came too early, by number."""
        self.former: tuple[int, ...] = ()
        """Lineages that are over, the latest first; their samples are no longer delivered."""
        self.is_settled = is_settled
        """Whether a SYNC has come since the restart. A position from the journal may be outdated,
        and with an outdated position a number cannot be told from the one 128 ahead."""
        self.doubtful_end = expected
        """Samples before this number may have been delivered before the restart."""
        self.in_sync = True
        """Whether the publisher's last sample came without SYNC, so that it understands a short
        ACK."""
        self.unheard = 0
        """ACKs after which nothing new came."""
        self.watch = Watch()
        """Asks for overdue samples."""
        self.large_end = 0
        """The number after a large sample that is on its way, unless that one is over."""

    def settle(self, floor: int, depth: int) -> None:
        """Learn, for the first time since the restart, where the publisher's count stands.

        Args:
            floor: Everything before this number is over.
            depth: How many samples from there on may have been sent before the restart.
        """
        if not self.is_settled:
            self.is_settled = True
            self.doubtful_end = floor + depth

    def is_over(self, lineage: int) -> bool:
        """Return whether a lineage has ended: it is known, or one of the few before the present.

        A late double may come from a boot epoch of which nothing came in time.
        """
        since = (self.lineage - lineage) % _LINEAGES
        return lineage in self.former or 0 < since <= _FORMER_LINEAGES

    @property
    def newest(self) -> int:
        """The highest number that has come or is given up."""
        return max(self.held, default=self.expected - 1)

    @property
    def awaits_large(self) -> bool:
        """Whether the awaited sample is an object or waits for one: no ACK would speed it up."""
        return self.expected < self.large_end

    def hand_on(self, up_to: int) -> list[SampleReceived]:
        """Return the samples in order, and those held below a number; give up the gaps there."""
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
        """Begin another lineage; return the samples that the old one holds: its gaps never fill."""
        lane = cls(lineage, expected, is_settled=False)
        if before is None:
            return lane, []
        lane.former = (before.lineage, *before.former)[:_FORMER_LINEAGES]
        lane.pending = before.pending
        return lane, before.hand_on(max(before.held, default=before.expected))

    @property
    def sync(self) -> Sync:
        """Where the lane's count stands, as far as it may be acknowledged."""
        return Sync(self.lineage, self.kept)

    def ack(self) -> Ack:
        """Return what may be acknowledged now."""
        held = 0
        for number in self.held:
            # Numbers from `kept` to `expected` are being journalled: the ACK must not claim them.
            held |= 1 << number - self.kept - 1
        return Ack(self.kept, held if self.kept == self.expected else 0)
