"""What a link is that goes inside the frames of another one: a route, or flooding."""

from typing import Final

from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.errors import ConfigError

LEAST_ROOM_BYTES: Final = 32
"""Such a link has room for at least this much in a frame, bytes."""


def capabilities_through(
    hop: LinkCapabilities, room_bytes: int, *, unit_s: float, of: str
) -> LinkCapabilities:
    """Return what such a link can do.

    Args:
        hop: What the link of its hops can do.
        room_bytes: What a frame of that link has room for behind the header, bytes.
        unit_s: Its propagation delay, s.
        of: Whose frames, for the error: ``route 1: frames of radio``.

    Raises:
        ConfigError: The frames are too short.
    """
    if room_bytes < LEAST_ROOM_BYTES:
        raise ConfigError(
            f"{of} have room for {room_bytes} bytes; allowed: at least {LEAST_ROOM_BYTES}"
        )
    return LinkCapabilities(
        mtu_bytes=room_bytes,
        bit_rate_bps=hop.bit_rate_bps,
        preamble_s=hop.preamble_s,
        propagation_s=unit_s,
        half_duplex=False,
        controls_access=True,
    )
