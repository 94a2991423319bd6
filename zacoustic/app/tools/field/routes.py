"""Commands about routes of the command line, and what gateways say of routes."""

from collections.abc import Sequence
from typing import Final

import msgspec
from msgspec import UNSET

from zacoustic.app.tools.field.asking import Gateways, local_gateways
from zacoustic.app.tools.field.probing import Asker
from zacoustic.config import Config
from zacoustic.core.base.linktypes import ONE_LINK
from zacoustic.core.relay.route import Route
from zacoustic.core.wire.routing import RoutingKind, RoutingRequest
from zacoustic.errors import SessionError
from zacoustic.status.link import RelayDocument
from zacoustic.status.table import document_in
from zacoustic.zenoh.node import Node
from zacoustic.zenoh.requests.request import ANY_NODE, PREFIX
from zacoustic.zenoh.requests.routing import ROUTING, RoutingReport
from zacoustic.zenoh.session.asking.allreplies import ask_all
from zacoustic.zenoh.session.session import ZenohSession

_HERE_S: Final = 3.0
"""How long gateways of the local network may take, s."""


class GatewayAsker(Asker):
    """Asks through the local gateways.

    Args:
        gateways: The gateways.
    """

    def __init__(self, gateways: Gateways) -> None:
        self._gateways = gateways

    async def own(self) -> int:
        """Return the lowest address of the local gateways: that one asks."""
        question = RoutingRequest(kind=RoutingKind.HEARD)
        reports = await self._gateways.ask_all(ROUTING, question, _HERE_S)
        return min(report.address for report in reports)

    async def ask(self, node: int, request: RoutingRequest, timeout_s: float) -> RoutingReport:
        """Ask the gateways; the responsible one asks the node."""
        return await self._gateways.ask(ROUTING, node, request, timeout_s)


class LinkAsker(Asker):
    """Asks on its own link.

    Args:
        node: A node in direct mode, open.
    """

    def __init__(self, node: Node) -> None:
        self._node = node

    async def own(self) -> int:
        """Return the address of the node."""
        assert self._node.address is not None
        return self._node.address

    async def ask(self, node: int, request: RoutingRequest, timeout_s: float) -> RoutingReport:
        """Ask the node."""
        return await self._node.routing(node, request, timeout_s=timeout_s)


class HopShown(msgspec.Struct, frozen=True, kw_only=True):
    """One hop of a route, as the gateway at its begin counts: a `Hop` of the node that transmits.

    A compiled wheel allows no heir of `Hop`.
    """

    node: int
    """The node that transmits."""
    route: str
    """Name of the route."""
    next_node: int
    """Address of the node to which it goes."""
    waiting: int
    """Frames that are held for it."""
    transmissions: int
    """How often a frame was transmitted."""
    passed_on: int
    """Frames that have arrived there."""
    given_up: int
    """Frames that were given up."""


class RouteShown(msgspec.Struct, frozen=True, kw_only=True):
    """One route of the file, and what gateways say of it."""

    id: int
    """Its number."""
    name: str
    """Its name."""
    path: tuple[int, ...]
    """Its path in the file."""
    link: str
    """The link of its hops; empty: the only one."""
    lifetime_s: float
    """How long a frame may be on its way, s."""
    hops: tuple[HopShown, ...] = ()
    """Its hops in both directions, of the nodes whose gateways answer."""
    changed: dict[int, tuple[int, ...]] = {}
    """The path that a command has given it, at the nodes whose gateways say so."""


async def shown_routes(config: Config, connect: Sequence[str] | None) -> list[RouteShown]:
    """Return the routes of a file, with what the gateways of the local network say of them.

    Args:
        config: The file.
        connect: Endpoints of the router; override those of the file.

    Raises:
        SessionError: `connect` was given, and no router can be reached there.
    """
    documents: dict[int, RelayDocument] = {}
    try:
        async with local_gateways(config, connect) as gateways:
            documents = await _documents(gateways.zenoh_session)
    except SessionError:
        if connect:
            raise
    return [_shown(route, documents) for route in config.rules.routes]


async def _documents(zenoh_session: ZenohSession) -> dict[int, RelayDocument]:
    found = await ask_all(zenoh_session, f"{PREFIX}/{ANY_NODE}/relay", timeout_s=_HERE_S)
    return {
        int(address): document_in({"relay": msgspec.json.decode(payload)}, "relay", RelayDocument)
        for key, payload in found.answers
        if (address := key.split("/")[1]).isdecimal()
    }


def _shown(route: Route, documents: dict[int, RelayDocument]) -> RouteShown:
    hops = [
        HopShown(node=address, **msgspec.structs.asdict(hop))
        for address, document in sorted(documents.items())
        for hop in document.hops
        if hop.route == route.name
    ]
    return RouteShown(
        id=route.route_id,
        name=route.name,
        path=route.path,
        link="" if route.link == ONE_LINK else route.link,
        lifetime_s=route.longest_s,
        hops=tuple(hops),
        changed={
            address: document.changed[route.name].path
            for address, document in sorted(documents.items())
            if document.changed is not UNSET and route.name in document.changed
        },
    )
