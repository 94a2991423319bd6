"""A node's part in the routes over one link: it takes frames into custody and sends them on.

A frame of a route goes to all nodes of the link. The next node of the path takes it into custody
and transmits it; the node before hears that, and its own custody is over. So the repetition that a
lossy channel needs costs nothing where nothing is lost. The last node of a path transmits nothing
that the one before could hear, so it sends a hop acknowledgement; so does a relay that hears again
what it has sent on already. A relay never reads the frame inside: it may be sealed.

Custody is in memory. A relay that restarts forgets it, and the two ends of the route repair that,
as they repair losses on any link. Each frame has a number; with its bytes it identifies a frame for
twice the lifetime of its route, so what the channel repeats or delays is sent on once and handed to
the end once. The bytes matter: an end that has restarted begins with a random number.

======================  ===================================================================
Drop                    reason
======================  ===================================================================
``relay_format``        the frame cannot be decoded
``relay_route``         this node has no such route, or its sender is not in the path
``relay_again``         a frame of a route that has been here
``relay_full``          a frame in custody gave way to a newer one
``relay_given_up``      eight tries, or one if the next node is silent; or too old
======================  ===================================================================

Source:
    Hearing the next node is the passive acknowledgement of J. Jubin and J. D. Tornow, The DARPA
    packet radio network protocols, Proceedings of the IEEE 75(1), 1987. `docs/network.md` has the
    figures of this implementation.
"""

import random
import zlib
from collections import OrderedDict
from collections.abc import Callable, Mapping, Set
from functools import partial
from typing import Annotated, Final

import msgspec
from msgspec import Meta

from zacoustic.core.base.clock import NS_PER_S, Share, seconds_to_ns
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
from zacoustic.core.base.timers import Due, Timers
from zacoustic.core.peers.measurements import Measurements
from zacoustic.core.relay.custody import Custody, Stage
from zacoustic.core.relay.flow import Flow
from zacoustic.core.relay.route import Route
from zacoustic.core.relay.turns import Turns
from zacoustic.core.schedule.airtime import AirtimeAccount
from zacoustic.core.schedule.hopage import UNBOUNDED, hop_age, made_before, travelled
from zacoustic.core.schedule.sources import Forwarded
from zacoustic.core.wire.relay import (
    HEADER_BYTES,
    HopAcks,
    Number,
    Relayed,
    decode,
    hop_acks_in,
)

_ANSWER_NS: Final = 12 * NS_PER_S // 10
"""Time in which the next node decides and begins to transmit, beside airtimes and sound."""
_SPREAD: Final = 0.7
_MOST_SPREADS: Final = 3
"""Pauses become longer with each vain one up to this many times: eight tries fit the lifetime."""
MOST_IN_CUSTODY: Final = 256
"""The largest `RelayRules.queue`."""
_PATIENCE_NS: Final = PATIENCE_NS[Priority.INTERACTIVE_HIGH]

Deliver = Callable[[Route, ReceivedFrame, int], None]
"""``(route, source, frame, now)``: takes a frame at the end of a route."""
_Seen = tuple[Number, int]


