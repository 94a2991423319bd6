"""Contact: a node shows the others that it is alive, and notices when another one falls silent.

An idle fleet is silent. So silence does not tell whether a vehicle has nothing to say or is gone,
and a vehicle cannot tell whether it should surface. Two settings answer that at a cost: a node
transmits a *heartbeat*, the smallest possible frame, when it has sent nothing else for a time; and
a node counts as *lost* when no frame of it was heard for a time, until it is heard again. The
configuration has both per node. Without them nothing is sent and no timer is armed.

- A frame to one node alone does not replace the heartbeat for the others.
- Each pause is drawn anew, so heartbeats that collided do not collide again.
- Any frame that can be opened is a sign of life of its source, whatever its destination. A modem's
  acknowledgement alone is not: the computer behind the modem may be dead.
- A heartbeat carries HELLO or TAG until every node has confirmed this boot epoch, so it shows a
  restart.
"""

from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.timers import Due, Timers
from zacoustic.core.peers.lostcontact import LostContactRule
from zacoustic.core.peers.peers import Peers
from zacoustic.core.peers.states import REACHABILITY, Change, Reachability

LEAST_HEARTBEAT_S: Final = 1.0
"""Shortest pause between heartbeats, s: a modem's smallest frame lasts a quarter of that."""
LEAST_MISSED: Final = 2
"""Fewest missed heartbeats after which a node is lost: any single one may be lost."""


class ContactRules(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of heartbeats, and of the time after which a node is lost."""

    heartbeat_s: float | None = None
    """Longest time between two frames of this node, s; None: no heartbeats."""
    lost_after_s: dict[int, float] = {}
    """Address of a node → time without a frame of it after which it is lost, s."""
    others_lost_after_s: float | None = None
    """The same for all other nodes that were heard at least once; None: never."""
    lost_contact: tuple[LostContactRule, ...] = ()
    """When this node must act because it hears nobody."""
    announces: bool = False
    """Whether this node transmits a frame soon after a restart, so that what waits for it comes."""


class Sighting(msgspec.Struct, frozen=True, kw_only=True):
    """Whether a node is lost."""

    state: Reachability
    """Whether this node hears it."""
    since: int
    """Instant at which this state began, ns."""
    heard_at: int | None
    """Instant of its last frame, ns; None: none since the start of this node."""

    @property
    def is_lost(self) -> bool:
        """No frame of it came for the configured time."""
        return self.state is Reachability.LOST


class PeerLost(msgspec.Struct, frozen=True, kw_only=True):
    """No frame of a node came for the configured time."""

    address: int
    """The node."""
    heard_at: int | None
    """Instant of its last frame, ns; None: none since the start of this node."""
    lost_at: int
    """Instant from which it counts as lost, ns."""


class PeerFound(msgspec.Struct, frozen=True, kw_only=True):
    """A node that was lost is heard again."""

    address: int
    """The node."""
    found_at: int
    """Instant, ns."""


class Contact:
    """Which nodes this one has lost, over all its links.

    Args:
        address: Address of the node.
        rules: The settings.
        peers: The other nodes.
        timers: Fire when a node becomes lost.
        emit: Takes events.
    """

    def __init__(
        self,
        address: int,
        rules: ContactRules,
        peers: Peers,
        timers: Timers,
        emit: Callable[[PeerLost | PeerFound], None],
    ) -> None:
        self._address = address
        self._rules = rules
        self._timers = timers
        self._emit = emit
        self._has_begun = False
        self._sightings: dict[int, Sighting] = {}
        self.lost: set[int] = set()
        """Nodes that have been silent for so long that they count as lost; read-only."""
        peers.forgotten.connect(self._forget)

    def begin(self, now: int) -> None:
        """Note the first instant of the boot epoch; later calls have no effect."""
        if self._has_begun:
            return
        self._has_begun = True
        for address in self._rules.lost_after_s:
            if address != self._address:
                self._sightings.setdefault(
                    address, Sighting(state=REACHABILITY.first, since=now, heard_at=None)
                )
                self._arm(address)

    def heard(self, source: int, now: int) -> None:
        """Note a frame of a node, whatever its destination."""
        known = self._sightings.get(source)
        since = now if known is None or known.is_lost else known.since
        before = REACHABILITY.first if known is None else known.state
        state = REACHABILITY.after(before, Change.FRAME)
        self._sightings[source] = Sighting(state=state, since=since, heard_at=now)
        self.lost.discard(source)
        self._arm(source)
        if known is not None and known.is_lost:
            self._emit(PeerFound(address=source, found_at=now))

    def sightings(self) -> dict[int, Sighting]:
        """Return the sighting of each node that can be lost, by address."""
        return {
            address: self._sightings[address]
            for address in sorted(self._sightings)
            if self._lost_after_s(address) is not None
        }

    # Below the methods above

    def _forget(self, address: int, now: int) -> None:
        self._sightings.pop(address, None)
        self.lost.discard(address)
        self._timers.cancel((Due.CONTACT, address))

    def _lost_after_s(self, address: int) -> float | None:
        return self._rules.lost_after_s.get(address, self._rules.others_lost_after_s)

    def _arm(self, address: int) -> None:
        """Arm the timer after which a silent node becomes lost."""
        lost_after_s, known = self._lost_after_s(address), self._sightings[address]
        if lost_after_s is not None:
            seen_at = known.since if known.heard_at is None else known.heard_at
            lost_at = seen_at + seconds_to_ns(lost_after_s)
            self._timers.at((Due.CONTACT, address), lost_at, partial(self._lose, address))

    def _lose(self, address: int, now: int) -> None:
        known = self._sightings[address]
        heard_at, state = known.heard_at, REACHABILITY.after(known.state, Change.SILENCE)
        self._sightings[address] = Sighting(state=state, since=now, heard_at=heard_at)
        self.lost.add(address)
        self._emit(PeerLost(address=address, heard_at=heard_at, lost_at=now))
