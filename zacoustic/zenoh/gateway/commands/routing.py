"""Commands about routes that the local network gives; the gateway executes or sends them."""

from functools import partial

import msgspec

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailed, CallFailure
from zacoustic.core.values.encoding import JSON
from zacoustic.core.wire.routing import RoutingAnswer
from zacoustic.errors import LocalError
from zacoustic.run.pending import CallEnd, Pending
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.gateway.commands.refusing import refuse_failed
from zacoustic.zenoh.gateway.redundant import RedundantGateways
from zacoustic.zenoh.session.asking.commands import PREFIX, node_in
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery
from zacoustic.zenoh.session.asking.routing import (
    ROUTING,
    RoutingAsked,
    RoutingReport,
    read_routing,
)


class RoutingHandler:
    """Takes commands about routes of the local network; for the loop.

    Args:
        runner: Runs the engine that executes or sends them.
        redundant: The local gateways.
        ends: The calls of the gateway.
    """

    def __init__(
        self, runner: LinkRunner, redundant: RedundantGateways, ends: Pending[CallEnd]
    ) -> None:
        self._runner = runner
        self._redundant = redundant
        self._ends = ends

    @property
    def key(self) -> str:
        """Key expression of these commands."""
        return ROUTING

    def serve(self, held: HeldQuery) -> None:
        """Take a query."""
        key, parameters = held.key, held.parameters
        if key == ROUTING and "do" in parameters:  # each gateway answers for its own node
            key = f"{PREFIX}/{self._redundant.address}/routing"
        node = node_in(key, "routing")
        if node is None or not self._is_ours(node):
            held.answer([])
            return
        try:
            asked = read_routing(key, parameters)
            assert asked is not None
            self._runner.apply(partial(self._begin, held, asked))
        except (ValueError, LocalError) as error:
            held.refuse(CallFailure.BAD_REQUEST, str(error))

    # Below the method above

    def _is_ours(self, node: int) -> bool:
        """Return whether this one of the local gateways executes or sends it."""
        return self._redundant.asks(node)

    def _begin(self, held: HeldQuery, asked: RoutingAsked, engine: Engine, now: int) -> None:
        if asked.node == engine.address:
            then = partial(self._answer, held, asked)
            engine.routing.execute(asked.request, now, lambda answer, at: then(answer))
            return
        call_id = engine.routing.send(asked.node, asked.request, now, timeout_s=asked.within_s)
        self._ends.add(call_id, partial(self._answered, held, asked))

    def _answered(self, held: HeldQuery, asked: RoutingAsked, end: CallEnd) -> None:
        if isinstance(end, CallFailed):
            maybe = "may have executed it" if asked.request.changes else ""
            refuse_failed(held, end, asked.node, maybe=maybe)
            return
        try:
            answer = RoutingAnswer.decode(asked.request.kind, end.value)
        except ValueError as error:
            held.refuse(CallFailure.BAD_RESPONSE, str(error))
        else:
            self._answer(held, asked, answer)

    def _answer(self, held: HeldQuery, asked: RoutingAsked, answer: RoutingAnswer) -> None:
        engine = self._runner.engine
        report = RoutingReport(
            address=asked.node,
            by=engine.address,
            sent_s=round(ns_to_seconds(engine.stats.airtime_ns), 3),
            **msgspec.structs.asdict(answer),
        )
        key = f"{PREFIX}/{asked.node}/routing"
        held.answer([Answer(key=key, payload=msgspec.json.encode(report), encoding=JSON)])
