"""Ranges on demand: an exchange with a peer, and what the modem measures in it.

A modem measures a propagation delay only if an answer comes back, so this node has to ask the peer
something. Any unicast frame will do if it requests an acknowledgement from the peer's modem. So a
range request waits for the next frame to that peer. If there is none, the composer makes one, with
what is owed to the peer or with one byte of padding: the smallest possible frame, which introduces
nobody and causes no answer but the modem's. While a modem waits for an acknowledgement it transmits
nothing. So frames that go several times in a row do not measure ranges, nor does a frame whose data
may still have to be repeated, unless a schedule is late by a period.

Only time assigns answers to requests: a measurement answers all requests made before it, whichever
exchange it comes from, and never a later one. So two requests share an exchange, and a delay that
the modem remembers from before is never used.

The states of a peer whose range is wanted::

    wanted ──frame goes──► under way ──report──► pausing ──► wanted
       ▲                                  │
       └── the next one, a period later ◄─┴─ measured

An exchange without a result is repeated until the time of the request is over. The pause doubles,
and grows with the silence of the peer, so one that is gone costs little. When it is heard again,
the next exchange may follow at once.
"""

import enum
import math
import random
from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import (
    LinkCapabilities,
    PeerMeasured,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.base.parts import Offer, Part
from zacoustic.core.base.stats import Cause
from zacoustic.core.base.timers import Due, Timers
from zacoustic.core.peers.measurements import Range, range_in
from zacoustic.core.peers.peer import Pause
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import LocalError, RangeUnavailableError

LEAST_PERIOD_S: Final = 1.0
"""Shortest period of a schedule, s: an exchange over 1500 m takes 3 s, one over 100 m half a
second."""
LONGEST_PERIOD_S: Final = 86_400.0
"""Longest period of a schedule, s: a day."""
_LONGEST_PAUSE_UNITS: Final = 64
"""As for questions of the handshake: two minutes with messages of 64 bytes over 1500 m."""
_FIRST_SHARE: Final = 4
"""A schedule begins within this part of its period, so that nodes that start together spread."""


class RangeFailure(enum.Enum):
    """Why there is no range."""

    TIMED_OUT = "timed_out"
    """No measurement came in time."""
    UNAVAILABLE = "unavailable"
    """The link cannot measure ranges."""


class RangeMeasured(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a range request."""

    range_id: int
    """What `Ranging.request` returned."""
    range: Range
    """The range."""


class RangeFailed(msgspec.Struct, frozen=True, kw_only=True):
    """The failure of a range request."""

    range_id: int | None
    """What `Ranging.request` returned; None: a schedule that this link cannot serve."""
    address: int
    """The peer."""
    failure: RangeFailure
    """Why."""
    text: str
    """One line of text."""


class Ranging:
    """The range requests and schedules of one node.

    Args:
        address: Address of this node.
        table: Its table, with the list of nodes.
        timers: Fire when the time of a request is over.
        rng: Draws when a schedule begins.
        emit: Takes events about requests.
        in_vain: Told ``(address, at)`` of a frame that was not acknowledged.
        ready_at: Returns from when on a frame may go to a node that did not acknowledge one, ns.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        timers: Timers,
        rng: random.Random,
        emit: Callable[[RangeMeasured | RangeFailed], None],
        in_vain: Callable[[int, int], None],
        ready_at: Callable[[int], int],
    ) -> None:
        self._address = address
        self._table = table
        self._timers = timers
        self._rng = rng
        self._emit = emit
        self._in_vain = in_vain
        self._ready_at = ready_at
        self._capabilities: LinkCapabilities | None = None
        self._unit_ns = NS_PER_S
        self._quests: dict[int, _Quest] = {}
        self._next_id = 1

    # Commands

    def request(self, address: int, now: int, *, timeout_s: float) -> int:
        """Request a range; returns the id in its `RangeMeasured` or `RangeFailed`.

        Args:
            address: The peer.
            now: The instant.
            timeout_s: How long it may take, s, above 0.

        Raises:
            LocalError: No such node, this node itself, or an invalid time.
            RangeUnavailableError: The link measures no ranges, or none to that address.
        """
        if not 0 < timeout_s < math.inf:
            raise LocalError(f"timeout_s is {timeout_s}; allowed: above 0")
        self._check(address)
        range_id = self._next_id
        self._next_id += 1
        quest = self._quest(address)
        quest.pause.reset()
        quest.requests[range_id] = now
        deadline_at = now + seconds_to_ns(timeout_s)
        time_out = partial(self._time_out, range_id, address, timeout_s)
        self._timers.at((Due.RANGE, range_id), deadline_at, time_out)
        return range_id

    def cancel(self, range_id: int) -> None:
        """Cancel a request; no event follows."""
        self._timers.cancel((Due.RANGE, range_id))
        for address, quest in tuple(self._quests.items()):
            if quest.requests.pop(range_id, None) is not None:
                self._forget_if_idle(address)

    def peer_forgotten(self, address: int, now: int) -> None:
        """Forget a node: stop to measure its range."""
        quest = self._quests.pop(address, None)
        for range_id in quest.requests if quest is not None else ():
            self._timers.cancel((Due.RANGE, range_id))

    def peer_heard(self, address: int, now: int) -> None:
        """Allow the next exchange at once: a silent node was heard."""
        quest = self._quests.get(address)
        if quest is not None:
            quest.pause.reset()
            quest.is_in_vain = False

    def repeat(self, address: int, every_s: float, now: int) -> None:
        """Measure the range of a peer periodically; replaces an earlier schedule for it.

        Any measurement counts: an exchange for something else postpones the next one. Results are
        `PeerMeasured` events. The link's capabilities are unknown until it is up for the first
        time; if it cannot measure ranges, a `RangeFailed` without id reports it then.

        Args:
            address: The peer.
            every_s: Time between two measurements, s, `LEAST_PERIOD_S`…`LONGEST_PERIOD_S`.
            now: The instant.

        Raises:
            LocalError: No such node, this node itself, or a period out of range.
            RangeUnavailableError: The link measures no ranges, or none to that address.
        """
        if not LEAST_PERIOD_S <= every_s <= LONGEST_PERIOD_S:
            allowed = f"{LEAST_PERIOD_S:g}..{LONGEST_PERIOD_S:g}"
            raise LocalError(f"every_s is {every_s}; allowed: {allowed}")
        self._check(address)
        quest = self._quest(address)
        quest.every_ns = seconds_to_ns(every_s)
        quest.scheduled_at = now + self._rng.randrange(quest.every_ns // _FIRST_SHARE + 1)

    # From the link

    def use_link(self, capabilities: LinkCapabilities) -> None:
        """Scale the pauses to a link, and check whether it measures ranges."""
        self._capabilities = capabilities
        propagation_ns = seconds_to_ns(capabilities.propagation_s)
        self._unit_ns = capabilities.airtime_ns(capabilities.mtu_bytes) + propagation_ns
        for address, quest in tuple(self._quests.items()):
            reason = self._objection(address)
            if reason:
                for range_id in tuple(quest.requests):
                    self._fail(quest, range_id, address, RangeFailure.UNAVAILABLE, reason)
                if quest.every_ns is not None:
                    self._fail(quest, None, address, RangeFailure.UNAVAILABLE, reason)
            self._forget_if_idle(address)

    def measured(self, measurement: PeerMeasured) -> None:
        """Take a measurement of a peer: it answers the requests made before it."""
        address = measurement.address
        quest = self._quests.get(address)
        found = range_in(address, measurement.metrics, measurement.measured_at)
        if quest is None or found is None:
            return
        quest.is_answered = True
        quest.pause.reset()
        if quest.every_ns is not None:
            next_at = found.measured_at + quest.every_ns
            quest.scheduled_at = max(quest.scheduled_at, next_at)
        for range_id, asked_at in tuple(quest.requests.items()):
            if asked_at <= found.measured_at:
                del quest.requests[range_id]
                self._timers.cancel((Due.RANGE, range_id))
                self._emit(RangeMeasured(range_id=range_id, range=found))
        self._forget_if_idle(address)

    # Time

    def due_at(self, now: int) -> int | None:
        """Return the instant of the next exchange, ns, or None."""
        due = self._due(now) if self._quests else None
        return due and due[0]

    def offer(self, now: int) -> Offer | None:
        """Offer a frame to a peer whose range is wanted."""
        due = self._due(now) if self._quests else None
        if due is None or due[0] > now:
            return None
        return Offer(destination=due[1], must_go=Cause.RANGE)

    def exchange(self, address: int, now: int, *, gives_way: bool = False) -> Part | None:
        """Return the part of a frame that measures a range; None: this frame measures none.

        Args:
            address: Its destination.
            now: The instant.
            gives_way: The frame's data may have to go again before its modem has stopped waiting
                for an acknowledgement: measure only if a schedule is late by a period.
        """
        quest = self._quests.get(address)
        if quest is None or self._objection(address):
            return None
        at = self._due_at(address, quest, now)
        if at is None or (gives_way and quest.every_ns is None):
            return None
        if at + (quest.every_ns or 0) * gives_way > now:
            return None
        return Part(transmitted=quest.transmitted, reported=partial(self._reported, address, quest))

    def give_way(self, address: int, until: int) -> None:
        """Postpone a schedule to an instant, ns, by a period at most."""
        quest = self._quests.get(address)
        if quest is not None and quest.every_ns is not None:
            quest.gives_way_until = min(until, quest.scheduled_at + quest.every_ns)

    # Below the methods above

    def _time_out(self, range_id: int, address: int, timeout_s: float, now: int) -> None:
        quest = self._quests[address]
        text = f"no range within {timeout_s:g} s: {quest.words}"
        self._fail(quest, range_id, address, RangeFailure.TIMED_OUT, text)
        self._forget_if_idle(address)

    def _due(self, now: int) -> tuple[int, int] | None:
        """Return ``(instant, address)`` of the next exchange, or None."""
        wanted = [
            (at, address)
            for address, quest in self._quests.items()
            if not self._objection(address)
            and (at := self._due_at(address, quest, now)) is not None
        ]
        return min(wanted, default=None)

    def _due_at(self, address: int, quest: "_Quest", now: int) -> int | None:
        """Return when an exchange with a peer is due, ns; None: none."""
        at = quest.due_at(now)
        if at is None or not quest.is_in_vain:
            return at
        return max(at, self._ready_at(address))

    def _reported(self, address: int, quest: "_Quest", report: TransmitReport, now: int) -> None:
        """An exchange has ended; its measurement comes a little later, if at all."""
        quest.is_under_way = False
        quest.words = _words_of(report)
        if not quest.is_answered:
            quest.pause.use(now, self._unit_ns)
            quest.is_in_vain = report.outcome is not TransmitOutcome.DELIVERED
            if quest.is_in_vain:
                self._in_vain(address, report.finished_at)
        self._forget_if_idle(address)

    def _check(self, address: int) -> None:
        if address == self._address:
            raise LocalError(f"node {address} is this node; allowed: another one")
        nodes = self._table.nodes
        if not 1 <= address <= 254 or (nodes and address not in nodes):
            known = ", ".join(f"{each} ({name})" for each, name in nodes.items()) or "1..254"
            raise LocalError(f"node {address} is not known; allowed: {known}")
        if reason := self._objection(address, is_known=False):
            raise RangeUnavailableError(
                reason, hint="ranges come from a link that acknowledges, such as a modem's"
            )

    def _objection(self, address: int, *, is_known: bool = True) -> str:
        """Return why the range of a peer cannot be measured; empty: it can.

        Args:
            address: The peer.
            is_known: Require that the link's capabilities are known.
        """
        told = self._capabilities
        if told is None:
            return "the link has not been up yet" if is_known else ""
        if not told.measures_range:
            return "this link measures no ranges"
        first, last = told.address_range
        if not first <= address <= last:
            return f"this link measures no range of node {address}; allowed: {first}..{last}"
        return ""

    def _quest(self, address: int) -> "_Quest":
        return self._quests.setdefault(address, _Quest())

    def _fail(
        self, quest: "_Quest", range_id: int | None, address: int, failure: RangeFailure, text: str
    ) -> None:
        if range_id is not None:
            del quest.requests[range_id]
            self._timers.cancel((Due.RANGE, range_id))
        self._emit(RangeFailed(range_id=range_id, address=address, failure=failure, text=text))

    def _forget_if_idle(self, address: int) -> None:
        quest = self._quests[address]
        if not quest.requests and quest.every_ns is None and not quest.is_under_way:
            del self._quests[address]


class _Quest:
    """The requests and the schedule of one peer."""

    def __init__(self) -> None:
        self.requests: dict[int, int] = {}
        """Instant of each request, ns, by id."""
        self.every_ns: int | None = None
        self.scheduled_at = 0
        self.gives_way_until = 0
        """The schedule is postponed to this instant, ns."""
        self.pause = Pause(_LONGEST_PAUSE_UNITS)
        self.is_under_way = False
        """The link has a frame for it that has not ended."""
        self.is_answered = False
        """That frame has brought a range."""
        self.is_in_vain = False
        """The last one was not acknowledged."""
        self.words = "nothing could be sent"
        """Outcome of the last exchange."""

    def transmitted(self, now: int) -> None:
        """Note a frame that may bring a range."""
        self.is_under_way, self.is_answered = True, False
        if self.every_ns is not None:
            self.scheduled_at = now + self.every_ns

    def due_at(self, now: int) -> int | None:
        """Return the instant of the next exchange, ns."""
        if self.is_under_way:
            return None
        if self.requests:
            return max(now, self.pause.not_before)
        if self.every_ns is None:
            return None
        return max(self.scheduled_at, self.pause.not_before, self.gives_way_until)


def _words_of(report: TransmitReport) -> str:
    if report.outcome is TransmitOutcome.DELIVERED:
        return "acknowledged, but the modem reports no delay"
    words = report.outcome.value.replace("_", " ")
    return f"{words} ({report.detail})" if report.detail else words
