"""What goes over one link inside its frames: those of routes and bonds, flooded ones, and probes.

To the link's composer they are one source, and a received frame goes to the route or bond whose
number it has.
"""

from collections.abc import Mapping, Sequence

import msgspec

from zacoustic.core.base.linktypes import ReceivedFrame
from zacoustic.core.base.parts import Offer
from zacoustic.core.base.signals import Signal
from zacoustic.core.bond.bonding import Bonding
from zacoustic.core.relay.flooding import Flooding
from zacoustic.core.relay.prober import Prober
from zacoustic.core.relay.relay import Relay
from zacoustic.core.schedule.sources import Forwarded, ForwardingSource
from zacoustic.core.wire.bond import bond_of
from zacoustic.core.wire.envelope import Opened
from zacoustic.core.wire.flood import is_flooded
from zacoustic.core.wire.relay import decode_probe, is_relayed


class Forwarding:
    """The routes and bonds over one link.

    Args:
        link: Name of the link.
        relay: Its routes; None: there are none.
        bonds: Its bonds, by number.
        others: Numbers of bonds that this node lacks on this link.
        prober: Its probes; None: there are none.
        flooding: Its flooded frames; None: there are none.
    """

    def __init__(
        self,
        link: str,
        relay: Relay | None,
        bonds: Mapping[int, Bonding],
        others: Sequence[int] = (),
        prober: Prober | None = None,
        flooding: Flooding | None = None,
    ) -> None:
        self.relay = relay
        """The routes over the link; None: there are none."""
        self._prober = prober
        self._flooding = flooding
        self._has_others = relay is not None or bool(bonds) or bool(others)
        self._link = link
        self._bonds = dict(bonds)
        self._others = frozenset(others)
        self.began = Signal[int]() if prober is None else prober.begun
        """``(now)``: there is something to transmit, also if `carries` has said otherwise."""
        self._sources: list[ForwardingSource] = [
            *([] if relay is None else [relay]),
            *([] if prober is None else [prober]),
            *([] if flooding is None else [flooding]),
            *(each.outboxes[link] for each in bonds.values()),
        ]

    @property
    def carries(self) -> bool:
        """Whether frames go by it from the beginning: more than probes, which go on command."""
        return self._sources != [self._prober]

    def takes(self, records: bytes) -> bool:
        """Return whether the content of a relayed frame is for one of them."""
        if is_flooded(records):
            return self._flooding is not None
        return self._has_others or (self._prober is not None and decode_probe(records) is not None)

    def goes_in_clear(self, records: bytes) -> bool:
        """Return whether the link does not seal such a frame: it is a probe, or of a bond."""
        if not is_relayed(records) or is_flooded(records):
            return False
        number = bond_of(records)
        is_bonded = number in self._bonds or number in self._others
        return is_bonded or decode_probe(records) is not None

    def handle(self, opened: Opened, frame: ReceivedFrame, now: int) -> str | None:
        """Take such a frame; return why it is dropped, or None."""
        if is_flooded(opened.records) and self._flooding is not None:
            return self._flooding.handle(opened.source, opened.records, frame, now)
        probe = decode_probe(opened.records)
        if probe is not None and self._prober is not None:
            self._prober.handle(opened.source, probe)
            return None
        number = bond_of(opened.records)
        bond = self._bonds.get(number)
        if bond is not None:
            frame = msgspec.structs.replace(frame, destination=opened.destination)
            return bond.handle(self._link, opened.source, opened.records, frame, now)
        if number in self._others:
            return None
        if self.relay is None:
            return "relay_route"
        return self.relay.handle(opened.source, opened.records, frame, now)

    # A source of the composer

    @property
    def goes_on(self) -> bool:
        """Whether the last frame has announced that another one follows at once."""
        return any(each.goes_on for each in self._sources)

    @property
    def is_urgent(self) -> bool:
        """Whether a frame waits that medium access is to treat as urgent."""
        return any(each.is_urgent for each in self._sources)

    @property
    def has_granted(self) -> bool:
        """Whether a frame waits that may go although the node is silent."""
        return any(each.has_granted for each in self._sources)

    def take_granted(self, room_bytes: int, now: int) -> tuple[int, Forwarded] | None:
        """Take the frame that may go in silence, and its destination; None: it does not fit."""
        source = next(each for each in self._sources if each.has_granted)
        return source.take_granted(room_bytes, now)

    def due_at(self, now: int) -> int | None:
        """Return the instant at which a frame is due, ns; None: none."""
        instants = (each.due_at(now) for each in self._sources)
        return min((at for at in instants if at is not None), default=None)

    def offer(self, now: int) -> Offer | None:
        """Return what would go now; None: nothing is due."""
        best = self._best(now)
        return None if best is None else best[0]

    def take(self, room_bytes: int, now: int) -> Forwarded | None:
        """Take the content of the frame that goes now, of at most `room_bytes`."""
        best = self._best(now)
        return None if best is None else best[1].take(room_bytes, now)

    # Below the methods above

    def _best(self, now: int) -> tuple[Offer, ForwardingSource] | None:
        found: tuple[Offer, ForwardingSource] | None = None
        for source in self._sources:
            offer = source.offer(now)
            if offer is not None and (found is None or offer.rank < found[0].rank):
                found = offer, source
        return found
