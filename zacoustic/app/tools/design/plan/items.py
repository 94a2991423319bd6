"""Waiting items of a node in the model: size, receivers, and the effects of their arrival.

The real queue (`zacoustic.core.schedule.queue`) has records; this one has their sizes and follows
its rules: a lane is first in, first out, as deep as the stream says, and drops old items; the lane
of the highest value goes first.
"""

from collections import deque
from collections.abc import Callable
from typing import Final

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.qos import PATIENCE_NS, Priority, Qos
from zacoustic.core.values.dense import DenseSample
from zacoustic.core.wire.objects import ListenHint

_BEFORE_ALL: Final = -(1 << 62)
NO_STREAM: Final = 0
NO_VOICE: Final = 0


class Item:
    """A waiting record, control or fragment.

    Args:
        stream_id: Stream of its airtime; 0: none.
        destination: Address, or `BROADCAST`.
        size_bytes: Size of the record, prefixes included, LEN excepted.
        queued_at: When it began to wait, ns.
    """

    __slots__ = (
        "alone", "begins", "call", "dense", "destination", "ends", "expires_at", "for_one_node",
        "heard", "is_control", "lost", "open_ended", "queued_at", "rides", "size_bytes",
        "stream_id", "voice", "wait_ns",
    )  # fmt: skip

    def __init__(self, stream_id: int, destination: int, size_bytes: int, queued_at: int) -> None:
        self.stream_id = stream_id
        self.destination = destination
        self.size_bytes = size_bytes
        self.queued_at = queued_at
        self.voice = NO_VOICE
        """Node of the sample: the one that transmits it, or one that it represents. `NO_VOICE`:
        each of those transmits one of its own."""
        self.wait_ns = 0
        """How long it waits for others, ns."""
        self.rides = False
        """It causes no frame, but goes with any."""
        self.expires_at: int | None = None
        self.open_ended = False
        """Its end needs a LEN, unless it is last."""
        self.is_control = False
        """It is delimited in any frame."""
        self.for_one_node = False
        """It is never in a broadcast frame."""
        self.alone = False
        """It fills its frame, as a fragment does."""
        self.call: ListenHint | None = None
        """When the sender of a fragment will listen."""
        self.dense: DenseSample | None = None
        self.begins: Callable[[int], None] | None = None
        """Called when its frame begins."""
        self.ends: Callable[[int], None] | None = None
        """Called when its frame has left."""
        self.heard: Callable[[int, int], None] | None = None
        """Called with each node that has received it, and the instant."""
        self.lost: Callable[[int, int], None] | None = None
        """Called with each node that has lost it, and the instant."""

    @property
    def is_confirm(self) -> bool:
        """It is a CONFIRM."""
        return self.stream_id == NO_STREAM and self.destination != BROADCAST

    def bytes_in(self, destination: int) -> int:
        """Return its size in a frame: in a broadcast one a control names its node."""
        named = self.is_control and destination == BROADCAST != self.destination
        return self.size_bytes + named


class Lane:
    """Waiting items of one key, in order."""

    __slots__ = ("depth", "held_until", "items", "min_interval_ns", "patience_ns", "taken_at")

    def __init__(self, qos: Qos, depth: int | None = None) -> None:
        self.items: deque[Item] = deque()
        self.depth = qos.depth if depth is None else depth
        self.min_interval_ns = seconds_to_ns(qos.min_interval_s)
        self.patience_ns = (
            _BEFORE_ALL if qos.priority is Priority.REAL_TIME else PATIENCE_NS[qos.priority]
        )
        self.taken_at: int | None = None
        self.held_until = 0
        """Its airtime is used up until then, ns."""

    @property
    def is_urgent(self) -> bool:
        """REAL_TIME."""
        return self.patience_ns == _BEFORE_ALL

    @property
    def next_at(self) -> int:
        """Instant from which the first one may go, ns."""
        if self.taken_at is None:
            return self.held_until
        return max(self.held_until, self.taken_at + self.min_interval_ns)

    @property
    def due_at(self) -> int | None:
        """Instant at which the first one is a reason for a frame, ns."""
        first = self.items[0]
        return None if first.rides else max(first.queued_at + first.wait_ns, self.next_at)

    @property
    def rank(self) -> int:
        """The smaller, the sooner."""
        return self.items[0].queued_at + self.patience_ns

    def push(self, item: Item) -> int:
        """Add one; returns how many older ones it has pushed out."""
        pushed = 0
        while len(self.items) >= self.depth:
            self.items.popleft()
            pushed += 1
        self.items.append(item)
        return pushed

    def expire(self, now: int) -> int:
        """Drop old items; return how many."""
        old = [each for each in self.items if each.expires_at is not None and each.expires_at < now]
        for each in old:
            self.items.remove(each)
        return len(old)
