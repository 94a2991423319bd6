"""A session of an ordinary Zenoh client, and what it sends and takes: CBOR maps."""

import json
from typing import Any, Final

import cbor2
import msgspec
import zenoh

CBOR: Final = "application/cbor"


def open_session(endpoint: str, *, stamps: bool = False) -> zenoh.Session:
    """Open a session as a client of the router at an endpoint.

    Args:
        endpoint: Of the router.
        stamps: It stamps its samples, as nodes of ROS do.
    """
    settings = {
        "timestamping": {"enabled": stamps},
        "mode": "client",
        "connect": {"endpoints": [endpoint], "timeout_ms": 20000},
        "scouting": {"multicast": {"enabled": False}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))


def to_cbor(value: object) -> bytes:
    """Return a record, or a map, as CBOR."""
    return cbor2.dumps(msgspec.to_builtins(value, builtin_types=(bytes,)))


def from_cbor(payload: zenoh.ZBytes | None) -> dict[str, Any]:
    """Return the map that a payload holds; an empty one for none."""
    found: dict[str, Any] = {} if payload is None else cbor2.loads(payload.to_bytes())
    return found
