"""The bonds of one engine: each is a link to its streams, like a route over relays.

A bond has a `LinkStack`. What that transmits goes into the outboxes of the bond on its links, and
what arrives there for the bond comes back. Its airtimes are those of the best link that reaches all
nodes; when that changes, whatever waits for an answer is due at once.
"""

from collections.abc import Iterator
from typing import Final

from zacoustic.core.base.linktypes import (
    LinkCapabilities,
    LinkState,
    TransmitReport,
)
from zacoustic.core.base.timers import Due
from zacoustic.core.bond.bonding import Bonding, BondStatus
from zacoustic.core.bond.spec import Bond, BondLink
from zacoustic.core.engine.forwarding import Forwarding
from zacoustic.core.engine.linkstack import LinkStack
from zacoustic.core.peers.handshake import SETTLING_UNITS
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.relay.flooding import Flooding
from zacoustic.core.relay.prober import Prober
from zacoustic.core.relay.relay import Relay
from zacoustic.core.schedule.context import Context, NodeContext, Tunnel
from zacoustic.core.schedule.silence import Silence
from zacoustic.core.streams.carry import Carry
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.relay import FIRST_PORT
from zacoustic.errors import ConfigError

_TO_LINK: Final = (LinkState.OPENING, LinkState.DOWN)
_AWAITING: Final = frozenset(
    {Due.CALL, Due.GOAL, Due.COPY, Due.SENDING, Due.RECEIVING, Due.REPETITION, Due.OBJECT}
)
"""While such a timer is armed, something waits for another node."""


