"""A ping: ``@acoustic/2/ping?within_s=30``: does a node answer, how fast, how far away is it?

The local gateway asks node 2 whether it is silent (a command that changes nothing,
`zacoustic.core.transport.commands`): any answer, also a refusal, shows that its engine runs, not
only its modem. Then, if the modem measures ranges and has reported none on those frames, the
gateway asks for one: after the answer, because a modem that waits for an acknowledgement cannot
receive it. A wire profile without remote commands gives only the range. With ``status=true`` the
gateway asks for the node's status instead of its silence (`zacoustic.core.transport.status`):
journal, clock and medium access.
"""

from functools import partial
from typing import TYPE_CHECKING, Final

import msgspec

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.linktypes import LinkMetrics, LinkState
from zacoustic.core.engine.events import CallFailed, CallFailure, ResponseReceived
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.core.streams.commands import COMMANDS_TIMEOUT_S, RemoteCommand
from zacoustic.core.streams.status import STATUS_STREAM_ID, NodeStatus
from zacoustic.errors import LocalError, RangeUnavailableError
from zacoustic.run.pending import CallEnd
from zacoustic.zenoh.requests.context import Asking
from zacoustic.zenoh.requests.request import FLAG, Request

if TYPE_CHECKING:
    from zacoustic.core.engine.engine import Engine

LINK_DOWN: Final = "the link is down"
"""Within the text of an error: nothing could be sent when the time was over."""
RANGE_LIMIT_S: Final = 10.0
"""Additional time for an answer with the range, s: three exchanges over 1500 m."""
_ROUNDING_S: Final = 1.0
"""Both clocks report whole seconds."""
_AGE_STEP: Final = 0.05
"""Relative error of an age."""


