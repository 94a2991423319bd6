"""Pings from the island: is the node there, how long does an answer take, how far away is it?

Two questions in one frame. The node itself is asked whether it is silent (an order that changes
nothing, `zacoustic.core.orders`): what comes back says that its engine lives, not only its modem,
and a refusal says so as well. Where the modem measures ranges one is asked for as well; the frame
with the question is then acknowledged by the other modem, and its delay measured, for no byte more.
Where the wire knows no orders the range alone has to do.
"""

from collections.abc import Iterable
from functools import partial
from typing import cast

import msgspec

from zacoustic.core.clock import Clock, ns_to_seconds
from zacoustic.core.encoding import JSON
from zacoustic.core.engine import Engine
from zacoustic.core.events import CallFailed, CallFailure, ResponseReceived
from zacoustic.core.orders.words import Order
from zacoustic.core.ranging import RangeFailed, RangeMeasured
from zacoustic.errors import LocalError, RangeUnavailableError
from zacoustic.gateway.siblings import Siblings
from zacoustic.island.pings import PINGS, PingAnswer, ping_selector, read_ping
from zacoustic.island.queries import Answer, HeldQuery
from zacoustic.runtime import LinkRunner


class PingDesk:
    """Takes pings of the island; for the loop.

    Args:
        runner: Whose engine asks.
        siblings: The gateways of this island.
        clock: Where instants come from.
    """

    def __init__(self, runner: LinkRunner, siblings: Siblings, *, clock: Clock) -> None:
        self._runner = runner
        self._siblings = siblings
        self._clock = clock
        self._by_call: dict[int, _Ping] = {}
        self._by_range: dict[int, _Ping] = {}

    @property
    def key(self) -> str:
        """Where nodes are pinged."""
        return PINGS

    def serve(self, held: HeldQuery) -> None:
        """Take a query."""
        # Zenoh's stubs do not say that they can be iterated over.
        parameters = cast("Iterable[tuple[str, str]]", held.query.parameters)
        try:
            asked = read_ping(str(held.query.key_expr), dict(parameters))
        except ValueError as error:
            held.refuse(CallFailure.BAD_REQUEST, str(error))
            return
        if asked is None or not self._is_ours(asked[0]):
            held.answer([])
            return
        node, within_s = asked
        if node in self._siblings.alive:
            text = f"node {node} is on this island: there is no water between"
            held.refuse(CallFailure.BAD_REQUEST, text)
            return
        self._runner.apply(partial(self._begin, held, node, within_s))

    def has_sent(self, call_id: int) -> bool:
        """Tell whether a call is a ping."""
        return call_id in self._by_call

    def has_asked(self, range_id: int | None) -> bool:
        """Tell whether a range belongs to a ping."""
        return range_id in self._by_range

    def answered(self, event: ResponseReceived | CallFailed) -> None:
        """The node has answered, or not."""
        ping = self._by_call.pop(event.call_id)
        # What its modem has not measured until now is not waited for.
        if self._by_range.pop(ping.range_id, None) is not None:
            self._runner.apply(lambda engine, now: engine.ranging.cancel(ping.range_id))
        if isinstance(event, CallFailed) and event.failure is not CallFailure.HANDLER:
            text = event.text
            if event.failure is CallFailure.TIMED_OUT:
                text = f"node {ping.node} has not answered in time"
            ping.held.refuse(event.failure, text)
            return
        self._answer(ping, round_trip_s=ns_to_seconds(self._clock() - ping.asked_at))

    def ranged(self, event: RangeMeasured | RangeFailed) -> None:
        """A range is there, or will not come."""
        assert event.range_id is not None
        ping = self._by_range.pop(event.range_id)
        if ping.is_called:
            return  # the answer of the node itself is still awaited
        if isinstance(event, RangeFailed):
            ping.held.refuse(CallFailure.TIMED_OUT, event.text)
            return
        self._answer(ping, round_trip_s=None)

    # Below the methods above

    def _is_ours(self, node: int) -> bool:
        """Tell whether this gateway is to ask, of those on the island."""
        nodes = self._runner.engine.table.nodes
        is_known = 1 <= node <= 254 and (not nodes or node in nodes)
        return is_known and self._siblings.address == self._siblings.alive[0]

    def _begin(self, held: HeldQuery, node: int, within_s: float, engine: Engine, now: int) -> None:
        ping = _Ping(held, node, now)
        try:
            ping.range_id = engine.ranging.request(node, now, timeout_s=within_s)
            self._by_range[ping.range_id] = ping
        except (LocalError, RangeUnavailableError):
            pass  # no range: the answer says so
        try:
            call_id = engine.orders.send(node, Order(), now, timeout_s=within_s)
        except LocalError as error:
            if ping.range_id not in self._by_range:
                held.refuse(CallFailure.BAD_REQUEST, f"{error}, and the modem measures no range")
            return
        ping.is_called = True
        self._by_call[call_id] = ping

    def _answer(self, ping: "_Ping", *, round_trip_s: float | None) -> None:
        known = self._runner.engine.measurements
        found = PingAnswer(
            address=ping.node, by=self._runner.engine.address, round_trip_s=_rounded(round_trip_s)
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
        key, _ = ping_selector(ping.node, 1)
        ping.held.answer([Answer(key=key, payload=msgspec.json.encode(found), encoding=JSON)])


class _Ping:
    """One that waits for its answer."""

    def __init__(self, held: HeldQuery, node: int, asked_at: int) -> None:
        self.held = held
        self.node = node
        self.asked_at = asked_at
        self.range_id = 0
        """Of the range that was asked for; 0: none."""
        self.is_called = False
        """The node itself was asked."""


def _rounded(value: float | None, digits: int = 3) -> float | None:
    return None if value is None else round(value, digits)
