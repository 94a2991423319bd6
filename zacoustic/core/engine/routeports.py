"""The routes over relays of one engine: each is a link to its two ends.

An end of a route has a `LinkStack` for it, like for any link. What that transmits goes into the
custody of the `Relay` on the link of the hops, and what arrives for this node comes back from
there. So agreement, dense blocks, acknowledgements, calls, goals, objects and the seal work from
end to end, and no relay knows of them.

A transmission on a route is over once a node further along the path has the frame, or it was given
up, and only a few may be under way. So a route fills no relay.
"""

from collections.abc import Iterator
from functools import partial

from zacoustic.core.base.linktypes import (
    BROADCAST,
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
)
from zacoustic.core.engine.linkstack import LinkStack
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.relay.paths import Paths
from zacoustic.core.relay.prober import Prober
from zacoustic.core.relay.relay import Relay
from zacoustic.core.relay.route import Route
from zacoustic.core.schedule.context import Context, NodeContext
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.wire.relay import FIRST_PORT


class RoutePorts:
    """The routes of one node.

    Args:
        address: Address of the node.
        rules: The rules of the config.
    """

    def __init__(self, address: int, rules: TransmitRules) -> None:
        self._address = address
        self._rules = rules
        self._routes = [each for each in rules.routes if address in each.path]
        self._ends: dict[str, tuple[Route, LinkStack, Relay]] = {}
        self._relays: dict[str, Relay] = {}
        self.prober: Prober | None = None
        """The probes of the node; None: its wire has none."""
        self._probed = rules.routes[0].link if rules.routes else rules.of_links[0].name

    def relay(self, context: Context) -> Relay | None:
        """Make the relay on a link; None: no route goes over it."""
        over_it = [each for each in self._rules.routes if each.link == context.link]
        if not over_it:
            return None
        routes = {each.route_id: each for each in over_it if self._address in each.path}
        seal = context.node.seal
        relay = self._relays[context.link] = Relay(
            self._address,
            routes,
            {each.route_id for each in over_it} - set(routes),
            self._rules.relay,
            rng=context.generators.of("relay"),
            timers=context.timers,
            measurements=context.node.measurements,
            stats=context.stats,
            sizes=context.sizes,
            deliver=self._deliver,
            # A node that has restarted refuses numbers below its mark, and hop frames go to all.
            may_have_restarted=None if seal is None else partial(seal.pass_mark, BROADCAST),
        )
        return relay

    def paths(self, node: NodeContext) -> Paths:
        """Return the paths of the routes, once all relays are made."""
        return Paths(
            self._address,
            self._rules.routes,
            [each.number for each in self._rules.bonds],
            self._relays,
            node.stored,
            node.journal,
        )

    def prober_on(self, context: Context) -> Prober | None:
        """Make the prober on a link; None: no probes go by it.

        Probes go by the link of the first route, which is the first link if there is no route.
        """
        if context.link != self._probed or context.table.wire is not WireProfile.NATIVE:
            return None
        self.prober = Prober(context.generators.of("prober"), context.stats)
        return self.prober

    @property
    def ends(self) -> Iterator[tuple[Route, int, LinkRules]]:
        """The routes that end at this node, with the other end and the rules of that link."""
        for route in self._routes:
            other_end = route.other_end(self._address)
            if other_end is not None:
                port = FIRST_PORT - 1 + route.route_id
                yield route, other_end, LinkRules(name=route.name, port=port, max_frame_s=None)

    def add(self, route: Route, stack: LinkStack, relay: Relay) -> None:
        """Take the stack of a route that ends here."""
        self._ends[route.name] = route, stack, relay

    def over(self, link: str) -> list[LinkStack]:
        """Return the stacks of the routes over a link that end here."""
        return [stack for route, stack, _ in self._ends.values() if route.link == link]

    def submit(self, now: int) -> None:
        """Take into custody what the routes transmit."""
        for route, stack, relay in self._ends.values():
            while (made := stack.make_ranked(now)) is not None:
                frame = made.transmission
                ended = partial(stack.sent, frame.transmission_id, now)
                relay.submit(
                    route, frame.frame_bytes, now, ended, made.entries, is_urgent=made.is_urgent
                )

    def handle_state(
        self, hop: LinkStack, state: LinkState, capabilities: LinkCapabilities | None, now: int
    ) -> None:
        """Take the state of a link for the routes over it, and for probes."""
        port = hop.transmitter.port
        if port is not None and self.prober is not None and hop.name == self._probed:
            self.prober.use_link(port.capabilities)
        if hop.relay is None:
            return
        if port is not None:
            hop.relay.use_link(port.capabilities)
        if state is not LinkState.UP:
            hop.relay.link_down(now)
        for route, stack, _ in self._ends.values():
            if route.link == hop.name:
                known = None
                if capabilities is not None and port is not None:
                    known = route.capabilities(capabilities, hop.hop_room_bytes)
                stack.handle_state(state, known, now)

    # Below the methods above

    def _deliver(self, route: Route, frame: ReceivedFrame, now: int) -> None:
        _, stack, _ = self._ends[route.name]
        stack.handle_frame(frame, now)