class PingAsked(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A ping."""

    status: bool = False
    """Whether to request the node's status."""


class PeerStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The status that a node reports, compared with the asking gateway."""

    journal: str
    """`kept`; `none`; `doubted`: damaged, or an old copy; `failing`: it cannot be written now."""
    starts: int
    """Starts of the node that its journal has recorded, including this one; 0: none."""
    clock_ahead_s: float | None = None
    """How far its clock is ahead of the gateway's, s; None: one of the two is unknown."""
    clock_doubt_s: float | None = None
    """Uncertainty of that comparison, s."""
    clock_error_s: float | None = None
    """Largest error of its clock as it reports it, s; None: nothing synchronises the clock."""
    range_m: int | None = None
    """Range to this node as the other node's modem has measured it, m."""
    same_schedule: bool = True
    """Its slots or turns are the same as here."""


class PingAnswer(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a ping."""

    address: int
    """Address of the pinged node."""
    by: int
    """Address of the pinging node."""
    round_trip_s: float | None = None
    """Time from the query, through queue and channel, to the node's answer; None: the wire profile
    has no such query, and only the range was measured."""
    propagation_s: float | None = None
    """One way, s, as the modem measured it last; None: it measures none."""
    range_m: float | None = None
    """Slant distance, m; None: the modem knows no sound speed."""
    range_age_s: float | None = None
    """Age of that measurement, s."""
    snr_db: float | None = None
    """Signal-to-noise ratio of its last frame, dB."""
    received_level_db: float | None = None
    """Received level, dB, by the modem's own reference."""
    integrity: float | None = None
    """Signal quality in the modem's own scale."""
    status: PeerStatus | None = None
    """The node's reported status; None: not requested, or refused."""

    def text(self) -> str:
        """Return it in words."""
        words = []
        if self.round_trip_s is not None:
            words.append(f"round trip {self.round_trip_s:.2f} s")
        if self.range_m is not None:
            words.append(f"{self.range_m:.1f} m")
        if self.propagation_s is not None:
            words.append(f"{self.propagation_s:.3f} s one way")
        if self.range_age_s is not None and self.range_age_s > (self.round_trip_s or 0.0) + 1:
            words.append(f"measured {self.range_age_s:.0f} s ago")
        for value, form in (
            (self.snr_db, "SNR {:.1f} dB"),
            (self.received_level_db, "level {:.1f} dB"),
            (self.integrity, "integrity {:.0f}"),
        ):
            if value is not None:
                words.append(form.format(value))
        return f"node {self.address} by {self.by}: {', '.join(words)}"


class _Ping:
    """A ping under way: the node's answer, then the range.

    Args:
        asking: The request.
        asked_at: Instant of its begin, ns.
    """

    def __init__(self, asking: Asking[PingAsked, PingAnswer], asked_at: int) -> None:
        self._asking = asking
        self._context = asking.context
        self._node = asking.node
        self._asked_at = asked_at
        self._round_trip_s: float | None = None
        self._status: NodeStatus | None = None
        self._status_age_s: float | None = None
        self._answered_at = 0

    def begin(self, engine: "Engine", now: int) -> None:
        """Ask the node; if this wire has no such query, ask for the range only."""
        node, within_s = self._node, self._asking.within_s
        try:
            if self._asking.question.status and engine.status.is_carried:
                call_id = engine.status.ask(node, now, timeout_s=within_s)
            else:
                call_id = engine.commands.send(node, RemoteCommand(), now, timeout_s=within_s)
        except LocalError as error:
            if not self._range(within_s, engine, now):
                raise LocalError(f"{error}, and the modem measures no range") from None
        else:
            self._context.ends.add(call_id, self.take)

    def take(self, end: CallEnd) -> None:
        """Take the node's answer."""
        if isinstance(end, CallFailed) and end.failure is not CallFailure.HANDLER:
            if end.failure is CallFailure.TIMED_OUT and (why := self._why_down()):
                self._asking.refuse(end.failure, f"node {self._node} has not answered: {why}")
            else:
                self._asking.fail(end)
            return
        now = self._context.clock()
        if isinstance(end, ResponseReceived) and end.stream_id == STATUS_STREAM_ID:
            self._status, self._status_age_s = NodeStatus.from_wire(end.value), end.age_s
            self._answered_at = now
        self._round_trip_s = ns_to_seconds(now - self._asked_at)
        left_s = min(self._asking.within_s - self._round_trip_s, RANGE_LIMIT_S)
        known = self._context.engine.measurements.range(self._node)
        has_range = known is not None and known.measured_at >= self._asked_at
        if has_range or left_s <= 0 or not self._context.runner.apply(partial(self._range, left_s)):
            self._answer()

    # Below the methods above

    def _why_down(self) -> str:
        """Return that no link is up, and why; empty: one is."""
        sides = self._context.runner.sides
        if any(side.state is LinkState.UP for side in sides):
            return ""
        return ", ".join([LINK_DOWN, *(side.detail for side in sides if side.detail)])

    def _range(self, within_s: float, engine: "Engine", now: int) -> bool:
        """Ask for the range; False: it cannot be measured."""
        try:
            range_id = engine.ranging.request(self._node, now, timeout_s=within_s)
        except (LocalError, RangeUnavailableError):
            return False
        self._context.ranges.add(range_id, self._take_range)
        return True

    def _take_range(self, event: RangeMeasured | RangeFailed) -> None:
        if isinstance(event, RangeFailed) and self._round_trip_s is None:
            self._asking.refuse(CallFailure.TIMED_OUT, event.text)
        else:
            self._answer()

    def _answer(self) -> None:
        engine, known = self._context.engine, self._context.engine.measurements
        metrics = known.metrics(self._node) or LinkMetrics()
        answer = PingAnswer(
            address=self._node,
            by=engine.address,
            round_trip_s=_rounded(self._round_trip_s),
            snr_db=metrics.snr_db,
            received_level_db=metrics.received_level_db,
            integrity=metrics.integrity,
        )
        if measured := known.range(self._node):
            answer = msgspec.structs.replace(
                answer,
                propagation_s=_rounded(measured.propagation_s, 6),
                range_m=_rounded(measured.range_m),
                range_age_s=_rounded(measured.age_s(self._context.clock())),
            )
        if self._status is not None:
            status = self._compared(self._status, answer.propagation_s)
            answer = msgspec.structs.replace(answer, status=status)
        self._asking.answer(answer)

    def _compared(self, said: NodeStatus, propagation_s: float | None) -> PeerStatus:
        """Return the reported status of the node, compared with the values here."""
        here, age_s = self._context.engine.status.own(self._answered_at), self._status_age_s
        ahead_s = doubt_s = None
        if said.utc_s is not None and here.utc_s is not None and age_s is not None:
            # If no range is known, the status was at most half of the round trip on its way.
            unknown_s = (self._round_trip_s or 0.0) / 2 if propagation_s is None else 0.0
            ahead_s = said.utc_s + age_s - here.utc_s
            doubt_s = _ROUNDING_S + age_s * _AGE_STEP + unknown_s
        return PeerStatus(
            journal=said.journal.value,
            starts=said.starts,
            clock_ahead_s=_rounded(ahead_s, 1),
            clock_doubt_s=_rounded(doubt_s, 1),
            clock_error_s=said.clock_error_s,
            range_m=said.range_m,
            same_schedule=said.schedule == here.schedule,
        )


def _begin(asking: Asking[PingAsked, PingAnswer], engine: "Engine", now: int) -> None:
    _Ping(asking, now).begin(engine, now)


def _rounded(value: float | None, digits: int = 3) -> float | None:
    return None if value is None else round(value, digits)


PING: Final = Request(
    subject="ping",
    parameters={"status": FLAG},
    make=PingAsked,
    answer=PingAnswer,
    begin=_begin,
    within_s=30.0,
    most_s=COMMANDS_TIMEOUT_S,
    not_here="there is no channel between",
)
"""Pings a remote node."""
