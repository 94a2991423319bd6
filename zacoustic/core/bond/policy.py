"""Which links of a bond a frame goes by: order, reach, time, size and cost.

1. The first link in the order of the list that reaches the receiver. While a link is in doubt, the
   next one as well; where none surely reaches it, the last one that is up.
2. A frame with a sample that has a lifespan goes by the first of the links that bring it within
   that, if one of them reaches the receiver.
3. Frames fit all links, for any may be the next one. Only where each receiver is reached by one
   link alone, on which nobody answers, may a frame be as large as that link allows: a message by
   satellite costs as much when it is half empty.
4. A heartbeat goes by no link that costs money.
"""

from collections.abc import Collection, Mapping, Sequence

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities, Transmission
from zacoustic.core.bond.outbox import Outbox
from zacoustic.core.bond.reach import PeerReach, Reach
from zacoustic.core.bond.spec import BondLink
from zacoustic.core.peers.handshake import unit_ns
from zacoustic.core.peers.peers import PerPeer
from zacoustic.core.wire.relay import HEADER_BYTES


class LinkPolicy:
    """The choice among the links of one bond at one node.

    Args:
        rules: How the bond treats each of its links, in its order.
        reach: What is known of each node on each link.
        outboxes: What waits for each link.
    """

    def __init__(
        self,
        rules: dict[str, BondLink],
        reach: Mapping[str, PerPeer[PeerReach]],
        outboxes: Mapping[str, Outbox],
    ) -> None:
        self._rules = rules
        self._reach = reach
        self._outboxes = outboxes
        self.up: dict[str, LinkCapabilities] = {}
        """The links that are up, and what they can do."""
        self._room_bytes: dict[str, int] = {}
        self._units_ns: dict[str, int] = {}

    # Inputs

    def link_up(self, link: str, capabilities: LinkCapabilities, room_bytes: int) -> None:
        """Take that a link is up, with the content of its frames without envelope, bytes."""
        self.up[link] = capabilities
        self._room_bytes[link] = room_bytes
        self._units_ns[link] = unit_ns(capabilities)

    def link_down(self, link: str) -> bool:
        """Take that a link is not up; return whether it was."""
        return self.up.pop(link, None) is not None

    # Getters

    @property
    def free_of_money(self) -> list[str]:
        """The links that are up and do not cost money."""
        return [each for each in self.up if not self._rules[each].costs_money]

    @property
    def slowest_unit_ns(self) -> int:
        """The time in which the largest frame arrives by the slowest link, ns."""
        return max(self._units_ns.values(), default=0)

    def in_use(self, peers: Sequence[int]) -> str | None:
        """Return the best link that reaches all nodes, else the last one that is up, or None."""
        links = [link for link in self._rules if link in self.up]
        used = [self.used_to(each) for each in peers]
        if not links:
            return None
        places = [links.index(each) for each in used if each is not None]
        return links[max(places, default=len(links) - 1)]

    def capabilities(self, peers: Sequence[int]) -> LinkCapabilities | None:
        """Return what the bond can do as a link to these nodes; None: none of its links is up."""
        link = self.in_use(peers)
        if link is None:
            return None
        used = self.up[link]
        return LinkCapabilities(
            # Frames must fit whichever link comes next, so that a switch drops nothing.
            mtu_bytes=self._common_bytes,
            bit_rate_bps=used.bit_rate_bps,
            preamble_s=used.preamble_s,
            gap_s=used.gap_s,
            propagation_s=used.propagation_s,
            half_duplex=used.half_duplex,
            # Medium access is at the link itself; the pauses of repetitions follow from these.
            controls_access=used.controls_access,
            senses_carrier=used.senses_carrier,
        )

    def extra_bytes(self, peers: Sequence[int], now: int) -> int:
        """Return by how many bytes a frame that goes now may be larger than `capabilities` say."""
        ways = {
            tuple(self._links_to(peer, now, self.up, is_urgent=is_urgent))
            for peer in peers
            for is_urgent in (False, True)
        }
        if len(ways) != 1 or len(only := next(iter(ways))) != 1 or self._rules[only[0]].answers:
            return 0
        return self._frame_bytes(only[0]) - self._common_bytes

    def ways_to(
        self,
        peer: int,
        frame: Transmission,
        now: int,
        expires_at: int | None,
        among: Collection[str] | None = None,
        *,
        is_urgent: bool = False,
    ) -> list[str]:
        """Return the links for a frame to a node, in their order.

        Args:
            peer: The node.
            frame: The frame.
            now: The instant, ns.
            expires_at: Instant after which a part of it is worthless, ns; None: it never is.
            among: The links to choose from; None: all that are up.
            is_urgent: Whether a link must have been answered just now to be the only one.
        """
        links = self.up if among is None else among
        fitting = [each for each in links if len(frame.frame_bytes) <= self._frame_bytes(each)]
        if expires_at is not None:
            in_time = [each for each in fitting if self._arrives_at(each, frame, now) <= expires_at]
            if self._sure_to(peer, in_time) is not None:
                return self._links_to(peer, now, in_time, is_urgent=is_urgent)
        return self._links_to(peer, now, fitting, is_urgent=is_urgent)

    def used_to(self, peer: int) -> str | None:
        """Return the first link that surely reaches a node, else the last one that is up."""
        return self._sure_to(peer, self.up) or self.last_of(self.up)

    def last_of(self, among: Collection[str]) -> str | None:
        """Return the last of some links in the order of the list; None: there is none."""
        return next((link for link in reversed(self._rules) if link in among), None)

    # Below the methods above

    @property
    def _common_bytes(self) -> int:
        """The largest frame that each of the links has room for, bytes."""
        return min(map(self._frame_bytes, self._room_bytes))

    def _frame_bytes(self, link: str) -> int:
        """Return the largest frame of the bond that a link has room for, bytes."""
        return self._room_bytes[link] - HEADER_BYTES

    def _arrives_at(self, link: str, frame: Transmission, now: int) -> int:
        """Return when a frame that is given to a link now should have arrived, ns."""
        capabilities = self.up[link]
        waits_ns = self._outboxes[link].waiting * self._units_ns[link]
        sound_ns = capabilities.airtime_ns(len(frame.frame_bytes))
        return now + waits_ns + sound_ns + seconds_to_ns(capabilities.propagation_s)

    def _links_to(
        self, peer: int, now: int, among: Collection[str], *, is_urgent: bool = False
    ) -> list[str]:
        """Return the links for a frame to a node: those in doubt, and the first that is sure."""
        found: list[str] = []
        for link in self._rules:
            reach = self._reach[link][peer]
            if link not in among:
                continue
            if reach.state is Reach.DOWN and not reach.is_hopeful(now):
                continue
            found.append(link)
            if reach.is_sure(now) if is_urgent else reach.state is Reach.UP:
                return found
        last = self.last_of(among)
        if last is not None and last not in found:
            found.append(last)
        return found

    def _sure_to(self, peer: int, among: Collection[str]) -> str | None:
        """Return the first of some links that surely reaches a node; None: none does."""
        return next(
            (
                link
                for link in self._rules
                if link in among and self._reach[link][peer].state is Reach.UP
            ),
            None,
        )
