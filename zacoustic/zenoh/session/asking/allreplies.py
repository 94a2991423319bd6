"""One question to all local gateways, and all their replies."""

import asyncio
from typing import Final

import msgspec
import zenoh

from zacoustic.core.engine.events import CallFailure
from zacoustic.run.inbox import tell_loop
from zacoustic.zenoh.session.asking.replies import read_error
from zacoustic.zenoh.session.session import ZenohSession

# Zenoh's own time limit is above the gateway's, because the gateway's error says more.
_BEHIND_S: Final = 2.0


class Replies(msgspec.Struct):
    """The replies to one question, in the order of their arrival."""

    answers: list[tuple[str, bytes]] = []
    """Keys and payloads of the good ones."""
    failures: list[tuple[CallFailure, str]] = []
    """The errors."""


async def ask_all(
    zenoh_session: ZenohSession,
    key: str,
    parameters: str = "",
    *,
    timeout_s: float,
    is_first_enough: bool = False,
) -> Replies:
    """Query a key expression, and wait for the last reply.

    Args:
        zenoh_session: A session on the local network.
        key: The key expression.
        parameters: Of the query.
        timeout_s: How long to wait, s.
        is_first_enough: Wait for the first good reply only.

    Raises:
        ZError: It cannot be sent.
    """
    loop = asyncio.get_running_loop()
    found = Replies()
    ended = asyncio.Event()

    def take(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            found.answers.append((str(reply.ok.key_expr), reply.ok.payload.to_bytes()))
            if is_first_enough:
                tell_loop(loop, ended.set)
        elif reply.err is not None:
            payload, encoding = reply.err.payload.to_bytes(), str(reply.err.encoding)
            found.failures.append(read_error(key, payload, encoding))

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