class RelayRules(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How much a node does for others."""

    max_airtime: Share = 0.2
    """Share of the time that it transmits frames of others."""
    queue: Annotated[int, Meta(ge=1, le=MOST_IN_CUSTODY)] = 16
    """How many frames it has in custody at most."""


class Hop(msgspec.Struct, frozen=True, kw_only=True):
    """How one hop of a route does, since this node has started."""

    route: str
    """Name of the route."""
    next_node: int
    """Address of the node to which it goes."""
    waiting: int = 0
    """Frames that are held for it."""
    transmissions: int = 0
    """How often a frame was transmitted; below two for each that has arrived on a good hop."""
    passed_on: int = 0
    """Frames that have arrived there."""
    given_up: int = 0
    """Frames that were given up."""


class Relay:
    """The routes over one link of a node.

    Args:
        address: Address of this node.
        routes: The routes that it is part of.
        others: Numbers of the other routes over this link.
        rules: How much it does for others.
        rng: Draws first numbers, and spreads pauses.
        timers: Timers of this link.
        measurements: Has the distances of the neighbours.
        stats: Counters of this link.
        sizes: How many numbers frames have, and how many of them are remembered.
        deliver: Takes frames for this node.
        may_have_restarted: Called after a frame in vain to a node that is silent for long; None:
            nobody has to know.
    """

    def __init__(
        self,
        address: int,
        routes: Mapping[int, Route],
        others: Set[int],
        rules: RelayRules,
        *,
        rng: random.Random,
        timers: Timers,
        measurements: Measurements,
        stats: LinkStats,
        sizes: Sizes = SIZES,
        deliver: Deliver,
        may_have_restarted: Callable[[], None] | None = None,
    ) -> None:
        self._may_have_restarted = may_have_restarted
        self._address = address
        self._routes = dict(routes)
        self._others = others
        self._most_frames = rules.queue
        self._account = AirtimeAccount(rules.max_airtime)
        self._rng = rng
        self._timers = timers
        self._measurements = measurements
        self._stats = stats
        self._deliver = deliver
        self._hop: LinkCapabilities | None = None
        self._frame_ns = 0
        self._flows: dict[tuple[int, bool], Flow] = {}
        self._turns: dict[int, Turns] = {}
        self._numbers, self._most_seen = sizes.hops, sizes.seen_hops
        self._next_seq: dict[int, int] = {}
        self._used: dict[int, int] = {}
        """The number of the path on which this node transmits, by route, if that was changed."""
        for route in routes.values():
            self.add(route)
        self._acks: dict[Number, None] = {}
        self._seen: OrderedDict[_Seen, int] = OrderedDict()

    # Paths

    def add(self, route: Route) -> None:
        """Take part in a route, or in another path of one, which has a number of its own."""
        number = route.route_id
        self._routes[number] = route
        for is_back in (False, True):
            flow = _flow_at(self._address, route, is_back=is_back)
            self._flows.setdefault((number, is_back), flow)
        if number not in self._turns:
            self._turns[number] = Turns()
            self._next_seq[number] = self._rng.randrange(self._numbers)

    def use(self, route_id: int, number: int, now: int) -> None:
        """Transmit on another path of a route from now on.

        What has been transmitted stays on its path: on the other one it would arrive twice.

        Args:
            route_id: The route.
            number: The number of the path.
            now: The instant, ns.
        """
        before = self._used.get(route_id, route_id)
        self._used[route_id] = number
        if before == number or before not in self._routes:
            return
        for is_back in (False, True):
            old, new = self._flows[before, is_back], self._flows[number, is_back]
            for seq, custody in list(old.frames.items()):
                if custody.is_own and not custody.tries:
                    del old.frames[seq]
                    self._timers.cancel(_expiry_key(custody))
                    moved = Number(number, is_back, self._take_seq(number, new))
                    custody.relayed = msgspec.structs.replace(custody.relayed, number=moved)
                    self._hold(new, custody)
            self._settle(old, now)

    def drop(self, number: int, now: int) -> None:
        """Take no longer part in a path; what is in custody is given up."""
        if self._routes.pop(number, None) is None:
            return
        for is_back in (False, True):
            flow = self._flows[number, is_back]
            for custody in list(flow.frames.values()):
                self._end(flow, custody, now)
            self._timers.cancel(_key(flow))
            del self._flows[number, is_back]
        del self._turns[number], self._next_seq[number]
        self._acks = {each: None for each in self._acks if each.route != number}

    def is_in_time(self, path: Route, route: Route) -> bool:
        """Return whether another path of a route is no slower than the ends take it for."""
        return self._hop is None or path.unit_s(self._hop) <= route.unit_s(self._hop)

    def use_link(self, capabilities: LinkCapabilities) -> None:
        """Take what the link of the hops can do."""
        self._hop = capabilities
        gap_ns = seconds_to_ns(capabilities.gap_s)
        self._frame_ns = capabilities.airtime_ns(capabilities.mtu_bytes) + gap_ns

    def link_down(self, now: int) -> None:
        """Give up everything: the link is down."""
        for flow in self._flows.values():
            for custody in list(flow.frames.values()):
                self._end(flow, custody, now)
        self._acks.clear()

    # What this node sends

    def submit(
        self,
        route: Route,
        content: bytes,
        now: int,
        ended: Callable[[int], None],
        entries: Entries,
        *,
        is_urgent: bool = False,
    ) -> None:
        """Take a frame of this node into custody.

        Args:
            route: The route, of which this node is an end.
            content: The frame.
            now: The instant, ns.
            ended: Called with the instant when the next node has it, or it is given up.
            entries: What the frame is to enter into the ledger.
            is_urgent: Whether it goes before all others.
        """
        used = self._used.get(route.route_id, route.route_id)
        is_back = self._address == route.path[-1]
        flow = self._flows[used, is_back]
        number = Number(used, is_back, self._take_seq(used, flow))
        expires_at = now + seconds_to_ns(route.longest_s)
        relayed = Relayed(number, content, is_urgent=is_urgent)
        self._hold(flow, Custody(relayed, now, expires_at, ended, entries, now))

    def hops(self) -> list[Hop]:
        """Return how the hops from this node do, in the order of the routes."""
        return [
            Hop(
                route=self._routes[flow.route].name,
                next_node=flow.to_next,
                waiting=len(flow.frames),
                transmissions=flow.transmissions,
                passed_on=flow.passed_on,
                given_up=flow.given_up,
            )
            for flow in self._flows.values()
            if flow.to_next is not None
        ]

    # A source of the composer

    is_urgent = False  # the gates of the routes give the turns
    has_granted = False

    def take_granted(self, room_bytes: int, now: int) -> tuple[int, Forwarded] | None:
        """Return None: no command comes over a route, so no answer to a silence goes over one."""
        return None

    def due_at(self, now: int) -> int | None:
        """Return the instant at which a frame is due, ns; None: none."""
        earliest = self._acks_at(now)
        even_at: int | None = None
        for (route, _), flow in self._flows.items():
            custody = flow.first_waiting()
            if custody is None:
                continue
            ready_at = now
            if not flow.is_in_train:
                ready_at = self._turns[route].free_at(is_urgent=custody.is_urgent)
                if not custody.is_own:
                    even_at = self._account.even_at(now) if even_at is None else even_at
                    ready_at = max(ready_at, even_at)
            if earliest is None or ready_at < earliest:
                earliest = ready_at
        return earliest

    @property
    def goes_on(self) -> bool:
        """Whether the last frame has announced that another one follows at once."""
        return any(each.is_in_train for each in self._flows.values())

    def offer(self, now: int) -> Offer | None:
        """Return what would go now; None: nothing is due."""
        if self._due_acks(now):
            return Offer(
                destination=BROADCAST,
                rank=FIRST_BUT_URGENT,
                is_forwarded=True,
                sealed_bytes=HEADER_BYTES,
            )
        found = self._next(now)
        if found is None:
            return None
        flow, custody = found
        is_first = flow.is_in_train or custody.is_urgent
        rank = FIRST_BUT_URGENT if is_first else custody.queued_at + _PATIENCE_NS
        return Offer(
            destination=BROADCAST,
            rank=rank,
            is_forwarded=True,
            sealed_bytes=HEADER_BYTES + len(custody.relayed.content),
            ignores_hold=custody.is_urgent,
        )

    def take(self, room_bytes: int, now: int) -> Forwarded | None:
        """Take the content of the frame that goes now, of at most `room_bytes`."""
        if due := self._due_acks(now):
            numbers = tuple(due[: hop_acks_in(room_bytes)])
            for each in numbers:
                del self._acks[each]
            said = HopAcks(numbers, more=self._next(now) is not None).encode()
            self._stats.attribute(NO_STREAM, Cause.RELAY, len(said))
            self._spend(said, now)
            return Forwarded(content=said)
        found = self._next(now)
        if found is None:
            return None
        flow, custody = found
        if HEADER_BYTES + len(custody.relayed.content) > room_bytes:  # the link has another MTU
            self._give_up(flow, custody, now)
            return None
        flow.begin()
        age = hop_age(custody.made_at, now)
        said = msgspec.structs.replace(custody.relayed, more=flow.is_in_train, age=age).encode()
        claimed_bytes = 0 if custody.entries is None else custody.entries.claim(self._stats)
        self._stats.attribute(NO_STREAM, Cause.RELAY, len(said) - claimed_bytes)
        if not custody.is_own:
            self._spend(said, now)
        part = Part(reported=partial(self._reported, flow, custody))
        is_urgent = custody.is_own and custody.is_urgent
        is_pressing = custody.is_urgent or custody.tries > 1
        return Forwarded(content=said, part=part, is_urgent=is_urgent, is_pressing=is_pressing)

    # What this node hears

    def handle(self, source: int, content: bytes, frame: ReceivedFrame, now: int) -> str | None:
        """Take the content of a frame of a neighbour; return why it is dropped, or None.

        Args:
            source: Address of the neighbour.
            content: Begins with the code of relayed frames.
            frame: The frame, with its travel.
            now: The instant, ns.
        """
        decoded = decode(content)
        if decoded is None:
            return "relay_format"
        if isinstance(decoded, HopAcks):
            self._acknowledged(source, decoded, now)
            return None
        number = decoded.number
        steps = self._steps(number, source)
        if steps == 0:
            return None if number.route in self._others else "relay_route"
        self._hear(number, source)
        flow = self._flow(number)
        if steps > 0:
            if steps == 1:
                self._turns_of(number).overheard(
                    self._frame_ns, self._way_ns(flow), now, next_is_end=flow.next_is_end
                )
            self._overheard(flow, decoded, now)
        # A frame from further back is sent on by the node between.
        return self._take(flow, decoded, frame, now) if steps == -1 else None

    # Below the methods above

    def _hear(self, number: Number, source: int) -> None:
        """Note that a node of a route was heard on it."""
        for is_back in (False, True):
            flow = self._flows[number.route, is_back]
            if flow.to_next == source:
                flow.unheard = 0

    def _acknowledged(self, source: int, acks: HopAcks, now: int) -> None:
        """Take hop acknowledgements; those of the end show what it has not received."""
        for number in acks.numbers:
            if self._steps(number, source) <= 0:
                continue
            self._hear(number, source)
            flow, turns = self._flow(number), self._turns_of(number)
            custody = flow.frames.get(number.seq)
            if custody is not None:
                self._passed_on(flow, custody, now)
            if source == flow.to_next:
                turns.received(self._frame_ns, now, more=acks.more)
                if flow.next_is_end and flow.is_awaiting and number == acks.numbers[-1]:
                    self._again(flow, now)

    def _overheard(self, flow: Flow, relayed: Relayed, now: int) -> None:
        """Take a frame of a node further along the path."""
        custody = flow.frames.get(relayed.number.seq)
        if custody is not None and custody.relayed.content == relayed.content:
            self._passed_on(flow, custody, now)
        if flow.is_awaiting and flow.was_answered and not relayed.more:
            self._again(flow, now)

    def _passed_on(self, flow: Flow, custody: Custody, now: int) -> None:
        """End the custody of a frame that a node further along the path has."""
        flow.was_answered, flow.vain, flow.unheard = True, 0, 0
        flow.passed_on += 1
        self._end(flow, custody, now)

    def _take(self, flow: Flow, relayed: Relayed, frame: ReceivedFrame, now: int) -> str | None:
        """Take a frame of the node before; return why it is dropped, or None."""
        number = relayed.number
        self._turns_of(number).received(self._frame_ns, now, more=relayed.more)
        is_end = flow.to_next is None
        custody = flow.frames.get(number.seq)
        if self._is_known(relayed, now):
            if is_end or custody is None or custody.tries:
                self._acks[number] = None
            return "relay_again"
        route = self._routes[number.route]
        self._remember(relayed, now)
        if is_end:
            self._acks[number] = None
            origin = route.path[-1 if number.is_back else 0]
            inside = msgspec.structs.replace(
                frame,
                frame_bytes=relayed.content,
                source=origin,
                destination=self._address,
                metrics=LinkMetrics(),
                travel=travelled(frame, relayed.age, route.hops) or UNBOUNDED,
            )
            self._deliver(route, inside, now)
            return None
        if custody is not None:  # the number has come round, or its sender has restarted
            self._give_up(flow, custody, now)
        self._make_room(now)
        expires_at = now + seconds_to_ns(route.longest_s) // route.hops
        made_at = made_before(frame, travelled(frame, relayed.age))
        self._hold(flow, Custody(relayed, now, expires_at, made_at=made_at))
        return None

    def _hold(self, flow: Flow, custody: Custody) -> None:
        """Take a frame into custody."""
        flow.frames[custody.number.seq] = custody
        self._timers.at(_expiry_key(custody), custody.expires_at, partial(self._expire, custody))

    def _expire(self, custody: Custody, now: int) -> None:
        """Give up a frame that waits for too long: another node may take it for a new one.

        What only this node has had is new wherever it comes. What is under way ends with its try.
        """
        number = custody.number
        flow = self._flows.get((number.route, number.is_back))
        if flow is None or flow.frames.get(number.seq) is not custody:
            return
        if custody.stage is Stage.WAITING and (custody.tries or not custody.is_own):
            self._give_up(flow, custody, now)

    def _take_seq(self, number: int, flow: Flow) -> int:
        """Return the next sequence number on a path of which no frame is in custody."""
        seq = self._next_seq[number]
        for _ in flow.frames:  # urgent frames overtake others, and may come round
            if seq not in flow.frames:
                break
            seq = (seq + 1) % self._numbers
        self._next_seq[number] = (seq + 1) % self._numbers
        return seq

    def _flow(self, number: Number) -> Flow:
        return self._flows[number.route, number.is_back]

    def _turns_of(self, number: Number) -> Turns:
        return self._turns[number.route]

    def _steps(self, number: Number, source: int) -> int:
        """Return how far along the path of a frame its sender is from here; 0: not in the path."""
        route = self._routes.get(number.route)
        if route is None or source not in route.path:
            return 0
        steps = route.path.index(source) - route.path.index(self._address)
        return -steps if number.is_back else steps

    def _way_ns(self, flow: Flow) -> int:
        """Return the propagation delay to the next node, ns."""
        known = None if flow.to_next is None else self._measurements.range(flow.to_next)
        if known is not None:
            return seconds_to_ns(known.propagation_s)
        return 0 if self._hop is None else seconds_to_ns(self._hop.propagation_s)

    def _spend(self, said: bytes, now: int) -> None:
        if self._hop is not None:
            self._account.spend(self._hop.airtime_ns(len(said)), now)

    def _due_acks(self, now: int) -> list[Number]:
        if not self._acks or self.goes_on:
            return []
        if self._account.even_at(now) > now:
            return []
        return [each for each in self._acks if self._turns_of(each).free_at() <= now]

    def _acks_at(self, now: int) -> int | None:
        """Return when hop acknowledgements are due, ns; None: there are none."""
        earliest = min((self._turns_of(each).free_at() for each in self._acks), default=None)
        return None if earliest is None else max(earliest, self._account.even_at(now))

    def _next(self, now: int) -> tuple[Flow, Custody] | None:
        """Return the frame that goes next, and its flow; None: none may go."""
        best: tuple[Flow, Custody] | None = None
        may_forward = self._account.even_at(now) <= now
        for (route, _), flow in self._flows.items():
            custody = flow.first_waiting()
            if custody is None:
                continue
            if flow.is_in_train and not (best and best[1].is_urgent):
                return flow, custody
            if (
                not (custody.is_own or may_forward)
                or self._turns[route].free_at(is_urgent=custody.is_urgent) > now
            ):
                continue
            if best is None or _rank(custody) < _rank(best[1]):
                best = flow, custody
        return best

    def _reported(self, flow: Flow, custody: Custody, report: TransmitReport, now: int) -> None:
        """Take the end of a transmission."""
        custody.stage = Stage.AWAITING
        self._settle(flow, now)

    def _settle(self, flow: Flow, now: int) -> None:
        """Wait for the answer to a train that is over, or no longer."""
        if not flow.has_stopped():
            return
        is_awaiting, awaits_urgent = flow.has(Stage.AWAITING), flow.awaits_urgent()
        if is_awaiting and (awaits_urgent or not flow.is_awaiting):
            sent = sum(each.stage is Stage.AWAITING for each in flow.frames.values())
            sent = 1 if awaits_urgent else sent  # the next node sends it on first
            pause_ns = 2 * self._way_ns(flow) + sent * self._frame_ns + _ANSWER_NS
            self._turns[flow.route].transmitted(now + pause_ns)
            spread = _SPREAD * min(flow.vain, _MOST_SPREADS) * self._rng.random()
            drawn_ns = round(pause_ns * (1 + spread))
            drawn_ns += round(_SPREAD * self._frame_ns * self._rng.random())
            self._timers.at(_key(flow), now + drawn_ns, partial(self._overdue, flow))
        elif flow.is_awaiting and not is_awaiting:
            self._turns[flow.route].answered(now)
            self._timers.cancel(_key(flow))
        flow.is_awaiting = is_awaiting

    def _overdue(self, flow: Flow, now: int) -> None:
        """Transmit again what was not heard further along in time."""
        flow.vain += not flow.was_answered
        flow.unheard += not flow.was_answered
        if flow.is_silent and self._may_have_restarted is not None:
            self._may_have_restarted()
        self._again(flow, now, urgent_only=flow.awaits_urgent())

    def _again(self, flow: Flow, now: int, *, urgent_only: bool = False) -> None:
        """Let what was not heard further along wait again: the answer is over."""
        self._turns[flow.route].answered(now)
        self._timers.cancel(_key(flow))
        for custody in flow.again(now, urgent_only=urgent_only):
            self._give_up(flow, custody, now)
        self._settle(flow, now)

    def _give_up(self, flow: Flow, custody: Custody, now: int) -> None:
        self._stats.drop("relay_given_up")
        flow.given_up += 1
        self._end(flow, custody, now)

    def _end(self, flow: Flow, custody: Custody, now: int) -> None:
        """End the custody of a frame."""
        del flow.frames[custody.number.seq]
        self._timers.cancel(_expiry_key(custody))
        if custody.ended is not None:
            custody.ended(now)
        self._settle(flow, now)

    def _make_room(self, now: int) -> None:
        """Drop the oldest frame of the flow with most frames of others, if there is no room."""
        sizes = {
            key: sum(not each.is_own for each in flow.frames.values())
            for key, flow in self._flows.items()
        }
        if sum(sizes.values()) < self._most_frames:
            return
        flow = self._flows[max(sizes, key=lambda key: sizes[key])]
        oldest = next(each for each in flow.frames.values() if not each.is_own)
        self._stats.drop("relay_full")
        self._end(flow, oldest, now)

    def _is_known(self, relayed: Relayed, now: int) -> bool:
        """Return whether a frame has been here within twice the lifetime of its route."""
        seen_at = self._seen.get(_seen(relayed))
        if seen_at is None:
            return False
        lifetime_ns = seconds_to_ns(self._routes[relayed.number.route].longest_s)
        return now - seen_at <= 2 * lifetime_ns

    def _remember(self, relayed: Relayed, now: int) -> None:
        self._seen[_seen(relayed)] = now
        self._seen.move_to_end(_seen(relayed))
        if len(self._seen) > self._most_seen:
            self._seen.popitem(last=False)


def _seen(relayed: Relayed) -> _Seen:
    return relayed.number, zlib.crc32(relayed.content)


def _rank(custody: Custody) -> tuple[bool, int]:
    return not custody.is_urgent, custody.queued_at


def _flow_at(address: int, route: Route, *, is_back: bool) -> Flow:
    path = route.path[::-1] if is_back else route.path
    further = path[path.index(address) + 1 :]
    to_next = further[0] if further else None
    return Flow(route.route_id, to_next, is_back=is_back, next_is_end=len(further) == 1)


def _expiry_key(custody: Custody) -> tuple[Due, int, bool, int]:
    number = custody.number
    return Due.CUSTODY, number.route, number.is_back, number.seq


def _key(flow: Flow) -> tuple[Due, int, bool]:
    return Due.RELAY, flow.route, flow.is_back
