"""What is asked of the gateway itself, and where: commands, pings, objects, its own health."""

from functools import partial

import zenoh

from zacoustic.core.engine.events import CallFailed, ResponseReceived
from zacoustic.zenoh.gateway.commands.objects import ObjectDesk
from zacoustic.zenoh.gateway.commands.orders import OrderDesk
from zacoustic.zenoh.gateway.commands.pings import PingDesk
from zacoustic.zenoh.gateway.status.health import Health
from zacoustic.zenoh.session.asking.queries import QueryDesk, Serve
from zacoustic.zenoh.session.session import Island


class Desks:
    """The desks of one gateway; for the loop, except for `declare` and `undeclare`.

    Args:
        objects: Gives large samples up.
        orders: Takes commands.
        pings: Takes pings.
        health: Answers what holds now.
    """

    def __init__(
        self, objects: ObjectDesk, orders: OrderDesk, pings: PingDesk, health: Health
    ) -> None:
        self.objects = objects
        self.orders = orders
        self.pings = pings
        self._health = health
        self._declared: list[zenoh.Queryable[None]] = []

    def take_answer(self, event: ResponseReceived | CallFailed) -> bool:
        """Take the answer to a command or a ping; False: it is one of a service."""
        return self.orders.answered(event) or self.pings.answered(event)

    def declare(self, island: Island, queries: QueryDesk) -> None:
        """Declare where the gateway is asked; in the worker."""
        for expression, serve, complete in self._places():
            queryable = island.session.declare_queryable(
                zenoh.KeyExpr(expression),
                island.callback(partial(queries.admit, serve)),
                complete=complete,
                allowed_origin=zenoh.Locality.REMOTE,
            )
            self._declared.append(queryable)

    def undeclare(self) -> None:
        """Be asked no more; in the worker."""
        while self._declared:
            self._declared.pop().undeclare()  # type: ignore[no-untyped-call]

    def _places(self) -> tuple[tuple[str, Serve, bool], ...]:
        return (
            (self._health.expression, self._health.answer, True),
            (self.objects.key, self.objects.serve, True),
            *((key, self.orders.serve, True) for key in self.orders.own_keys),
            # Not complete: the gateway of a local node answers alone.
            *((key, self.orders.serve_beyond, False) for key in self.orders.keys_beyond),
            (self.pings.key, self.pings.serve, False),
        )
