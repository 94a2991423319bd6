"""Payloads that wait for the channel, and which of them is worth most when a frame can go.

Publishing decides nothing: a payload waits in a *lane* (one per key of a topic, one per stream of
calls, direction and peer) and is chosen when the link is ready. Lanes are first in, first out,
bounded by the stream's depth, and drop payloads older than their lifespan. Between lanes the rank
of `zacoustic.core.base.qos` decides: REAL_TIME first, then the smallest sum of the instant since
which a lane waits and the patience of the priority. A payload that displaces an older one waits
since then too; otherwise a topic would be the later, the more often it is published.

A payload is *due* when it is by itself a reason to send a frame: its linger is over and its lane's
minimum interval has passed. A payload that only lingers may join a frame that goes anyway; one
whose minimum interval has not passed may not, unless it is a repetition: what the interval thins is
what is new.

Publishers on several nodes may tick at the same instant, and half-duplex modems would then collide
each time. So a best-effort sample of a steady period lingers for a random time, up to a quarter of
the period and a few frames; samples of one instant linger together.

An override of a topic (`Override`) replaces parts of the QoS of its lanes; a lane that is off
waits, and is no reason for a frame.

Memory is bounded by the table: lanes by keys, nodes and streams, each lane by its depth.
"""

import heapq
import random
from collections import deque
from collections.abc import Collection, Iterator
from itertools import accumulate, takewhile
from typing import Any, Final

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.moments import Made, instant_of
from zacoustic.core.base.parts import Offer, Part
from zacoustic.core.base.qos import NO_OVERRIDE, PATIENCE_NS, Override, Priority, Qos
from zacoustic.core.base.stats import Cause
from zacoustic.core.base.waits import Why
from zacoustic.core.values.age import encode_age
from zacoustic.errors import PayloadTooLargeError

LaneKey = tuple[int, ...]
"""Identifies a lane: stream id first, then what distinguishes the stream's lanes."""

SAMPLE_LANE: Final = 0
RELIABLE_LANE: Final = 3
SAMPLE_LANES: Final = (SAMPLE_LANE, RELIABLE_LANE)
"""Second part of the keys of lanes with samples; other lanes hold calls, answers, confirms."""

SMALLER: Final = "make it smaller: it crosses whole, or not at all"
"""Hint for a record that fits no frame."""

_BEFORE_ALL: Final = -(1 << 62)
_SPREAD_PARTS: Final = 4
"""A sample lingers for at most this fraction of its period, 1/4."""
_LEAST_PERIOD_NS: Final = NS_PER_S
"""In a faster stream the next sample comes sooner than it could be spread."""
_STEADY_INTERVALS: Final = 3
"""So many intervals in a row show a steady period."""
_STEADY_PARTS: Final = 16
"""A period is steady if it differs from the one before by less than this fraction, 1/16."""


