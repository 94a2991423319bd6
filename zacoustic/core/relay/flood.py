"""What a file says of flooding: how far frames go, and what a node does for those of others."""

from typing import Annotated, Final, TypeAlias

import msgspec
from msgspec import Meta

from zacoustic.core.base.clock import Share
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.relay.tunnel import capabilities_through
from zacoustic.core.wire.flood import HEADER_BYTES, MOST_HOPS
from zacoustic.errors import ConfigError
from zacoustic.text.allowed import check_fields

FLOOD_NAME: Final = "flood"
"""Name of the link that flooding is for the streams."""
SPREAD_FRAMES: Final = 2
"""A node with one further neighbour passes a frame on after a pause of up to so many largest
frames."""
_WAYS: Final = 2
Hops: TypeAlias = Annotated[int, Meta(ge=1, le=MOST_HOPS)]
"""How many hops frames go at most."""


class Flood(msgspec.Struct, frozen=True, kw_only=True):
    """How frames of streams with ``flood`` go."""

    link: str
    """Name of the link of all hops."""
    hops: Hops = 3
    """How many hops they go at most."""
    max_airtime: Share = 0.05
    """Share of the time that a node passes frames of others on."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: One is outside its range.
        """
        check_fields(self, ConfigError)

    def unit_s(self, hop: LinkCapabilities) -> float:
        """Return the propagation delay of flooding as a link, s.

        Whoever waits for an answer waits for a repetition on the way.

        Args:
            hop: What the link of its hops can do.
        """
        airtime_s = hop.preamble_s + hop.mtu_bytes * 8 / hop.bit_rate_bps
        hop_s = airtime_s + hop.gap_s + hop.propagation_s
        way_s = hop_s + (self.hops - 1) * (hop_s + SPREAD_FRAMES * airtime_s)
        return _WAYS * way_s

    def capabilities(self, hop: LinkCapabilities, room_bytes: int) -> LinkCapabilities:
        """Return what flooding can do as a link of all nodes.

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
            of=f"flood: frames of {self.link}",
        )
