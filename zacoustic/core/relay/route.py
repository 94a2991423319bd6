"""A route: the nodes over which frames go from one end to the other, and back."""

from typing import Final

import msgspec

from zacoustic.core.base.clock import DURATIONS, is_duration
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.relay.tunnel import capabilities_through
from zacoustic.core.wire.relay import HEADER_BYTES, LAST_ROUTE
from zacoustic.errors import ConfigError

MOST_NODES: Final = 16
"""The most nodes of a path."""
HOP_LIFETIME_S: Final = 60.0
"""How long a frame may take for each hop, s, if the route says nothing."""
_PARTS_OF_LIFETIME: Final = 4
"""A duplicate comes within four units of a link, so that a unit of a route is this part of its
lifetime."""


class Route(msgspec.Struct, frozen=True, kw_only=True):
    """A line of nodes; each hears at least its neighbours in it."""

    route_id: int
    """Its number on the wire, 1…31, the same at all its nodes."""
    name: str
    """Name of the link that it is for its two ends."""
    path: tuple[int, ...]
    """Addresses from one end to the other, 2…16 different ones."""
    link: str
    """Name of the link of all its hops."""
    lifetime_s: float = 0.0
    """A frame that has been on its way for longer is dropped, s; 0: 60 s for each hop."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: One is outside its range.
        """
        if not 1 <= self.route_id <= LAST_ROUTE:
            raise ConfigError(f"route {self.route_id}: allowed: 1..{LAST_ROUTE}")
        path = self.path
        if not 2 <= len(path) <= MOST_NODES or len(set(path)) < len(path):
            raise ConfigError(
                f"route {self.route_id}: path is {list(path)}; allowed: 2..{MOST_NODES} addresses, "
                "each once"
            )
        if not all(1 <= each <= 254 for each in path):
            raise ConfigError(f"route {self.route_id}: path is {list(path)}; allowed: 1..254")
        if not is_duration(self.lifetime_s, or_zero=True):
            raise ConfigError(
                f"route {self.route_id}: lifetime_s is {self.lifetime_s}; allowed: 0, {DURATIONS}"
            )

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
