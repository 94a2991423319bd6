"""Rules of transmission from the config: access, silence, airtime, commands, objects."""

import msgspec

from zacoustic.core.base.linktypes import MAX_FRAME_S, ONE_LINK
from zacoustic.core.bond.spec import Bond, BondLink
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.peers.peerrules import PeerRules
from zacoustic.core.profiles.entities import DiscoverySpec
from zacoustic.core.relay.flood import FLOOD_NAME, Flood
from zacoustic.core.relay.relay import RelayRules
from zacoustic.core.relay.route import Route
from zacoustic.core.schedule.access.spec import AccessSpec, ClockedSpec, slots_of
from zacoustic.core.schedule.linkseal import SealRules
from zacoustic.core.schedule.silence import QuietWindow
from zacoustic.core.streams.carry import DEFAULT_MAX_BYTES
from zacoustic.core.transport.objects.limits import ObjectLimits
from zacoustic.errors import ConfigError


class LinkRules(msgspec.Struct, frozen=True, kw_only=True):
    """Rules of one of several links."""

    name: str
    """Its name."""
    access: AccessSpec | None = None
    """Medium access; None: chosen by the link's capabilities."""
    max_airtime: float | None = None
    """Share of the time that the node may transmit, above 0, at most 1, not counting REAL_TIME;
    None: no cap."""
    max_frame_s: float | None = MAX_FRAME_S
    """Longest airtime of a frame, s, > 0; None: no bound, as for what goes by other links."""
    port: int | None = None
    """The link's number in sealed frames, 0…127, the same at both ends; None: its index in the
    list."""
    bonded: BondLink = BondLink()
    """How bonds treat it."""


class TransmitRules(msgspec.Struct, frozen=True, kw_only=True):
    """When, and how much, a node may transmit."""

    access: AccessSpec | None = None
    """Medium access; None: chosen by the link's capabilities."""
    quiet: tuple[QuietWindow, ...] = ()
    """Hours of each day without transmission."""
    objects: ObjectLimits = ObjectLimits()
    """How much memory samples may take that are larger than a frame."""
    carry_bytes: int = DEFAULT_MAX_BYTES
    """How much the node carries for others, bytes, ≥ 0."""
    max_airtime: float | None = None
    """Share of the time that the node may transmit, above 0, at most 1, not counting REAL_TIME;
    None: no cap."""
    max_frame_s: float | None = MAX_FRAME_S
    """Longest airtime of a frame, s, > 0; None: no bound."""

    commands_from: frozenset[int] | None = None
    """Addresses of the nodes whose commands over the channel this one executes; None: all nodes of
    the table."""
    contact: ContactRules = ContactRules()
    """Heartbeats of the node, and the time after which other nodes count as lost."""
    agreement: AgreementMethod = AgreementMethod.CONFIRM
    """How much is sent and answered to agree on tables."""
    discovery: DiscoverySpec | None = None
    """Beacons of rmw_desert, on that wire; None: none."""
    sealing: SealRules = SealRules()
    """Which frames get the long tag and what is padded, if there is a key."""

    port: int | None = None
    """As `LinkRules.port`, for a single link."""
    links: tuple[LinkRules, ...] = ()
    """The links; a stream without a link uses the first. Empty: one link with the rules above."""
    links_of_streams: dict[int, str] = {}
    """Name of the link, route over relays, or bond, by stream id; other streams use
    `default_link`."""
    default_link: str = ""
    """Name of the link or bond for other streams and for remote commands; empty: the first link."""
    routes: tuple[Route, ...] = ()
    """All routes over relays."""
    relay: RelayRules = RelayRules()
    """How much the node does for the routes of others."""
    flood: Flood | None = None
    """How frames of flooded streams go; their link is `FLOOD_NAME`. None: nothing is flooded."""
    bonds: tuple[Bond, ...] = ()
    """All bonds of links and routes; a node may lack some of them."""
    bonded_routes: dict[str, BondLink] = {}
    """How bonds treat a route, by its name."""

    def on_one_link(self) -> "TransmitRules":
        """Return these rules for a node with one link for all streams."""
        port = self.links[0].port if self.links else self.port
        routes = tuple(msgspec.structs.replace(each, link=ONE_LINK) for each in self.routes)
        names = {each.name for each in routes}
        flood = None if self.flood is None else msgspec.structs.replace(self.flood, link=ONE_LINK)
        names |= set() if flood is None else {FLOOD_NAME}
        named = {
            stream_id: name for stream_id, name in self.links_of_streams.items() if name in names
        }
        return msgspec.structs.replace(
            self,
            links=(),
            links_of_streams=named,
            routes=routes,
            flood=flood,
            port=port,
            bonds=(),
            default_link="",
        )

    @property
    def of_links(self) -> tuple[LinkRules, ...]:
        """The rules of each link, at least one.

        Raises:
            ConfigError: Two links have the same name, or a stream uses a link that does not exist.
        """
        one = LinkRules(
            name=ONE_LINK,
            access=self.access,
            max_airtime=self.max_airtime,
            max_frame_s=self.max_frame_s,
            port=self.port,
        )
        links = self.links or (one,)
        names = [each.name for each in links]
        for route in self.routes:
            if route.link not in names:
                raise ConfigError(
                    f"route {route.name!r}: link is {route.link!r}; allowed: {', '.join(names)}"
                )
        if self.flood is not None and self.flood.link not in names:
            raise ConfigError(f"flood: link is {self.flood.link!r}; allowed: {', '.join(names)}")
        names += [each.name for each in self.routes] + [each.name for each in self.bonds]
        names += [] if self.flood is None else [FLOOD_NAME]
        for name in names:
            if names.count(name) > 1:
                raise ConfigError(f"links, routes and bonds: two have the name {name!r}")
        numbers = [*(each.route_id for each in self.routes), *(each.number for each in self.bonds)]
        for number in numbers:
            if numbers.count(number) > 1:
                raise ConfigError(f"routes and bonds: two have the number {number}")
        for stream_id, name in self.links_of_streams.items():
            if name not in names:
                raise ConfigError(
                    f"stream {stream_id}: link is {name!r}; allowed: {', '.join(names)}"
                )
        if self.default_link and self.default_link not in names:
            raise ConfigError(f"default_link is {self.default_link!r}; allowed: {', '.join(names)}")
        return links

    def contact_on(self, link: str) -> ContactRules:
        """Return the rules about contact on a link: a bond sends the heartbeats of its links.

        On a link that costs money there are none.
        """
        costly = any(each.name == link and each.bonded.costs_money for each in self.links)
        if costly or any(link in each.links for each in self.bonds):
            return msgspec.structs.replace(self.contact, heartbeat_s=None, announces=False)
        return self.contact

    @property
    def of_peers(self) -> PeerRules:
        """Return how to treat the other nodes, on any link."""
        return PeerRules(contact=self.contact, agreement=self.agreement)

    @property
    def schedule(self) -> ClockedSpec | None:
        """The TDMA schedule of the first link that has one; None: none has."""
        slots = (slots_of(each.access) for each in self.of_links)
        return next((each for each in slots if each is not None), None)

    @property
    def clock_error_s(self) -> float:
        """Largest error of the host's clock by the schedule, s; 0: there is no schedule."""
        return self.schedule.clock_error_s if self.schedule is not None else 0.0
