"""A node's part in flooding: it passes on each frame that it hears for the first time.

An emergency has no time to find out by which way it arrives. So a frame of a stream with ``flood``
goes to all nodes of the link, and each of them passes it on, after a random pause, until it has
gone its number of hops. That costs a frame of every node in reach. Who then hears no other node
pass it on repeats it, twice at most: without that a line of nodes loses most. The node that a frame
is for passes it on as well, which tells the one before. After eight frames in a row for one node
that nobody passed on, further ones go once, until somebody does or that node is heard. A reliable
stream is also repeated from its end, like on any link.

A frame is known by its origin, its number and its bytes for four times as long as it can be on its
way. What comes again, from whatever side, is dropped. In a fleet with a key each hop is sealed, so
a node passes on only what a node of the fleet has sent it; and no node spends more than its share
for others.

======================  ===================================================================
Drop                    reason
======================  ===================================================================
``flood_format``        the frame cannot be decoded
``flood_stranger``      its origin is not in the fleet
``flood_again``         it has been here
``flood_full``          it gave way to a newer one, or was too old before it could go
======================  ===================================================================
"""

import random
import zlib
from collections import Counter, OrderedDict
from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import (
    BROADCAST,
    LinkCapabilities,
    LinkMetrics,
    ReceivedFrame,
    TransmitReport,
)
from zacoustic.core.base.parts import FIRST_BUT_URGENT, Offer, Part
from zacoustic.core.base.qos import PATIENCE_NS, Priority
from zacoustic.core.base.sizes import SIZES, Sizes
from zacoustic.core.base.stats import NO_STREAM, Cause, Entries, LinkStats
from zacoustic.core.relay.flood import SPREAD_FRAMES, Flood
from zacoustic.core.schedule.airtime import AirtimeAccount
from zacoustic.core.schedule.hopage import UNBOUNDED, hop_age, made_before, travelled
from zacoustic.core.schedule.sources import Forwarded
from zacoustic.core.wire.flood import HEADER_BYTES, Flooded, decode

_MOST_WAITING: Final = 16
"""How many frames of others wait at most."""
_MOST_TRIES: Final = 3
_MOST_VAIN: Final = 8
"""After so many frames for one node that nobody passed on, the next ones go once."""
_DECIDES_NS: Final = 12 * NS_PER_S // 10
"""Time in which a neighbour begins to pass a frame on, beside its pause, airtimes and sound."""
_LONGEST_DRAW: Final = 1.5
_FRAMES_EACH: Final = 2
"""A node passes a frame on after a pause of up to so many largest frames for each neighbour, which
have all heard it at the same instant: of many, the first is as early as the only one of few."""
_MOST_NEIGHBOURS: Final = 40
_LIFETIMES: Final = 4
_PATIENCE_NS: Final = PATIENCE_NS[Priority.INTERACTIVE_HIGH]

Deliver = Callable[[ReceivedFrame, int], None]
"""``(frame, now)``: takes a frame for this node."""


class _Waiting(msgspec.Struct):
    """A frame that this node is to transmit."""

    flooded: Flooded
    from_at: int
    until: int
    is_urgent: bool
    is_own: bool = False
    ended: Callable[[int], None] | None = None
    """Called at the end of the first transmission of an own frame; None: it was, or never is."""
    entries: Entries | None = None
    """What an own frame is to enter into the ledger."""
    made_at: int | None = None
    """Instant at which it was made, ns; None: unknown."""
    tries: int = 0


