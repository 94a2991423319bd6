"""What the config says of transmitting: access, silence, airtime, orders, heartbeats, objects."""

import msgspec

from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.entities import DiscoverySpec
from zacoustic.core.schedule.access.spec import AccessSpec, TdmaSpec
from zacoustic.core.schedule.silence import QuietWindow
from zacoustic.core.transport.objects.limits import ObjectLimits


class TransmitRules(msgspec.Struct, frozen=True, kw_only=True):
    """When, and how much, a node may transmit."""

    access: AccessSpec | None = None
    """Medium access; None: as the link says."""
    quiet: tuple[QuietWindow, ...] = ()
    """Hours of each day at which nothing is transmitted."""
    objects: ObjectLimits = ObjectLimits()
    """How much memory samples may take that are larger than a frame."""
    max_airtime: float | None = None
    """Share of the time that the node may be on the air, above 0, at most 1, but for REAL_TIME;
    None: all of it."""

    orders_from: frozenset[int] | None = None
    """Addresses of the nodes whose orders over the water this one obeys; None: those listed."""
    contact: ContactRules = ContactRules()
    """How often the node is to be heard, and when it misses others."""
    discovery: DiscoverySpec | None = None
    """Beacons of rmw_desert, where that is spoken; None: none."""

    @property
    def clock_error_s(self) -> float:
        """How wrong the clock of the host is taken to be, s: as the schedule states."""
        return self.access.clock_error_s if isinstance(self.access, TdmaSpec) else 0.0
