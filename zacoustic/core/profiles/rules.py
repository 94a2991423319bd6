"""Rules of transmission from the configuration: access, silence, airtime, commands, objects."""

import msgspec

from zacoustic.core.base.linktypes import ONE_LINK
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.peers.peerrules import PeerRules
from zacoustic.core.profiles.entities import DiscoverySpec
from zacoustic.core.schedule.access.spec import AccessSpec, TdmaSpec
from zacoustic.core.schedule.linkseal import SealRules
from zacoustic.core.schedule.silence import QuietWindow
from zacoustic.core.transport.objects.limits import ObjectLimits
from zacoustic.errors import ConfigError


class LinkRules(msgspec.Struct, frozen=True, kw_only=True):
    """Rules of one link of several."""

    name: str
    """Its name."""
    access: AccessSpec | None = None
    """Medium access; None: as the link says."""
    max_airtime: float | None = None
    """Share of the time that the node may be on the air, above 0, at most 1, but for REAL_TIME;
    None: all of it."""
    port: int | None = None
    """Its number in what is sealed, 0…127, the same at both ends; None: its place in the list."""


class TransmitRules(msgspec.Struct, frozen=True, kw_only=True):
    """When, and how much, a node may transmit."""

    access: AccessSpec | None = None
    """Medium access; None: as the link says."""
    quiet: tuple[QuietWindow, ...] = ()
    """Hours of each day in which nothing is transmitted."""
    objects: ObjectLimits = ObjectLimits()
    """How much memory samples larger than a frame may take."""
    max_airtime: float | None = None
    """Share of the time that the node may be on the air, above 0, at most 1, but for REAL_TIME;
    None: all of it."""

    commands_from: frozenset[int] | None = None
    """Addresses of the nodes whose commands over the channel this one executes; None: those
    listed."""
    contact: ContactRules = ContactRules()
    """Heartbeats of the node, and the time after which others are lost."""
    agreement: AgreementMethod = AgreementMethod.CONFIRM
    """How much is said and answered to agree on tables."""
    discovery: DiscoverySpec | None = None
    """Beacons of rmw_desert, if the wire is that; None: none."""
    sealing: SealRules = SealRules()
    """Which frames get the long tag, and what is padded, where there is a key."""

    port: int | None = None
    """As `LinkRules.port`, where there is one link."""
    links: tuple[LinkRules, ...] = ()
    """The links; whatever names none goes by the first. Empty: one link, with the rules above."""
    routes: dict[int, str] = {}
    """Stream id → name of its link; other streams go by the first link."""

    def on_one_link(self) -> "TransmitRules":
        """Return these rules for a node that has one link, by which all streams go."""
        port = self.links[0].port if self.links else self.port
        return msgspec.structs.replace(self, links=(), routes={}, port=port)

    @property
    def of_links(self) -> tuple[LinkRules, ...]:
        """The rules of each link, at least one.

        Raises:
            ConfigError: Two links have one name, or a stream goes by a link that is not there.
        """
        one = LinkRules(
            name=ONE_LINK, access=self.access, max_airtime=self.max_airtime, port=self.port
        )
        links = self.links or (one,)
        names = [each.name for each in links]
        for name in names:
            if names.count(name) > 1:
                raise ConfigError(f"links: two have the name {name!r}")
        for stream_id, name in self.routes.items():
            if name not in names:
                raise ConfigError(
                    f"stream {stream_id}: link is {name!r}; allowed: {', '.join(names)}"
                )
        return links

    @property
    def of_peers(self) -> PeerRules:
        """Return how the other nodes are treated, whatever the link."""
        return PeerRules(contact=self.contact, agreement=self.agreement)

    @property
    def schedule(self) -> TdmaSpec | None:
        """The time slots that are kept on a link; None: there are none."""
        slots = (each.access for each in self.of_links)
        return next((each for each in slots if isinstance(each, TdmaSpec)), None)

    @property
    def clock_error_s(self) -> float:
        """Largest error of the host's clock, s, as the schedule states."""
        return self.schedule.clock_error_s if self.schedule is not None else 0.0