class Flooding:
    """The flooded frames of a node on one link.

    Args:
        address: Address of this node.
        flood: How far frames go, and the node's share.
        rng: Draws the first number, and pauses.
        stats: Counters of the link.
        lists: Returns whether an address belongs to the fleet.
        deliver: Takes frames for this node.
    """

    has_granted = False
    goes_on = False

    def __init__(
        self,
        address: int,
        flood: Flood,
        *,
        rng: random.Random,
        stats: LinkStats,
        sizes: Sizes = SIZES,
        lists: Callable[[int], bool],
        deliver: Deliver,
    ) -> None:
        self._address = address
        self._flood = flood
        self._account = AirtimeAccount(flood.max_airtime)
        self._rng = rng
        self._stats = stats
        self._lists = lists
        self._deliver = deliver
        self._hop: LinkCapabilities | None = None
        self._numbers, self._most_seen = sizes.hops, sizes.seen_hops
        self._next_seq = rng.randrange(sizes.hops)
        self._vain = Counter[int]()
        """Frames in a row that nobody passed on, though somebody should have, by destination."""
        self._neighbours: set[int] = set()
        """Nodes of which a frame has come."""
        self._waiting: list[_Waiting] = []
        self._seen: OrderedDict[tuple[int, int, int], int] = OrderedDict()

    def use_link(self, capabilities: LinkCapabilities) -> None:
        """Take what the link of the hops can do."""
        self._hop = capabilities

    def link_down(self, now: int) -> None:
        """Give up everything: the link is down."""
        waiting, self._waiting = self._waiting, []
        for each in waiting:
            self._end(each, now)

    def submit(
        self, destination: int, content: bytes, now: int, ended: Callable[[int], None],
        entries: Entries, *, is_urgent: bool,
    ) -> None:  # fmt: skip
        """Take a frame of this node.

        Args:
            destination: Address of the node that it is for, or 255.
            content: The frame.
            now: The instant, ns.
            ended: Called with the instant at the end of its transmission.
            entries: What the frame is to enter into the ledger.
            is_urgent: Whether it goes before all others.
        """
        seq = self._next_seq
        self._next_seq = (seq + 1) % self._numbers
        flooded = Flooded(self._address, destination, seq, self._flood.hops - 1, content)
        until = now + self._longest_ns
        self._waiting.append(_Waiting(flooded, now, until, is_urgent, True, ended, entries, now))

    def handle(self, source: int, content: bytes, frame: ReceivedFrame, now: int) -> str | None:
        """Take a frame of a neighbour; return why it is dropped, or None.

        Args:
            source: Address of the neighbour.
            content: Begins with the code of flooded frames.
            frame: The frame, with its travel.
            now: The instant, ns.
        """
        flooded = decode(content)
        if flooded is None:
            return "flood_format"
        if self._lists(source):
            self._neighbours.add(source)
            for each in (source, flooded.origin, BROADCAST):
                self._vain.pop(each, None)
        if flooded.origin == self._address or self._is_known(flooded, now):
            self._overheard(flooded)
            return "flood_again"
        if not self._lists(flooded.origin):
            return "flood_stranger"
        self._remember(flooded, now)
        hops = max(1, self._flood.hops - flooded.left)
        travel = travelled(frame, flooded.age, hops)
        self._pass_on(flooded, made_before(frame, travel), now)
        if flooded.destination in (self._address, BROADCAST):
            inside = msgspec.structs.replace(
                frame,
                frame_bytes=flooded.content,
                source=flooded.origin,
                destination=flooded.destination,
                metrics=LinkMetrics(),
                travel=travel or UNBOUNDED,
            )
            self._deliver(inside, now)
        return None

    @property
    def waiting(self) -> int:
        """How many frames wait here."""
        return len(self._waiting)

    # A source of the composer

    @property
    def is_urgent(self) -> bool:
        """Whether a frame waits that medium access is to treat as urgent."""
        return any(each.is_urgent and each.is_own and not each.tries for each in self._waiting)

    def take_granted(self, room_bytes: int, now: int) -> tuple[int, Forwarded] | None:
        """Return None: nothing is flooded in silence."""
        return None

    def due_at(self, now: int) -> int | None:
        """Return the instant at which a frame is due, ns; None: none."""
        instants = [self._from_at(each, now) for each in self._waiting]
        return min(instants, default=None)

    def offer(self, now: int) -> Offer | None:
        """Return what would go now; None: nothing is due."""
        waiting = self._next(now)
        if waiting is None:
            return None
        rank = FIRST_BUT_URGENT if waiting.is_urgent else waiting.from_at + _PATIENCE_NS
        return Offer(
            destination=BROADCAST,
            rank=rank,
            is_forwarded=True,
            sealed_bytes=HEADER_BYTES + len(waiting.flooded.content),
            ignores_hold=waiting.is_urgent,
        )

    def take(self, room_bytes: int, now: int) -> Forwarded | None:
        """Take the content of the frame that goes now, of at most `room_bytes`."""
        waiting = self._next(now)
        if waiting is None:
            return None
        self._waiting.remove(waiting)
        age = hop_age(waiting.made_at, now)
        said = msgspec.structs.replace(waiting.flooded, age=age).encode()
        if len(said) > room_bytes or waiting.until < now:
            self._stats.drop("flood_full")
            self._end(waiting, now)
            return None
        waiting.tries += 1
        claimed_bytes = 0 if waiting.entries is None else waiting.entries.claim(self._stats)
        self._stats.attribute(NO_STREAM, Cause.RELAY, len(said) - claimed_bytes)
        if not waiting.is_own and self._hop is not None:
            self._account.spend(self._hop.airtime_ns(len(said)), now)
        part = Part(reported=partial(self._reported, waiting))
        is_urgent = waiting.is_own and waiting.is_urgent
        is_pressing = waiting.is_urgent or waiting.tries > 1
        return Forwarded(content=said, part=part, is_urgent=is_urgent, is_pressing=is_pressing)

    # Below the methods above

    @property
    def _longest_ns(self) -> int:
        """How long a frame may be on its way, ns."""
        unit_s = 0.0 if self._hop is None else self._flood.unit_s(self._hop)
        return max(60 * NS_PER_S, 2 * seconds_to_ns(unit_s))

    def _pass_on(self, flooded: Flooded, made_at: int | None, now: int) -> None:
        """Transmit a frame of another node once, if it may go on."""
        left = min(flooded.left, self._flood.hops - 1)
        if not left or self._hop is None:
            return
        others = [each for each in self._waiting if not each.is_own]
        if len(others) >= _MOST_WAITING:
            self._waiting.remove(others[0])
            self._stats.drop("flood_full")
        at = now + round(self._spread_ns(self._hop) * self._rng.random())
        further = msgspec.structs.replace(flooded, left=left - 1)
        # Its origin said nothing of its urgency, and whoever floods has a reason.
        until = now + self._longest_ns
        self._waiting.append(_Waiting(further, at, until, is_urgent=True, made_at=made_at))

    def _spread_ns(self, hop: LinkCapabilities) -> int:
        """Return the longest pause before this node passes a frame on, ns."""
        neighbours = min(len(self._neighbours), _MOST_NEIGHBOURS)
        frames = max(SPREAD_FRAMES, _FRAMES_EACH * (neighbours - 1))
        return frames * hop.airtime_ns(hop.mtu_bytes)

    def _next(self, now: int) -> _Waiting | None:
        """Return the frame that goes next; None: none may go now."""
        due = [each for each in self._waiting if self._from_at(each, now) <= now]
        return min(due, key=lambda each: (not each.is_urgent, each.from_at), default=None)

    def _from_at(self, waiting: _Waiting, now: int) -> int:
        """Return the instant from which a frame may go, ns."""
        if waiting.is_own:
            return waiting.from_at
        return max(waiting.from_at, self._account.even_at(now))

    def _reported(self, waiting: _Waiting, report: TransmitReport, now: int) -> None:
        """Take the end of a transmission; wait for a neighbour to pass the frame on."""
        self._end(waiting, now)
        flooded = waiting.flooded
        is_vain = self._vain[flooded.destination] >= _MOST_VAIN
        if self._hop is None or waiting.tries >= (1 if is_vain else _MOST_TRIES):
            if flooded.left and self._lists_all(flooded.destination):
                self._vain[flooded.destination] += not is_vain
            return
        pause_ns = self._spread_ns(self._hop) + _DECIDES_NS
        pause_ns += 2 * self._hop.airtime_ns(self._hop.mtu_bytes)
        pause_ns += 2 * seconds_to_ns(self._hop.propagation_s)
        waiting.from_at = now + round(pause_ns * self._rng.uniform(1, _LONGEST_DRAW))
        self._waiting.append(waiting)

    def _lists_all(self, destination: int) -> bool:
        return destination == BROADCAST or self._lists(destination)

    def _overheard(self, flooded: Flooded) -> None:
        """Repeat a frame no more: another node has passed it on, as far as this one or further."""
        waiting = [
            each
            for each in self._waiting
            if not each.tries
            or _identity(each.flooded) != _identity(flooded)
            or each.flooded.left < flooded.left
        ]
        if len(waiting) < len(self._waiting):
            self._waiting = waiting
            self._vain.pop(flooded.destination, None)

    def _end(self, waiting: _Waiting, now: int) -> None:
        """Report the end of an own frame, once."""
        ended, waiting.ended = waiting.ended, None
        if ended is not None:
            ended(now)

    def _is_known(self, flooded: Flooded, now: int) -> bool:
        seen_at = self._seen.get(_identity(flooded))
        return seen_at is not None and now - seen_at <= _LIFETIMES * self._longest_ns

    def _remember(self, flooded: Flooded, now: int) -> None:
        self._seen[_identity(flooded)] = now
        self._seen.move_to_end(_identity(flooded))
        if len(self._seen) > self._most_seen:
            self._seen.popitem(last=False)


def _identity(flooded: Flooded) -> tuple[int, int, int]:
    return flooded.origin, flooded.seq, zlib.crc32(flooded.content)
