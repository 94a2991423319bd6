"""The Zenoh session of a node, and the router that it joins.

A node is never a router: it joins the running one. So from a file that configures a router it takes
the address at which that router listens, and all other settings (TLS, namespace, …) unchanged.
"""

import contextlib
import json
import re
from collections.abc import Iterator, Sequence
from typing import Final

import zenoh

from zacoustic.config import Config
from zacoustic.errors import LocalError, SessionError
from zacoustic.zenoh.session.latching import stamp_samples
from zacoustic.zenoh.session.session import HERE, endpoints_of, listen_here, mode_of, one_line

CONNECT_TIMEOUT_MS: Final = 3000
"""How long `open` waits for the router, ms: node and gateway often start together."""

_ANY_ADDRESS: Final = re.compile(r"(?<=/)(0\.0\.0\.0|\[::\])(?=:)")


def session_config(config: Config | None, connect: str | Sequence[str] | None) -> zenoh.Config:
    """Return the settings of a node's session.

    Args:
        config: The node's configuration; its file may be the router's.
        connect: Endpoints, which override the configuration's.

    Raises:
        SessionError: An endpoint is not valid.
    """
    file = config.zenoh_config if config is not None else None
    # Parsed from its own text, the config is a copy; the original stays as it is.
    settings = zenoh.Config() if file is None else zenoh.Config.from_json5(str(file))
    if connect is not None:
        endpoints = (connect,) if isinstance(connect, str) else tuple(connect)
    elif mode_of(settings) == "router":
        listen_here(settings)  # so does the gateway of this file
        endpoints = endpoints_of(settings, "listen") or HERE["router"]
    else:
        endpoints = endpoints_of(settings, "connect")
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
        stamp_samples(settings)
    except zenoh.ZError as error:
        raise SessionError(f"{', '.join(endpoints)}: {one_line(error)}") from error
    return settings


def _loopback(found: re.Match[str]) -> str:
    return "127.0.0.1" if found[0] == "0.0.0.0" else "[::1]"


@contextlib.contextmanager
def zenoh_errors(name: str) -> Iterator[None]:
    """Turn Zenoh's errors about a key into a `LocalError`."""
    try:
        yield
    except zenoh.ZError as error:
        raise LocalError(f"{name}: {one_line(error)}") from error
