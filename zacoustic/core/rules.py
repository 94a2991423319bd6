"""What the config says of transmitting: medium access, hours of silence, airtime."""

import msgspec

from zacoustic.core.access.spec import AccessSpec
from zacoustic.core.silence import QuietWindow


class TransmitRules(msgspec.Struct, frozen=True, kw_only=True):
    """When, and how much, a node may transmit."""

    access: AccessSpec | None = None
    """Medium access; None: as the link says."""
    quiet: tuple[QuietWindow, ...] = ()
    """Hours of each day at which nothing is transmitted."""
    max_airtime: float | None = None
    """Share of the time that the node may be on the air, above 0, at most 1, but for REAL_TIME;
    None: all of it."""
