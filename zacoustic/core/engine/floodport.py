"""Flooding of one engine: a link to all nodes, over one of its links.

Like a route it has a `LinkStack`. What that transmits is passed on by every node that hears it, so
its streams reach nodes that this one does not hear. Agreement, acknowledgements, calls and the seal
work from end to end.
"""

from functools import partial

from zacoustic.core.base.linktypes import (
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
)
from zacoustic.core.engine.linkstack import LinkStack
from zacoustic.core.profiles.rules import LinkRules
from zacoustic.core.relay.flood import FLOOD_NAME, Flood
from zacoustic.core.relay.flooding import Flooding
from zacoustic.core.schedule.context import Context
from zacoustic.core.wire.flood import FLOOD_PORT


class FloodPort:
    """The flooded streams of one node.

    Args:
        flood: What the file says; None: nothing is flooded.
    """

    def __init__(self, flood: Flood | None) -> None:
        self._flood = flood
        self._flooding: Flooding | None = None
        self._stack: LinkStack | None = None

    @property
    def rules(self) -> LinkRules | None:
        """The rules of that link; None: nothing is flooded."""
        return (
            None
            if self._flood is None
            else LinkRules(name=FLOOD_NAME, port=FLOOD_PORT, max_frame_s=None)
        )

    def flooding_on(self, context: Context) -> Flooding | None:
        """Make the flooding on a link; None: it goes by another one."""
        if self._flood is None or self._flood.link != context.link:
            return None
        self._flooding = Flooding(
            context.address,
            self._flood,
            rng=context.generators.of("flooding"),
            stats=context.stats,
            sizes=context.sizes,
            lists=context.table.lists,
            deliver=self._deliver,
        )
        return self._flooding

    def add(self, stack: LinkStack) -> None:
        """Take the stack of the flooded streams."""
        self._stack = stack

    def submit(self, now: int) -> None:
        """Flood what the stack transmits."""
        if self._stack is None or self._flooding is None:
            return
        while (made := self._stack.make_ranked(now)) is not None:
            frame = made.transmission
            ended = partial(self._stack.sent, frame.transmission_id, now)
            self._flooding.submit(
                frame.destination,
                frame.frame_bytes,
                now,
                ended,
                made.entries,
                is_urgent=made.is_urgent,
            )

    def handle_state(
        self, hop: LinkStack, state: LinkState, capabilities: LinkCapabilities | None, now: int
    ) -> None:
        """Take the state of a link, which may be that of the hops."""
        if self._flood is None or hop.name != self._flood.link:
            return
        assert self._flooding is not None
        assert self._stack is not None
        port, known = hop.transmitter.port, None
        if port is not None:
            self._flooding.use_link(port.capabilities)
            if capabilities is not None:
                known = self._flood.capabilities(capabilities, hop.hop_room_bytes)
        if state is not LinkState.UP:
            self._flooding.link_down(now)
        self._stack.handle_state(state, known, now)

    # Below the methods above

    def _deliver(self, frame: ReceivedFrame, now: int) -> None:
        assert self._stack is not None
        self._stack.handle_frame(frame, now)
