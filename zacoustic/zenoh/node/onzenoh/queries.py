"""Queryables of a node."""

import asyncio
from collections.abc import Callable
from functools import partial

import zenoh

from zacoustic.run.inbox import WakeUp
from zacoustic.zenoh.node.onzenoh.session import zenoh_errors
from zacoustic.zenoh.session.asking.queries import QueryHandler, Serve
from zacoustic.zenoh.session.session import ZenohSession


def serve_queries(
    zenoh_session: ZenohSession, *keys: str, serve: Serve, limit: int, closed_text: str
) -> Callable[[], None]:
    """Declare a queryable; return the function that ends it, and refuses the queries it holds.

    Args:
        zenoh_session: The session.
        keys: Its key expressions.
        serve: Serves each query, on the loop.
        limit: Most queries held at once.
        closed_text: Error text for callers whose queries are held at the end.

    Raises:
        LocalError: Zenoh refuses the keys.
    """
    bell = WakeUp(asyncio.get_running_loop())
    queries = QueryHandler(zenoh_session.worker, bell.ring, limit=limit, closed_text=closed_text)
    bell.open(queries.serve)
    with zenoh_errors(keys[0]):
        queryable = zenoh_session.session.declare_queryable(
            zenoh.KeyExpr(*keys),
            zenoh_session.callback(partial(queries.admit, serve)),
            complete=True,
            allowed_origin=zenoh.Locality.REMOTE,
        )

    def end() -> None:
        queryable.undeclare()  # type: ignore[no-untyped-call]
        queries.close()

    return end