class Spread:
    """How long samples of a steady period linger, so that the nodes of a fleet do not meet.

    Args:
        rng: Draws it.
    """

    def __init__(self, rng: random.Random) -> None:
        self.most_ns = 0
        """The longest, ns; 0: on this link nodes do not meet."""
        self._rng = rng
        self._drawn_at = -1
        self._drawn = 0.0

    def draw_ns(self, period_ns: int, now: int) -> int:
        """Return how long a sample lingers, ns: the same part of it for all of an instant."""
        if now != self._drawn_at:
            self._drawn_at, self._drawn = now, self._rng.random()
        return round(self._drawn * min(self.most_ns, period_ns // _SPREAD_PARTS))


class QueuedRecord:
    """A waiting payload, with the parts of its record.

    Args:
        stream_id: Its stream.
        destination: Address of the one node that needs it, or `BROADCAST`.
        prefix: Control prefixes of the record.
        head: Bytes between stream id (and wildcards) and payload, without the age byte.
        payload: The encoded payload.
        stamped: Whether an age byte precedes the payload.
        made_at: When its content was made; only if it is stamped.
        delimits_itself: Whether the payload shows where it ends.
        for_one_node: Whether other nodes would misunderstand it, so that it may not join a
            broadcast frame.
        address: Bytes after the prefix in a broadcast frame, whose destination does not say which
            node it concerns.
        dense_value: The value for a dense block in place of the record, in full precision; None:
            none.
        tick: Number of the sample in its dense stream.
        cause: Why its bytes are sent; None: header and payload.
        code: First byte of the record where it is a control and not the stream's id.
        is_reply: Whether its destination has caused it.
        queued_at: Instant of publication, ns.
        expires_at: Instant after which it is worthless, ns, or None.
    """

    __slots__ = (
        "_fixed_bytes",
        "address",
        "block_bytes",
        "cause",
        "code",
        "copies",
        "delimits_itself",
        "dense_value",
        "destination",
        "expires_at",
        "for_one_node",
        "head",
        "is_copy",
        "is_reply",
        "made_at",
        "part",
        "payload",
        "prefix",
        "queued_at",
        "queued_in",
        "stamped",
        "stream_id",
        "sync",
        "tick",
    )

    def __init__(
        self,
        *,
        stream_id: int,
        destination: int,
        payload: bytes,
        queued_at: int,
        prefix: bytes = b"",
        head: bytes = b"",
        stamped: bool = False,
        made_at: Made = None,
        delimits_itself: bool = False,
        for_one_node: bool = False,
        address: bytes = b"",
        dense_value: dict[str, Any] | None = None,
        tick: int = 0,
        cause: Cause | None = None,
        expires_at: int | None = None,
        code: int | None = None,
        is_reply: bool = False,
    ) -> None:
        self.stream_id = stream_id
        self.code = stream_id if code is None else code
        self.destination = destination
        self.prefix = prefix
        self.head = head
        self.payload = payload
        self.stamped = stamped
        self.made_at = made_at
        self.delimits_itself = delimits_itself
        self.for_one_node = for_one_node
        self.queued_at = queued_at
        self.expires_at = expires_at
        self.address = address
        self.dense_value = dense_value
        self.tick = tick
        self.cause = cause
        self.is_reply = is_reply
        self.sync = b""
        """A prefix that may change while the record waits."""
        self.block_bytes = 0
        """Size of a dense block of it alone, if only that fits a frame; 0: the record fits too."""
        self.copies = 0
        """How often it was sent in a row."""
        self.is_copy = False
        """Whether it was just sent and is to follow at once, where the hearer listens on."""
        self.part: Part | None = None
        """Follows its transmissions; None: nothing does."""
        self.queued_in: Lane | None = None
        """The lane in which it waits; None: it does not wait."""
        self._fixed_bytes = len(prefix) + len(address) + 1 + len(head) + stamped + len(payload)

    def head_at(self, now: int) -> bytes:
        """Return the head for a frame that goes now."""
        return self.head

    def age_at(self, now: int) -> int:
        """Return the code of its age for a frame that goes now."""
        made = instant_of(self.made_at, now)
        return encode_age(None if made is None else now - made)

    @property
    def size_bytes(self) -> int:
        """The largest length of the record with all prefixes, bytes."""
        return self._fixed_bytes + len(self.sync)

    @property
    def least_bytes(self) -> int:
        """The room that it needs in a frame of its own, bytes."""
        return self.block_bytes or self.size_bytes

    def needs_end(self, *, introduced: bool) -> bool:
        """Return whether only LEN, or the end of the frame, shows where the record ends.

        Args:
            introduced: It follows HELLO or TAG, where a receiver does not measure a stream's
                content.
        """
        is_control = self.code != self.stream_id
        return not self.delimits_itself or (introduced and not is_control)


class Lane:
    """The payloads of one key in the order of publication.

    A lane may be thousands deep, and each frame asks about it: no answer may look at all of it.
    """

    __slots__ = (
        "_min_interval_ns",
        "_period_ns",
        "_published_at",
        "_spread",
        "_spread_ns",
        "_steady",
        "_unchanged",
        "destination",
        "held_for",
        "held_until",
        "is_on",
        "items",
        "key",
        "linger_ns",
        "notable",
        "patience_ns",
        "qos",
        "taken_at",
        "waits_since",
    )

    def __init__(self, key: LaneKey, qos: Qos, override: Override, spread: Spread) -> None:
        self.key = key
        self._spread = spread
        self._spread_ns = 0
        self._published_at: int | None = None
        self._period_ns = 0
        self._steady = 0
        """How many intervals in a row were equal to the one before."""
        self.items: deque[QueuedRecord] = deque()
        self.notable: dict[int, QueuedRecord] = {}
        """Its copies and acknowledgements, by identity."""
        self.destination = BROADCAST
        """The destination of its last payload."""
        self.held_until = 0
        """Instant before which nothing of it goes, ns."""
        self.held_for = Why.AIRTIME
        """Why."""
        self.taken_at: int | None = None
        """Instant at which a payload went last that was no repetition, ns."""
        self.waits_since = 0
        """Instant since which its turn has not come, ns: a newer payload takes over the place of
        the one that it displaces, or a topic that is published often would never go."""
        self._unchanged = qos
        self.override(override)

    def override(self, override: Override) -> None:
        """Apply an override to the QoS."""
        qos = override.over(self._unchanged)
        self.qos = qos
        self.is_on = override.on
        self._min_interval_ns = seconds_to_ns(qos.min_interval_s)
        self.linger_ns = qos.linger_ns
        self.patience_ns: int = (
            _BEFORE_ALL if qos.priority is Priority.REAL_TIME else PATIENCE_NS[qos.priority]
        )

    @property
    def next_at(self) -> int:
        """The instant from which the first payload may go, ns."""
        if self.taken_at is None or self.items[0].cause is Cause.REPEAT:
            return self.held_until
        return max(self.held_until, self.taken_at + self._min_interval_ns)

    def hold(self, until: int, why: Why) -> None:
        """Let nothing of it go before an instant, ns."""
        if until > self.held_until:
            self.held_until, self.held_for = until, why

    @property
    def why(self) -> Why:
        """Why the first payload is no reason to send before `due_at`."""
        if self.next_at <= self.waits_since + max(self.linger_ns, self._spread_ns):
            return Why.LINGER
        return self.held_for if self.next_at == self.held_until else Why.INTERVAL

    @property
    def rank(self) -> int:
        """The rank of the first payload: the smaller, the sooner."""
        return self.waits_since + self.patience_ns

    @property
    def due_at(self) -> int:
        """The instant at which the first payload is a reason to send, ns."""
        return max(self.waits_since + max(self.linger_ns, self._spread_ns), self.next_at)

    def first_at(self, now: int) -> QueuedRecord | None:
        """Return the first payload that has not expired, or None."""
        for item in self.items:
            if item.expires_at is None or item.expires_at > now:
                return item
        return None

    def add(self, item: QueuedRecord) -> None:
        """Add a payload; a repetition goes before what waits for the minimum interval."""
        spread_ns = self._drawn_ns(item)
        if not self.items:
            self.waits_since, self._spread_ns = item.queued_at, spread_ns
        if self._min_interval_ns and item.cause is Cause.REPEAT:
            before = sum(1 for _ in takewhile(_is_repetition, self.items))
            self.items.insert(before, item)
        else:
            self.items.append(item)
        item.queued_in = self
        if item.is_copy or item.cause is Cause.ACK:
            self.notable[id(item)] = item

    def _drawn_ns(self, item: QueuedRecord) -> int:
        """Return how long a payload lingers because others tick with it, ns."""
        is_sample = len(self.key) > 1 and self.key[1] == SAMPLE_LANE
        if not is_sample or item.cause is Cause.REPEAT or self.patience_ns == _BEFORE_ALL:
            return 0
        period_ns = item.queued_at - (self._published_at or 0)
        differs_ns = abs(period_ns - self._period_ns)
        is_steady = self._published_at is not None and differs_ns * _STEADY_PARTS < period_ns
        self._steady = self._steady + 1 if is_steady else 0
        self._published_at, self._period_ns = item.queued_at, period_ns
        is_long = period_ns >= _LEAST_PERIOD_NS and self._steady >= _STEADY_INTERVALS
        if item.expires_at is not None:  # it does not linger until it is worthless
            period_ns = min(period_ns, item.expires_at - item.queued_at)
        return self._spread.draw_ns(period_ns, item.queued_at) if is_long else 0

    def take(self, now: int) -> QueuedRecord:
        """Remove the first payload for transmission."""
        item = self.drop_first()
        if item.cause is not Cause.REPEAT:
            self.taken_at = now
        self._go_on()
        return item

    def drop_first(self) -> QueuedRecord:
        """Remove the first payload; the next one takes over its place."""
        item = self.items.popleft()
        self._left(item)
        return item

    def remove(self, item: QueuedRecord) -> None:
        """Remove a payload that must not go any more."""
        if item is self.items[0]:
            self.drop_first()
            self._go_on()
            return
        self.items.remove(item)
        self._left(item)

    def clear(self) -> None:
        """Remove all payloads."""
        while self.items:
            self.drop_first()

    def limit(self, largest_bytes: int) -> list[QueuedRecord]:
        """Remove and return the payloads that are larger, as record and in a block."""
        dropped = [item for item in self.items if item.least_bytes > largest_bytes]
        for item in dropped:
            self._left(item)
        self.items = deque(item for item in self.items if item.queued_in is self)
        return dropped

    def _left(self, item: QueuedRecord) -> None:
        item.queued_in = None
        self.notable.pop(id(item), None)

    def _go_on(self) -> None:
        """Let the next payload wait for itself."""
        if self.items:
            self.waits_since = self.items[0].queued_at


def _due_at(lane: Lane) -> int:
    return lane.due_at


def _is_repetition(item: QueuedRecord) -> bool:
    return item.cause is Cause.REPEAT


class TransmitQueue:
    """The lanes of one engine.

    Args:
        rng: Draws how long samples linger; None: always the same.
    """

    def __init__(self, rng: random.Random | None = None) -> None:
        self.spread = Spread(rng or random.Random(0))
        """How long samples linger because others tick with them."""
        self._lanes: dict[LaneKey, Lane] = {}
        self._busy: dict[LaneKey, Lane] = {}
        self.largest_bytes: int | None = None
        """The largest record that fits a frame of the link, bytes; None before the link was up."""
        self._held: dict[int, int] = {}
        self._replies_held: dict[int, int] = {}
        """Until when the replies to a node wait, ns, by its address."""
        self._overrides: dict[LaneKey, Override] = {}
        self.superseded: dict[int, int] = {}
        """How many payloads newer ones have displaced, by stream."""
        self.expired: dict[int, int] = {}
        """How many payloads became too old, by stream."""

    def __len__(self) -> int:
        return sum(len(lane.items) for lane in self._busy.values())

    def has_bytes(self, least_bytes: int) -> bool:
        """Return whether the records that may go have at least this size together, bytes."""
        lanes = (lane for lane in self._busy.values() if lane.is_on)
        sizes = accumulate((item.size_bytes for lane in lanes for item in lane.items), initial=0)
        return any(size_bytes >= least_bytes for size_bytes in sizes)

    def is_urgent(self, now: int) -> bool:
        """Return whether a REAL_TIME payload waits that may go."""
        for lane in self._busy.values():
            if lane.patience_ns == _BEFORE_ALL and lane.is_on and lane.held_until <= now:
                return True
        return False

    def is_urgent_only_to(self, destinations: Collection[int], now: int) -> bool:
        """Return whether each REAL_TIME payload that waits, and may go, is for one of these."""
        return all(
            item.destination in destinations
            for lane in self._busy.values()
            if lane.patience_ns == _BEFORE_ALL and lane.is_on and lane.held_until <= now
            for item in lane.items
        )

    @property
    def has_copy(self) -> bool:
        """Whether a copy waits: a record that was just sent and follows itself at once."""
        for lane in self._busy.values():
            if lane.notable and lane.is_on:
                for item in lane.notable.values():
                    if item.is_copy:
                        return True
        return False

    @property
    def has_acknowledgement(self) -> bool:
        """Whether an acknowledgement waits."""
        notable = (item for lane in self._busy.values() for item in lane.notable.values())
        return any(item.cause is Cause.ACK for item in notable)

    def pending(self, stream_id: int) -> int:
        """Return how many payloads of a stream wait."""
        return sum(len(lane.items) for lane in self._busy.values() if lane.key[0] == stream_id)

    def check_size(self, name: str, record_bytes: int, *, hint: str = SMALLER) -> None:
        """Refuse a record that fits no frame.

        Args:
            name: The stream's name.
            record_bytes: Size of the record, bytes.
            hint: What to do about it.

        Raises:
            PayloadTooLargeError: States its size and how much fits.
        """
        if self.largest_bytes is not None and record_bytes > self.largest_bytes:
            raise PayloadTooLargeError(
                f"{name}: the record is {record_bytes} bytes; a frame of this link has room for "
                f"{self.largest_bytes}",
                hint=hint,
            )

    def fits(self, item: QueuedRecord) -> bool:
        """Return whether a record, or a block of it, fits a frame of the link."""
        return self.largest_bytes is None or item.least_bytes <= self.largest_bytes

    def push(self, key: LaneKey, item: QueuedRecord, qos: Qos) -> None:
        """Add a payload to its lane; if the lane is deeper than `qos.depth`, drop the oldest.

        The caller makes sure that it `fits`: otherwise it would wait for ever.
        """
        lane = self._lanes.get(key)
        if lane is None:
            lane = self._lanes[key] = Lane(
                key, qos, self._overrides.get(key[:2], NO_OVERRIDE), self.spread
            )
            lane.hold(self._held.get(key[0], 0), Why.AIRTIME)
        self._busy[key] = lane
        lane.add(item)
        lane.destination = item.destination
        if item.is_reply:
            lane.hold(self._replies_held.get(item.destination, 0), Why.REPLIES)
        if len(lane.items) > qos.depth:
            lane.drop_first()
            self.superseded[key[0]] = self.superseded.get(key[0], 0) + 1

    def hold(self, stream_id: int, until: int) -> None:
        """Hold all payloads of a stream until an instant, ns."""
        self._held[stream_id] = until
        for lane in self._lanes.values():
            if lane.key[0] == stream_id:
                lane.hold(until, Why.AIRTIME)

    def hold_replies(self, address: int, until: int) -> None:
        """Hold all replies to a node until an instant, ns."""
        self._replies_held[address] = until
        for lane in self._busy.values():
            if lane.destination == address and lane.items[0].is_reply:
                lane.hold(until, Why.REPLIES)

    def override(self, kind: LaneKey, override: Override) -> None:
        """Override the QoS of lanes.

        Args:
            kind: The first two parts of their keys: stream id, and which of its lanes.
            override: The override.
        """
        self._overrides[kind] = override
        for lane in self._lanes.values():
            if lane.key[:2] == kind:
                lane.override(override)

    def overridden(self, kind: LaneKey, qos: Qos) -> Qos:
        """Return the QoS that lanes have, given the one of their stream."""
        return self._overrides.get(kind, NO_OVERRIDE).over(qos)

    def remove(self, key: LaneKey, head: bytes) -> bool:
        """Remove the payload of a lane with this head; return False when it does not wait."""
        lane = self._busy.get(key)
        if lane is None:
            return False
        found = next((item for item in lane.items if item.head == head), None)
        if found is None:
            return False
        lane.remove(found)
        self._settle(lane)
        return True

    def holds(self, key: LaneKey, item: QueuedRecord) -> bool:
        """Return whether a payload waits."""
        return item.queued_in is not None and item.queued_in is self._busy.get(key)

    def discard(self, key: LaneKey, item: QueuedRecord) -> None:
        """Remove one payload if it waits."""
        if self.holds(key, item):
            lane = self._busy[key]
            lane.remove(item)
            self._settle(lane)

    def replace(self, key: LaneKey, item: QueuedRecord, qos: Qos) -> None:
        """Replace what waits in a lane with a payload, which takes over its queueing instant."""
        lane = self._busy.get(key)
        if lane is not None:
            item.queued_at = lane.items[0].queued_at
            lane.clear()
        self.push(key, item, qos)

    def first(self, key: LaneKey) -> QueuedRecord | None:
        """Return the first payload of a lane without removing it, or None."""
        lane = self._busy.get(key)
        return lane.items[0] if lane is not None else None

    def drop_lane(self, key: LaneKey) -> None:
        """Remove all payloads of a lane."""
        lane = self._busy.get(key)
        if lane is not None:
            lane.clear()
            self._settle(lane)

    def drop_stream(self, stream_id: int) -> int:
        """Remove all payloads of a stream; return how many."""
        dropped = self.pending(stream_id)
        self.drop_lanes((stream_id,))
        return dropped

    def drop_lanes(self, kind: LaneKey) -> None:
        """Remove all payloads of the lanes whose keys begin with `kind`."""
        for key in [key for key in self._busy if key[: len(kind)] == kind]:
            self.drop_lane(key)

    def peer_forgotten(self, address: int, now: int) -> None:
        """Drop the empty lanes of a node; lanes with waiting payloads stay."""
        self._replies_held.pop(address, None)
        for key, lane in list(self._lanes.items()):
            if lane.destination == address and not lane.items:
                del self._lanes[key]

    def readdress(self, stream_id: int, destination: int) -> None:
        """Change the destination of a stream's waiting payloads."""
        for lane in self._busy.values():
            if lane.key[0] == stream_id:
                for item in lane.items:
                    item.destination = destination

    def limit(self, largest_bytes: int) -> list[QueuedRecord]:
        """Set the size of the largest record; remove and return larger records."""
        self.largest_bytes = largest_bytes
        dropped: list[QueuedRecord] = []
        for lane in list(self._busy.values()):
            dropped += lane.limit(largest_bytes)
            self._settle(lane)
        return dropped

    def candidates(self, now: int, only: LaneKey = ()) -> Iterator[tuple[Lane, QueuedRecord]]:
        """Yield the payloads that may go in a frame now, most valuable first.

        The consumer takes a payload by `take` before it asks for the next; one that it does not
        take holds back the rest of its lane, so that the order within a key is kept.

        Args:
            now: The instant.
            only: First parts of the lane keys to consider.
        """
        heap = [
            (lane.rank, lane.key)
            for lane in list(self._busy.values())
            if lane.key[: len(only)] == only
            and self._drop_expired(lane, now)
            and lane.is_on
            and lane.next_at <= now
        ]
        heapq.heapify(heap)
        while heap:
            _, key = heapq.heappop(heap)
            lane = self._lanes[key]
            item = lane.items[0]
            yield lane, item
            taken = not lane.items or lane.items[0] is not item
            if taken and lane.items and lane.next_at <= now:
                heapq.heappush(heap, (lane.rank, key))

    def take(self, lane: Lane, now: int) -> QueuedRecord:
        """Remove the first payload of a lane for transmission."""
        item = lane.take(now)
        self._settle(lane)
        return item

    def due_at(self, now: int, only: LaneKey = ()) -> int | None:
        """Return the earliest instant at which a payload is a reason to send, ns, or None.

        Args:
            now: The instant.
            only: First parts of the lane keys to consider.
        """
        earliest: int | None = None
        for lane in self._busy.values():
            if not lane.is_on or (only and lane.key[: len(only)] != only):
                continue
            expires_at = lane.items[0].expires_at
            if expires_at is not None and expires_at <= now and lane.first_at(now) is None:
                continue
            due_at = lane.due_at
            if earliest is None or due_at < earliest:
                earliest = due_at
        return earliest

    def settle(self, now: int, only: LaneKey = ()) -> None:
        """Drop expired payloads before a decision; to ask `due_at` drops nothing.

        Args:
            now: The instant.
            only: First parts of the lane keys to consider.
        """
        for lane in list(self._busy.values()):
            expires_at = lane.items[0].expires_at
            if expires_at is None or expires_at > now:
                continue
            if lane.key[: len(only)] == only:
                self._drop_expired(lane, now)

    def held(self, now: int) -> tuple[int, Why] | None:
        """Return from when the first payload is a reason to send, ns, and why not before, or None.

        To ask drops nothing: what has expired does not count.
        """
        lanes = (lane for lane in self._busy.values() if lane.is_on and lane.first_at(now))
        lane = min(lanes, key=_due_at, default=None)
        return None if lane is None else (lane.due_at, lane.why)

    def best(self, now: int) -> QueuedRecord | None:
        """Return the most valuable payload that may go now, or None; drops nothing."""
        first: Lane | None = None
        for lane in self._busy.values():
            if not (lane.is_on and lane.first_at(now) and lane.next_at <= now):
                continue
            if first is None or (lane.rank, lane.key) < (first.rank, first.key):
                first = lane
        return None if first is None else first.first_at(now)

    def offer(self, now: int) -> Offer | None:
        """Offer the most valuable payload that is a reason to send."""
        for lane, item in self.candidates(now):
            if lane.due_at <= now:
                is_urgent = lane.qos.priority is Priority.REAL_TIME
                return Offer(
                    destination=item.destination,
                    rank=lane.rank,
                    is_reply=item.is_reply,
                    ignores_hold=is_urgent,
                )
        return None

    def drop_expired(self, now: int) -> int | None:
        """Drop expired payloads; return when the next one can be dropped, ns, or None."""
        busy = [lane for lane in list(self._busy.values()) if self._drop_expired(lane, now)]
        instants = (lane.items[0].expires_at for lane in busy)
        return min((at for at in instants if at is not None), default=None)

    def _drop_expired(self, lane: Lane, now: int) -> bool:
        """Drop the expired payloads of a lane; return whether any is left."""
        while lane.items:
            expires_at = lane.items[0].expires_at
            if expires_at is None or expires_at > now:
                return True
            lane.drop_first()
            self.expired[lane.key[0]] = self.expired.get(lane.key[0], 0) + 1
        self._settle(lane)
        return False

    def _settle(self, lane: Lane) -> None:
        if not lane.items:
            self._busy.pop(lane.key, None)
