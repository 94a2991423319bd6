"""The goals of a node at its End, a Zenoh network.

`zacoustic.zenoh.session.asking.goals` defines the messages.
"""

import logging
import time
from collections.abc import Callable
from typing import Any, Final

import zenoh

from zacoustic.errors import LinkClosedError, PayloadInvalidError
from zacoustic.zenoh.ends.goals import GivenGoal, GoalClient, GoalHandler
from zacoustic.zenoh.ends.zenohclients import ZenohClients
from zacoustic.zenoh.ends.zenohservers import ZenohServers
from zacoustic.zenoh.node.form import Form
from zacoustic.zenoh.node.goals import SentGoals
from zacoustic.zenoh.node.onzenoh.queries import serve_queries
from zacoustic.zenoh.node.onzenoh.session import zenoh_errors
from zacoustic.zenoh.node.routes import ActionRoute
from zacoustic.zenoh.session.asking.goals import ActionKey, ActionMessages, Ending
from zacoustic.zenoh.session.session import ZenohSession

QUERIES_LIMIT: Final = 256
"""Most queries about the goals of one action that are held at once."""
_CLOSED_TEXT: Final = "the action server was closed"
# A restarted gateway is back after some seconds.
_PATIENCE_S: Final = 120.0

_logger = logging.getLogger(__name__)

Route = ActionRoute[Any, Any, Any]
Keep = Callable[[Callable[[], None]], Callable[[], None]]
"""Remembers how to end a declaration; returns a function that ends it once."""


class ZenohGoals:
    """The goals that this node has sent, and those that it executes.

    Args:
        zenoh_session: Returns the session.
        keep: Remembers how to end a declaration.
    """

    def __init__(self, zenoh_session: Callable[[], ZenohSession], keep: Keep) -> None:
        self.sent = SentGoals(self._give)
        """The goals that this node has sent."""
        self._zenoh_session = zenoh_session
        self._keep = keep
        self._servers: list[tuple[Route, ZenohServers]] = []

    def serve(self, route: Route, handler: GoalHandler) -> Callable[[], None]:
        """Declare the queryable of an action."""
        zenoh_session, messages = self._zenoh_session(), ProgramMessages(route)

        def put(which: ActionKey, payload: bytes) -> None:
            zenoh_session.put(
                messages.key(which),
                payload,
                encoding=messages.encoding,
                priority=route.qos.priority,
            )

        clients = ZenohClients(
            messages,
            handler,
            put=put,
            keep_s=route.result_timeout_s,
            clock=time.monotonic_ns,
            takes_marked=True,
        )
        end = serve_queries(
            zenoh_session,
            *messages.served(),
            serve=clients.take,
            limit=QUERIES_LIMIT,
            closed_text=_CLOSED_TEXT,
        )
        return self._keep(end)

    def close(self) -> None:
        """Inform the waiting callers that no answer will come."""
        for _, servers in self._servers:
            servers.close()
        self.sent.end_all(LinkClosedError("the node was closed"))

    def _give(
        self,
        route: Route,
        value: object,
        client: GoalClient,
        *,
        timeout_s: float | None,
        tag: bytes,
    ) -> GivenGoal:
        limit_s = route.timeout_s if timeout_s is None else min(timeout_s, route.timeout_s)
        return self._servers_of(route).give(value, client, limit_s=limit_s)

    def _servers_of(self, route: Route) -> ZenohServers:
        """Return the servers of an action; the first time, subscribe to their feedback."""
        for known, servers in self._servers:
            if (known.name, known.qos, _types(known)) == (route.name, route.qos, _types(route)):
                return servers
        zenoh_session = self._zenoh_session()
        servers = ZenohServers(
            zenoh_session,
            route.name,
            ProgramMessages(route),
            priority=route.qos.priority,
            patience_s=min(route.result_timeout_s, _PATIENCE_S),
            complain=lambda name, word, text: _logger.warning("%s: %s: %s", name, word, text),
            hears_marked=True,
        )
        with zenoh_errors(route.name):
            subscriber = zenoh_session.session.declare_subscriber(
                zenoh.KeyExpr(servers.form.key(ActionKey.FEEDBACK)),
                zenoh_session.callback(servers.hear),
                allowed_origin=zenoh.Locality.REMOTE,
            )
        self._servers.append((route, servers))
        self._keep(subscriber.undeclare)
        return servers


class ProgramMessages(ActionMessages):
    """The messages of a program, whose values may be anything.

    Args:
        route: The action.
    """

    def __init__(self, route: Route) -> None:
        super().__init__(
            route.name, route.goal.spec, route.feedback.spec, route.result.spec, route.encoding
        )
        self._route = route
        self._forms = {ActionKey.SEND_GOAL: route.goal, ActionKey.FEEDBACK: route.feedback}

    def write_asked(self, which: ActionKey, goal_id: bytes, value: object = None) -> bytes:
        """Check the value, and write a query or feedback."""
        form = self._forms.get(which)
        return super().write_asked(which, goal_id, value if form is None else _checked(form, value))

    def write_ending(self, ending: Ending) -> bytes:
        """Check the result, and write the answer to `GET_RESULT`."""
        if ending.result is None:
            return super().write_ending(ending)
        result = _checked(self._route.result, ending.result)
        return super().write_ending(Ending(status=ending.status, result=result, text=ending.text))


def _types(route: Route) -> tuple[object, ...]:
    return route.goal.spec, route.feedback.spec, route.result.spec, route.encoding


def _checked(form: Form[Any], value: object) -> object:
    """Return a value in the form of a message: a dict, or bytes.

    Raises:
        PayloadInvalidError: The type does not allow the value, or it is opaque and not bytes.
    """
    if form.spec is not None:
        return form.spec.validate(value)
    if not isinstance(value, bytes | bytearray | memoryview):
        raise PayloadInvalidError(f"{type(value).__name__} in an opaque action; allowed: bytes")
    return bytes(value)
