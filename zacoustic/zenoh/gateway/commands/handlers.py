"""Declares the keys for requests to the gateway: commands, pings, keys, routes, objects, health."""

from functools import partial

import zenoh

from zacoustic.zenoh.gateway.commands.keydelivery import KeyHandler
from zacoustic.zenoh.gateway.commands.objects import ObjectHandler
from zacoustic.zenoh.gateway.commands.pings import PingHandler
from zacoustic.zenoh.gateway.commands.remote import CommandHandler
from zacoustic.zenoh.gateway.commands.routing import RoutingHandler
from zacoustic.zenoh.gateway.status.health import Health
from zacoustic.zenoh.session.asking.queries import QueryHandler, Serve
from zacoustic.zenoh.session.session import ZenohSession


class Handlers:
    """The handlers of one gateway; for the loop, except for `declare` and `undeclare`.

    Args:
        objects: Cancels large samples.
        commands: Takes commands.
        pings: Takes pings.
        keys: Takes deliveries of keys.
        routing: Takes commands about routes.
        health: Answers with the current state.
    """

    def __init__(
        self,
        objects: ObjectHandler,
        commands: CommandHandler,
        pings: PingHandler,
        keys: KeyHandler,
        routing: RoutingHandler,
        health: Health,
    ) -> None:
        self.objects = objects
        self.commands = commands
        self.pings = pings
        self._keys = keys
        self._routing = routing
        self._health = health
        self._declared: list[zenoh.Queryable[None]] = []

    def declare(self, zenoh_session: ZenohSession, queries: QueryHandler) -> None:
        """Declare the queryables; in the worker."""
        for expression, serve, complete in self._places():
            queryable = zenoh_session.session.declare_queryable(
                zenoh.KeyExpr(expression),
                zenoh_session.callback(partial(queries.admit, serve)),
                complete=complete,
                allowed_origin=zenoh.Locality.REMOTE,
            )
            self._declared.append(queryable)

    def undeclare(self) -> None:
        """Undeclare them; in the worker."""
        while self._declared:
            self._declared.pop().undeclare()  # type: ignore[no-untyped-call]

    def _places(self) -> tuple[tuple[str, Serve, bool], ...]:
        return (
            (self._health.expression, self._health.answer, True),
            (self.objects.key, self.objects.serve, True),
            *((key, self.commands.serve, True) for key in self.commands.own_keys),
            # Not complete: for a local node only that node's gateway answers.
            *((key, self.commands.serve_beyond, False) for key in self.commands.keys_beyond),
            (self.pings.key, self.pings.serve, False),
            (self._keys.key, self._keys.serve, False),
            (self._routing.key, self._routing.serve, False),
        )
