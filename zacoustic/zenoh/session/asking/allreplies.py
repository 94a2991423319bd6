"""One question to all local gateways, and all their answers."""

import asyncio
from typing import Final

import zenoh

from zacoustic.run.inbox import tell_loop
from zacoustic.zenoh.session.session import ZenohSession

_BEHIND_S: Final = 1.0


async def ask_all(
    zenoh_session: ZenohSession, key: str, parameters: str = "", *, timeout_s: float
) -> dict[str, bytes]:
    """Query a key expression; return the good answers by their keys.

    Args:
        zenoh_session: A session on the local network.
        key: The key expression.
        parameters: Of the query.
        timeout_s: How long to wait, s.

    Raises:
        ZError: It cannot be sent.
    """
    loop = asyncio.get_running_loop()
    found: dict[str, bytes] = {}
    ended = asyncio.Event()

    def take(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            found[str(reply.ok.key_expr)] = reply.ok.payload.to_bytes()

    def ask() -> None:
        zenoh_session.session.get(
            zenoh.Selector(zenoh.KeyExpr(key), parameters or None),
            zenoh_session.callback(take, lambda: tell_loop(loop, ended.set)),
            timeout=timeout_s + _BEHIND_S,
            consolidation=zenoh.ConsolidationMode.NONE,
            allowed_destination=zenoh.Locality.REMOTE,
        )

    await zenoh_session.worker.run(ask)
    await ended.wait()
    return found
