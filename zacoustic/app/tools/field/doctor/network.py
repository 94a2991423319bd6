"""The local network: is the router reachable, and does a gateway of this node run already?"""

import asyncio
import json
import re
import threading
from collections.abc import Sequence
from typing import Any, Final

import msgspec
import zenoh

from zacoustic.config import Config
from zacoustic.errors import SessionError
from zacoustic.link.contract import Finding
from zacoustic.ros.tokens import PREFIX as ROS_PREFIX
from zacoustic.zenoh.node.onzenoh.session import session_config
from zacoustic.zenoh.requests.report import REPORT
from zacoustic.zenoh.session.session import ZenohSession, endpoints_of, mode_of

_TCP: Final = re.compile(r"(?:tcp|tls|ws)/(\[.*\]|[^:/]+):([0-9]{1,5})")
_ANSWERS_S: Final = 3.0
"""Time for the documents of a gateway, s."""
_CONNECT_S: Final = 3.0
_TRIES: Final = 3
_BETWEEN_S: Final = 0.5
"""Time for a peer to meet others, s, with the tries."""


class Running(msgspec.Struct, kw_only=True):
    """The result of the search."""

    is_joined: bool = False
    """A router was reached."""
    health: dict[str, Any] = {}
    """Documents of this node's gateway, by name; empty: none runs."""
    digests: tuple[str, ...] = ()
    """Digests of the tables of gateways with this address."""
    tokens: tuple[str, ...] = ()
    """Liveliness tokens of ROS nodes."""
    unmet: tuple[str, ...] = ()
    """Those of them that a session like the gateway's does not see."""

    @property
    def locator(self) -> str:
        """Locator of that gateway's link; empty: none runs, or its link has no locator."""
        node = self.health.get("node")
        found = node.get("link", "") if isinstance(node, dict) else ""
        return found if isinstance(found, str) and "/" in found else ""


async def look(config: Config, connect: Sequence[str]) -> tuple[Running, list[Finding]]:
    """Join the local network, if there is one, and read the health report of this node's gateway.

    Args:
        config: Configuration of the node.
        connect: Endpoints of the router; override the file.
    """
    file = config.zenoh_config
    if file is None and not connect:
        return Running(), []
    must_be_there = bool(connect) or (file is not None and mode_of(file) == "client")
    endpoints = tuple(connect) or _endpoints(config)
    if not endpoints:
        return Running(), []
    reachable = [each for each in endpoints if await _listens(each)]
    if not reachable:
        return Running(), [_unreachable(endpoints)] if must_be_there else []
    try:
        zenoh_session = await ZenohSession.open(session_config(config, reachable))
    except SessionError as error:
        return Running(), [_unreachable(endpoints, str(error))] if must_be_there else []
    try:
        running = await zenoh_session.worker.run(
            lambda: _read(zenoh_session.session, config.address)
        )
    finally:
        await zenoh_session.close()
    if running.tokens and file is not None and _is_peer_without_gossip(file):
        seen = await asyncio.to_thread(_seen_as_peer, file, reachable)
        running.unmet = tuple(each for each in running.tokens if each not in seen)
    return running, []


def _is_peer_without_gossip(file: zenoh.Config) -> bool:
    gossip = file.get_json("scouting/gossip/enabled")
    return mode_of(file) == "peer" and gossip.strip() == "false"


def _seen_as_peer(file: zenoh.Config, connect: Sequence[str]) -> set[str]:
    """Return the tokens that a peer with the settings of the file sees."""
    settings = zenoh.Config.from_json5(str(file))
    settings.insert_json5("listen/endpoints", "[]")
    settings.insert_json5("connect/endpoints", json.dumps(list(connect)))
    try:
        with zenoh.open(settings) as session:
            found: set[str] = set()
            for _ in range(_TRIES):
                found |= _ros_tokens(session)
                threading.Event().wait(_BETWEEN_S)
            return found
    except zenoh.ZError:
        return set()


def _ros_tokens(session: zenoh.Session) -> set[str]:
    replies = session.liveliness().get(f"{ROS_PREFIX}/**", timeout=_ANSWERS_S)
    return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}


def _endpoints(config: Config) -> tuple[str, ...]:
    file = config.zenoh_config
    if file is None:
        return ()
    # Connect to the endpoints at which a router listens, like a node.
    return endpoints_of(session_config(config, None), "connect") or endpoints_of(file, "connect")


async def _listens(endpoint: str) -> bool:
    """Tell whether a program listens at an endpoint; True for anything but TCP."""
    found = _TCP.match(endpoint)
    if found is None:
        return True
    try:
        async with asyncio.timeout(_CONNECT_S):
            _, writer = await asyncio.open_connection(found[1].strip("[]"), int(found[2]))
    except OSError:  # a TimeoutError is one
        return False
    writer.close()
    return True


def _read(session: zenoh.Session, address: int) -> Running:
    """Query documents and tokens of the gateways with one address; in the worker."""
    health = {}
    for reply in session.get(REPORT.key(address), timeout=_ANSWERS_S):
        if reply.ok is not None and (place := REPORT.place(str(reply.ok.key_expr))):
            health[place[1]] = _decoded(reply.ok.payload.to_bytes())
    digests = {
        str(reply.ok.key_expr).rpartition("/")[2]
        for reply in session.liveliness().get(REPORT.key(address, "gateway/*"), timeout=_ANSWERS_S)
        if reply.ok is not None
    }
    return Running(
        is_joined=True,
        health=health,
        digests=tuple(sorted(digests)),
        tokens=tuple(sorted(_ros_tokens(session))),
    )


def _decoded(payload: bytes) -> object:
    try:
        return msgspec.json.decode(payload)
    except msgspec.DecodeError:
        return {}


def _unreachable(endpoints: Sequence[str], reason: str = "nobody listens there") -> Finding:
    return Finding(
        what=f"no Zenoh router at {', '.join(endpoints)}: {reason}",
        why="the gateway carries nothing to or from this local network",
        cure="start the router, or correct connect.endpoints of the file",
    )
