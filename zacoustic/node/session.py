"""The Zenoh session of a node: which router it joins, and what went wrong in one line.

A node is never a router: it joins the one that is there. So of a file that configures a router it
takes the address at which that router listens, and everything else (TLS, namespace, …) as it is.
"""

import asyncio
import contextlib
import json
import re
import threading
from collections.abc import Sequence
from typing import Final

import zenoh

from zacoustic.config import Config
from zacoustic.errors import SessionError
from zacoustic.node.island import one_line

CONNECT_TIMEOUT_MS: Final = 3000
"""How long opening waits for the router, ms: node and gateway are often started together."""

_DEFAULT_LISTEN: Final = ("tcp/127.0.0.1:7447",)
_ANY_ADDRESS: Final = re.compile(r"(?<=/)(0\.0\.0\.0|\[::\])(?=:)")


async def open_session(config: Config | None, connect: str | Sequence[str] | None) -> zenoh.Session:
    """Open a session off the loop.

    Args:
        config: The node's configuration; its file may be that of the router.
        connect: Endpoints, which count more than those of the configuration.

    Raises:
        SessionError: No router is reached, or an endpoint is none.
    """
    settings, endpoints = _settings(config, connect)
    abandoned = threading.Event()

    def open_or_abandon() -> zenoh.Session:
        session = zenoh.open(settings)
        if abandoned.is_set():
            close_session(session)
        return session

    opening = asyncio.get_running_loop().run_in_executor(None, open_or_abandon)
    try:
        return await asyncio.shield(opening)
    except asyncio.CancelledError:
        abandoned.set()  # the thread cannot be stopped
        opening.add_done_callback(_abandon)
        raise
    except zenoh.ZError as error:
        where = ", ".join(endpoints) or "the Zenoh network"
        reason = one_line(error)
        if reason.startswith(("Unable to connect", "Timeout")):
            reason = "no router answers"
        raise SessionError(
            f"{where}: {reason}", hint="start the router or the gateway, or correct the endpoint"
        ) from error


def _settings(
    config: Config | None, connect: str | Sequence[str] | None
) -> tuple[zenoh.Config, tuple[str, ...]]:
    """Return the session's own config, and the endpoints that it connects to."""
    file = config.zenoh_config if config is not None else None
    # The text of a config is one again; so the original stays as it is.
    settings = zenoh.Config() if file is None else zenoh.Config.from_json5(str(file))
    mode = str(_setting(settings, "mode") or "peer")
    if connect is not None:
        endpoints = (connect,) if isinstance(connect, str) else tuple(connect)
    else:
        endpoints = _endpoints(settings, "connect", mode)
        if mode == "router":
            endpoints = _endpoints(settings, "listen", mode) or _DEFAULT_LISTEN
    endpoints = tuple(_ANY_ADDRESS.sub(_loopback, endpoint) for endpoint in endpoints)
    values: dict[str, object] = {"listen/endpoints": []}
    if endpoints:
        values["mode"] = "client"
        values["connect/endpoints"] = list(endpoints)
        values["connect/timeout_ms"] = CONNECT_TIMEOUT_MS
        values["scouting/multicast/enabled"] = False
    elif file is None:
        values.clear()
    try:
        for key, value in values.items():
            settings.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise SessionError(f"{', '.join(endpoints)}: {one_line(error)}") from error
    return settings, endpoints


def _loopback(found: re.Match[str]) -> str:
    return "127.0.0.1" if found[0] == "0.0.0.0" else "[::1]"


def _endpoints(settings: zenoh.Config, word: str, mode: str) -> tuple[str, ...]:
    endpoints = _setting(settings, f"{word}/endpoints")
    if isinstance(endpoints, dict):
        endpoints = endpoints.get(mode)
    return tuple(endpoints) if isinstance(endpoints, list) else ()


def _setting(settings: zenoh.Config, key: str) -> object:
    with contextlib.suppress(zenoh.ZError, ValueError):
        return json.loads(settings.get_json(key))
    return None


def _abandon(opening: "asyncio.Future[zenoh.Session]") -> None:
    if not opening.cancelled() and opening.exception() is None:
        close_session(opening.result())


def close_session(session: zenoh.Session) -> None:
    """Close a session; takes some milliseconds, and ends the threads of its callbacks."""
    session.close()  # type: ignore[no-untyped-call]
