"""The requests of the local network to a gateway: who takes each, and its errors."""

from functools import partial
from typing import Any

import zenoh

from zacoustic.core.engine.events import CallFailure
from zacoustic.errors import LocalError
from zacoustic.zenoh.gateway.redundant import RedundantGateways
from zacoustic.zenoh.gateway.status.health import Health
from zacoustic.zenoh.requests.context import Asking, RequestContext
from zacoustic.zenoh.requests.report import REPORT
from zacoustic.zenoh.requests.request import Request
from zacoustic.zenoh.requests.table import REQUESTS
from zacoustic.zenoh.session.asking.queries import HeldQuery, QueryHandler
from zacoustic.zenoh.session.session import ZenohSession


class RequestHandler:
    """Takes the requests to one gateway; for the loop, except for `declare` and `undeclare`.

    Args:
        context: The gateway, for engine calls.
        redundant: The local gateways.
        health: Answers with the current state.
    """

    def __init__(
        self, context: RequestContext, redundant: RedundantGateways, health: Health
    ) -> None:
        self.context = context
        self._redundant = redundant
        self._health = health
        self._declared: list[zenoh.Queryable[None]] = []

    def declare(self, zenoh_session: ZenohSession, queries: QueryHandler) -> None:
        """Declare the queryables; in the worker."""
        # Only this gateway has its own documents.
        places = [(REPORT.key(self._redundant.address), self._health.answer, True)]
        # Not complete: for a local node only that node's gateway answers.
        places += [(each.expression, partial(self._serve, each), False) for each in REQUESTS]
        for expression, serve, is_complete in places:
            queryable = zenoh_session.session.declare_queryable(
                zenoh.KeyExpr(expression),
                zenoh_session.callback(partial(queries.admit, serve)),
                complete=is_complete,
                allowed_origin=zenoh.Locality.REMOTE,
            )
            self._declared.append(queryable)

    def undeclare(self) -> None:
        """Undeclare them; in the worker."""
        while self._declared:
            self._declared.pop().undeclare()  # type: ignore[no-untyped-call]

    def _serve(self, request: Request[Any, Any], held: HeldQuery) -> None:
        """Take a query; an error reply goes out only if this gateway has to answer."""
        key, parameters = held.key, held.parameters
        target = request.target(key, parameters)
        if target is None or not self._is_ours(request, target[0]):
            held.answer([])
            return
        node = self._redundant.address if target[0] is None else target[0]
        try:
            question, within_s = request.read(key, target[1], parameters)
            if request.not_here and node in self._redundant.alive:
                raise ValueError(f"node {node} is on this local network: {request.not_here}")
            asking: Asking[Any, Any] = Asking(
                self.context,
                node,
                question,
                within_s,
                answer=partial(_answer, held, node),
                refuse=held.refuse,
            )
            self.context.runner.apply(partial(request.begin, asking))
        except (ValueError, LocalError) as error:
            held.refuse(CallFailure.BAD_REQUEST, str(error))

    def _is_ours(self, request: Request[Any, Any], node: int | None) -> bool:
        if request.is_own:
            return node in (None, self._redundant.address)
        return node is None or self._redundant.asks(node)


def _answer(held: HeldQuery, node: int, answer: object) -> None:
    """Answer, under the concrete key."""
    prefix, _, *subject = held.key.split("/")
    held.answer_json("/".join((prefix, str(node), *subject)), answer)
