"""Pings from the local network: does a node answer, how fast, and how far away is it?

The gateway asks the node whether it is silent (a command that changes nothing,
`zacoustic.core.transport.commands`): any answer, also a refusal, shows that its engine runs, not
only its modem. Then, if the modem measures ranges and has reported none on those frames, the
gateway asks for one: after the answer, because a modem that waits for an acknowledgement cannot
receive it. A wire profile without remote commands gives only the range. With `status` the gateway
asks for the node's status instead of its silence (`zacoustic.core.transport.status`).
"""

from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.clock import Clock, ns_to_seconds
from zacoustic.core.base.linktypes import LinkState
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailed, CallFailure, ResponseReceived
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.core.streams.commands import RemoteCommand
from zacoustic.core.streams.status import STATUS_STREAM_ID, NodeStatus
from zacoustic.core.values.encoding import JSON
from zacoustic.errors import LocalError, RangeUnavailableError
from zacoustic.run.pending import CallEnd, Pending
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.gateway.commands.refusing import refuse_failed
from zacoustic.zenoh.gateway.redundant import RedundantGateways
from zacoustic.zenoh.session.asking.commands import node_in
from zacoustic.zenoh.session.asking.pings import (
    LINK_DOWN,
    PINGS,
    PeerStatus,
    PingAnswer,
    PingAsked,
    ping_selector,
    read_ping,
)
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery

RANGE_LIMIT_S: Final = 10.0
"""How much longer an answer waits for the range, s: three exchanges over 1500 m."""


_ROUNDING_S: Final = 1.0
"""Both clocks report whole seconds."""
_AGE_STEP: Final = 0.05
"""Relative error of an age."""


