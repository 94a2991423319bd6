"""Samples of one key that not all receivers have acknowledged."""

import enum
from collections import deque
from collections.abc import Iterator

from zacoustic.core.arq.numbers import NUMBERS, PACE, WINDOW
from zacoustic.core.frame import Sync
from zacoustic.core.queue import LaneKey, Waiting


class Stage(enum.Enum):
    """Where a sample is."""

    STORING = "storing"
    """The journal has not committed it."""
    BEHIND = "behind"
    """Its number is too far ahead of the oldest."""
    QUEUED = "queued"
    """In the transmit queue."""
    ON_AIR = "on_air"
    """In a transmission that has not ended."""
    SENT = "sent"
    """Sent; an ACK is awaited until `due_at`."""


class Outgoing:
    """A sample on its way.

    Args:
        number: Its number in the lane.
        delivery_id: What `Engine.publish` returned.
        waiting: Its record.
        expires_at: Instant after which it is worthless, ns, or None.
    """

    __slots__ = (
        "acknowledged",
        "delivery_id",
        "due_at",
        "expires_at",
        "held",
        "number",
        "order",
        "sent_at",
        "stage",
        "tries",
        "waiting",
    )

    def __init__(
        self, number: int, delivery_id: int, waiting: Waiting, expires_at: int | None
    ) -> None:
        self.number = number
        self.delivery_id = delivery_id
        self.waiting = waiting
        self.expires_at = expires_at
        self.stage = Stage.STORING
        self.acknowledged: set[int] = set()
        """Receivers that have it and all before it."""
        self.held: set[int] = set()
        """Receivers that have it, but keep it until what is before it has come."""
        self.tries = 0
        self.order = 0
        """Counts transmissions of the node: what was sent after what."""
        self.sent_at = 0
        self.due_at = 0


class Reception:
    """What one receiver is known to have of a lane."""

    __slots__ = ("expected", "in_sync", "settled_at")

    def __init__(self, expected: int) -> None:
        self.expected = expected
        """It has told that it has everything before this number."""
        self.in_sync = False
        """It knows the lineage, and nothing that it waits for is gone."""
        self.settled_at: int | None = None
        """Instant from which it can be in sync: short ACKs from before have arrived by then, ns."""


class SendLane:
    """Samples of one key in the order of their numbers.

    Args:
        key: Of its lane in the transmit queue: stream id first, then wildcards.
        receivers: Addresses that are to have each sample.
        lineage: Boot epoch in which the count began.
        next_number: The number of the next sample.
    """

    def __init__(
        self, key: LaneKey, receivers: tuple[int, ...], lineage: int, next_number: int = 0
    ) -> None:
        self.key = key
        self.lineage = lineage
        self.next_number = next_number
        self.samples: deque[Outgoing] = deque()
        self._end = next_number
        self._marks: deque[tuple[int, int]] = deque()
        """When numbers came into use lately, and where they began."""
        self.receptions = {address: Reception(next_number) for address in receivers}

    @property
    def floor(self) -> int:
        """The oldest number that may still come."""
        return self.samples[0].number if self.samples else self.next_number

    def active(self) -> Iterator[Outgoing]:
        """Yield the samples that may be on their way."""
        for sample in self.samples:
            if sample.number >= self._end:
                return
            yield sample

    def open(self, now: int, settling_ns: int) -> int | None:
        """Let numbers come into use; returns when to try again because of `PACE`, ns, or None."""
        while self._marks and self._marks[0][0] + settling_ns <= now:
            self._marks.popleft()
        wanted = min(self.floor + WINDOW, self.next_number)
        begin = self._marks[0][1] if self._marks else self._end
        end = min(wanted, begin + PACE)
        if end > self._end:
            self._marks.append((now, self._end))
            self._end = end
        return self._marks[0][0] + settling_ns if end < wanted else None

    def remove(self, sample: Outgoing, *, may_shift: bool) -> None:
        """Forget a sample; if it and all behind it were never sent, those take its number over."""
        index = self.samples.index(sample)
        behind = list(self.samples)[index + 1 :]
        del self.samples[index]
        if not may_shift or any(other.tries or other.stage is Stage.ON_AIR for other in behind):
            return
        if sample.tries or sample.stage is Stage.ON_AIR:
            return
        for other in behind:
            other.number -= 1
            other.waiting.head = other.waiting.head[:-1] + self.number_byte(other.number)
        self.next_number -= 1
        self._end = min(self._end, self.next_number)

    def awaits(self, sample: Outgoing) -> bool:
        """Tell whether an answer to a sample that was sent is awaited."""
        return sample.stage is Stage.SENT and bool(self.lacking(sample))

    def lacking(self, sample: Outgoing) -> list[int]:
        """Return the receivers that are not known to have it."""
        return [
            address
            for address in self.receptions
            if address not in sample.acknowledged and address not in sample.held
        ]

    def sync(self, number: int, receivers: list[int]) -> bytes:
        """Return the SYNC that these receivers need to place a number, or nothing."""
        for address in receivers:
            reception = self.receptions[address]
            if number - reception.expected >= WINDOW:
                reception.in_sync = False
            if not reception.in_sync:
                return Sync(self.lineage, self.floor).encode()
        return b""

    def number_byte(self, number: int) -> bytes:
        """Return the byte of a number in a record."""
        return bytes((number % NUMBERS,))