class BondPorts:
    """The bonds of one node.

    Args:
        address: Address of the node.
        table: Its streams.
        rules: The rules of the config.
        silence: The transmit silence.
    """

    def __init__(
        self, address: int, table: StreamTable, rules: TransmitRules, silence: Silence
    ) -> None:
        self._address = address
        self._silence = silence
        self._table = table
        self._link_of = rules.links_of_streams
        self._default_link = rules.default_link
        self._bonds = rules.bonds
        ends = {each.name: each.other_end(address) for each in rules.routes}
        self._routes = {name: end for name, end in ends.items() if end is not None}
        """The routes that end here, with the node at the other end."""
        self._links: dict[str, BondLink] = {each.name: each.bonded for each in rules.of_links}
        self._links |= {name: rules.bonded_routes.get(name, BondLink()) for name in self._routes}
        self._made: dict[str, tuple[Bonding, Context]] = {}
        self._stacks: dict[str, LinkStack] = {}
        self._used: dict[str, LinkCapabilities] = {}

    def make(self, bond: Bond, own: LinkRules, node: NodeContext, index: int) -> Context:
        """Make a bond, of whose links this node has at least one; return the node on it.

        Raises:
            ConfigError: It has routes to several nodes.
        """
        links = {each: self._links[each] for each in bond.links if each in self._links}
        ends = {self._routes[each] for each in links if each in self._routes}
        if len(ends) > 1:
            raise ConfigError(
                f"links {bond.name}: routes to nodes {', '.join(map(str, sorted(ends)))}; allowed: "
                "routes to one node"
            )
        # A frame on a route is for its other end, so such a bond has no frame for all.
        context = Context(
            node,
            own.name,
            index,
            own.port,
            other_end=next(iter(ends), None),
            tunnel=Tunnel.BOND,
        )
        stats = context.node.stats.links
        bonding = Bonding(
            bond,
            links,
            sorted(ends) or self._hearers(bond),
            context,
            {each: stats[each] for each in links},
            context.generators.of("bond"),
        )
        self._made[bond.name] = bonding, context
        return context

    @property
    def here(self) -> Iterator[tuple[Bond, LinkRules]]:
        """The bonds with a link at this node, with the rules of each as a link."""
        for bond in self._bonds:
            if any(each in self._links for each in bond.links):
                port = FIRST_PORT - 1 + bond.number
                yield bond, LinkRules(name=bond.name, port=port, max_frame_s=None)

    def forwarding(
        self,
        link: str,
        relay: Relay | None = None,
        prober: Prober | None = None,
        flooding: Flooding | None = None,
    ) -> Forwarding | None:
        """Return what goes over a link, or a route, beside its own frames; None: nothing.

        Args:
            link: Its name.
            relay: Its routes; None: there are none.
            prober: Its probes; None: there are none.
            flooding: Its flooded frames; None: there are none.
        """
        over = {
            bonding.bond.number: bonding
            for bonding, _ in self._made.values()
            if link in bonding.outboxes
        }
        others = [each.number for each in self._bonds if each.number not in over]
        if relay is None and prober is None and flooding is None and not self._bonds:
            return None
        return Forwarding(link, relay, over, others, prober, flooding)

    def add(self, stack: LinkStack) -> None:
        """Take the stack of a bond."""
        bonding, context = self._made[stack.name]
        self._stacks[stack.name] = stack

        def report(report: TransmitReport, now: int) -> None:
            stack.handle_report(report, now)

        def is_waiting() -> bool:
            return not stack.is_idle or context.timers.is_armed(_AWAITING)

        bonding.begin(stack.handle_frame, report, is_waiting)

    def submit(self, now: int) -> None:
        """Take what the bonds transmit."""
        for name, stack in self._stacks.items():
            bonding, _ = self._made[name]
            self._follow(bonding, stack, now)
            if (port := stack.transmitter.port) is not None:
                port.extra_bytes = bonding.extra_bytes(now)
            stack.protocols.hold_heartbeats(is_held=bonding.is_costly)
            while (made := stack.make_ranked(now)) is not None:
                bonding.submit(
                    made.transmission,
                    made.entries,
                    now,
                    is_urgent=made.is_urgent,
                    is_granted=self._silence.is_silent(now),
                    expires_at=made.expires_at,
                    is_heartbeat=made.is_heartbeat,
                )

    def handle_state(self, hop: LinkStack, state: LinkState, now: int) -> None:
        """Take the state of a link for the bonds over it."""
        port = hop.transmitter.port
        for name, stack in self._stacks.items():
            bonding, _ = self._made[name]
            if hop.name not in bonding.outboxes:
                continue
            known = None if port is None else port.capabilities
            room_bytes = 0 if port is None else port.envelope.room_bytes
            bonding.handle_state(hop.name, state, known, room_bytes, now)
            self._follow(bonding, stack, now)

    @property
    def statuses(self) -> list[BondStatus]:
        """What each bond does at present."""
        return [bonding.status for bonding, _ in self._made.values()]

    # Below the methods above

    def _follow(self, bonding: Bonding, stack: LinkStack, now: int) -> None:
        """Let the stack have the state and the airtimes of the link in use."""
        capabilities = bonding.capabilities
        if capabilities is None:
            if stack.state not in _TO_LINK:
                stack.handle_state(LinkState.DOWN, None, now)
            return
        _, context = self._made[stack.name]
        context.settling_ns = SETTLING_UNITS * bonding.slowest_unit_ns
        is_new = capabilities != self._used.get(stack.name)
        if stack.state is not LinkState.UP:
            self._used[stack.name] = capabilities
            stack.handle_state(LinkState.UP, capabilities, now)
        elif is_new and not stack.is_busy:
            self._used[stack.name] = capabilities
            stack.switch(capabilities, now)

    def _hearers(self, bond: Bond) -> list[int]:
        """Return the nodes that frames of this node on a bond concern."""
        everybody = [each for each in self._table.nodes if each != self._address]
        found: set[int] = set()
        for stream in self._table:
            if self._link_of.get(stream.stream_id, self._default_link) != bond.name:
                continue
            match stream.spec:
                case TopicSpec(carry=Carry(by=by)) as spec:
                    part = {*(spec.publishers or ()), *by, *(spec.subscribers or ())}
                    found |= part if self._address in part else set()
                    continue
                case TopicSpec(publishers=publishers, subscribers=subscribers):
                    ends = publishers, subscribers
                case ServiceSpec(server=server) | ActionSpec(server=server):
                    if server != self._address:  # a client counts once it was heard
                        found.add(server)
                    continue
            for one, other in (ends, ends[::-1]):
                if not one or self._address in one:
                    found |= set(other or everybody)
        return sorted(found - {self._address}) or everybody