class PingHandler:
    """Takes pings of the local network; for the loop.

    Args:
        runner: Runs the engine that asks.
        redundant: The local gateways.
        ends: The calls of the gateway.
        clock: Source of instants.
    """

    def __init__(
        self,
        runner: LinkRunner,
        redundant: RedundantGateways,
        ends: Pending[CallEnd],
        *,
        clock: Clock,
    ) -> None:
        self._runner = runner
        self._redundant = redundant
        self._clock = clock
        self._ends = ends
        self._ranges: Pending[RangeMeasured | RangeFailed] = Pending()

    @property
    def key(self) -> str:
        """Key expression of pings."""
        return PINGS

    def serve(self, held: HeldQuery) -> None:
        """Take a query."""
        target = node_in(held.key, "ping")
        if target is None or not self._redundant.asks(target):
            held.answer([])
            return
        try:
            asked = read_ping(held.key, held.parameters)
        except ValueError as error:
            held.refuse(CallFailure.BAD_REQUEST, str(error))
            return
        assert asked is not None
        if asked.node in self._redundant.alive:
            text = f"node {asked.node} is on this local network: there is no channel between"
            held.refuse(CallFailure.BAD_REQUEST, text)
            return
        self._runner.apply(partial(self._begin, held, asked))

    def ranged(self, event: RangeMeasured | RangeFailed) -> bool:
        """Take a range, or its failure; False: it belongs to no ping."""
        return self._ranges.take(event.range_id, event)

    # Below the methods above

    def _take_answer(self, ping: "_Ping", event: CallEnd) -> None:
        if isinstance(event, CallFailed) and event.failure is not CallFailure.HANDLER:
            if event.failure is CallFailure.TIMED_OUT and (why := self._why_down()):
                ping.held.refuse(event.failure, f"node {ping.node} has not answered: {why}")
            else:
                refuse_failed(ping.held, event, ping.node)
            return
        now = self._clock()
        if isinstance(event, ResponseReceived) and event.stream_id == STATUS_STREAM_ID:
            ping.status, ping.status_age_s = NodeStatus.from_wire(event.value), event.age_s
            ping.answered_at = now
        ping.round_trip_s = ns_to_seconds(now - ping.asked_at)
        left_s = min(ping.within_s - ping.round_trip_s, RANGE_LIMIT_S)
        known = self._runner.engine.measurements.range(ping.node)
        has_range = known is not None and known.measured_at >= ping.asked_at
        if has_range or left_s <= 0 or not self._runner.apply(partial(self._range, ping, left_s)):
            self._answer(ping)

    def _why_down(self) -> str:
        """Return that no link is up, and why; empty: one is."""
        sides = self._runner.sides
        if any(side.state is LinkState.UP for side in sides):
            return ""
        details = [side.detail for side in sides if side.detail]
        return ", ".join([LINK_DOWN, *details])

    def _begin(self, held: HeldQuery, asked: PingAsked, engine: Engine, now: int) -> None:
        node, within_s = asked.node, asked.within_s
        ping = _Ping(held, node, within_s, now)
        try:
            if asked.status and engine.status.is_carried:
                call_id = engine.status.ask(node, now, timeout_s=within_s)
            else:
                call_id = engine.commands.send(node, RemoteCommand(), now, timeout_s=within_s)
        except LocalError as error:
            if not self._range(ping, within_s, engine, now):
                held.refuse(CallFailure.BAD_REQUEST, f"{error}, and the modem measures no range")
        else:
            self._ends.add(call_id, partial(self._take_answer, ping))

    def _range(self, ping: "_Ping", within_s: float, engine: Engine, now: int) -> bool:
        """Ask for the range; False: it cannot be measured."""
        try:
            range_id = engine.ranging.request(ping.node, now, timeout_s=within_s)
        except (LocalError, RangeUnavailableError):
            return False
        self._ranges.add(range_id, partial(self._take_range, ping))
        return True

    def _take_range(self, ping: "_Ping", event: RangeMeasured | RangeFailed) -> None:
        if isinstance(event, RangeFailed) and ping.round_trip_s is None:
            ping.held.refuse(CallFailure.TIMED_OUT, event.text)
        else:
            self._answer(ping)

    def _answer(self, ping: "_Ping") -> None:
        known = self._runner.engine.measurements
        found = PingAnswer(
            address=ping.node,
            by=self._runner.engine.address,
            round_trip_s=_rounded(ping.round_trip_s),
        )
        if metrics := known.metrics(ping.node):
            found = msgspec.structs.replace(
                found,
                snr_db=metrics.snr_db,
                received_level_db=metrics.received_level_db,
                integrity=metrics.integrity,
            )
        if measured := known.range(ping.node):
            found = msgspec.structs.replace(
                found,
                propagation_s=_rounded(measured.propagation_s, 6),
                range_m=_rounded(measured.range_m),
                range_age_s=_rounded(measured.age_s(self._clock())),
            )
        if ping.status is not None:
            found = msgspec.structs.replace(found, status=self._compared(ping, found.propagation_s))
        key, _ = ping_selector(ping.node, 1)
        ping.held.answer([Answer(key=key, payload=msgspec.json.encode(found), encoding=JSON)])

    def _compared(self, ping: "_Ping", propagation_s: float | None) -> PeerStatus:
        """Return the reported status of a node, compared with the values here."""
        said, here = ping.status, self._runner.engine.status.own(ping.answered_at)
        assert said is not None
        ahead_s = doubt_s = None
        if said.utc_s is not None and here.utc_s is not None and ping.status_age_s is not None:
            # If no range is known, the status was at most half of the round trip on its way.
            unknown_s = (ping.round_trip_s or 0.0) / 2 if propagation_s is None else 0.0
            ahead_s = said.utc_s + ping.status_age_s - here.utc_s
            doubt_s = _ROUNDING_S + ping.status_age_s * _AGE_STEP + unknown_s
        return PeerStatus(
            journal=said.journal.value,
            starts=said.starts,
            clock_ahead_s=_rounded(ahead_s, 1),
            clock_doubt_s=_rounded(doubt_s, 1),
            clock_error_s=said.clock_error_s,
            range_m=said.range_m,
            same_schedule=said.schedule == here.schedule,
        )


class _Ping:
    """A ping that waits for its answer."""

    def __init__(self, held: HeldQuery, node: int, within_s: float, asked_at: int) -> None:
        self.held = held
        self.node = node
        self.within_s = within_s
        self.asked_at = asked_at
        self.round_trip_s: float | None = None
        """Of the node's own answer; None: it has not answered, or was not asked."""
        self.status: NodeStatus | None = None
        """Its reported status; None: it reports none."""
        self.status_age_s: float | None = None
        """Age of the status on arrival, s; None: unknown."""
        self.answered_at = 0
        """Instant of its arrival, ns."""


def _rounded(value: float | None, digits: int = 3) -> float | None:
    return None if value is None else round(value, digits)
