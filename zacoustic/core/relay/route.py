"""A route: the nodes over which frames go from one end to the other, and back."""

from typing import Annotated, Final, TypeAlias

import msgspec
from msgspec import Meta

from zacoustic.core.base.clock import DurationOrZero
from zacoustic.core.base.linktypes import LinkCapabilities, Node
from zacoustic.core.relay.tunnel import capabilities_through
from zacoustic.core.wire.relay import HEADER_BYTES, LAST_ROUTE
from zacoustic.errors import ConfigError
from zacoustic.text.allowed import check_fields

MOST_NODES: Final = 16
"""The most nodes of a path."""
HOP_LIFETIME_S: Final = 60.0
"""How long a frame may take for each hop, s, if the route says nothing."""
_PARTS_OF_LIFETIME: Final = 4
"""A duplicate comes within four units of a link, so that a unit of a route is this part of its
lifetime."""

RouteId: TypeAlias = Annotated[int, Meta(ge=1, le=LAST_ROUTE)]
"""Number of a route on the wire."""
RoutePath: TypeAlias = Annotated[
    tuple[Node, ...],
    Meta(
        min_length=2,
        max_length=MOST_NODES,
        description=f"2..{MOST_NODES} addresses, from one end to the other, each once",
        extra={"unique": True},
    ),
]
"""Addresses of the nodes of a route, from one end to the other."""


class Route(msgspec.Struct, frozen=True, kw_only=True):
    """A line of nodes; each hears at least its neighbours in it."""

    route_id: RouteId
    """Its number on the wire, the same at all its nodes."""
    name: str
    """Name of the link that it is for its two ends."""
    path: RoutePath
    """Addresses from one end to the other."""
    link: str
    """Name of the link of all its hops."""
    lifetime_s: DurationOrZero = 0.0
    """A frame that has been on its way for longer is dropped, s; 0: 60 s for each hop."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: One is outside its range.
        """
        check_fields(self, ConfigError)

    @property
    def hops(self) -> int:
        """Number of hops, at least 1."""
        return len(self.path) - 1

    @property
    def longest_s(self) -> float:
        """How long a frame may be on its way, s."""
        return self.lifetime_s or HOP_LIFETIME_S * self.hops

    def unit_s(self, hop: LinkCapabilities) -> float:
        """Return the propagation delay of the route as a link, s.

        Whoever waits for an answer waits for repetitions on all hops.

        Args:
            hop: What the link of its hops can do.
        """
        airtime_s = hop.preamble_s + hop.mtu_bytes * 8 / hop.bit_rate_bps
        way_s = self.hops * (airtime_s + hop.gap_s + hop.propagation_s)
        return max(way_s, self.longest_s / _PARTS_OF_LIFETIME)

    def other_end(self, address: int) -> int | None:
        """Return the other end of the route for one of its ends; None: the node is no end."""
        first, last = self.path[0], self.path[-1]
        return {first: last, last: first}.get(address)

    def capabilities(self, hop: LinkCapabilities, room_bytes: int) -> LinkCapabilities:
        """Return what the route can do as a link between its ends.

        Args:
            hop: What the link of its hops can do.
            room_bytes: Content of a frame of that link without envelope, bytes.

        Raises:
            ConfigError: Frames of that link are too short.
        """
        return capabilities_through(
            hop,
            room_bytes - HEADER_BYTES,
            unit_s=self.unit_s(hop),
            of=f"route {self.route_id}: frames of {self.link}",
        )
