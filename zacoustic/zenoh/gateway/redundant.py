"""Redundant gateways on one local network: which of them does which job for which stream.

Two gateways on one network receive the same local samples, and each hears on the channel what the
other one sent. Without agreement each sample would cross twice and come back. They agree without
messages, by one rule that each of them applies to the same list, the addresses of the live ones:

==========  =======================================================  ===============================
job         of                                                       done by
==========  =======================================================  ===============================
forward     local samples to the channel                             the lowest of those that may
                                                                     publish the stream
deliver     received samples to the local network, last values       the lowest of those that may
                                                                     subscribe to it
proxy       local calls and goals for a remote server                the lowest
serve       received calls                                           the stream's server
attend      received goals, their feedback and results               the stream's server
==========  =======================================================  ===============================

A topic whose subscribers are all on this network is not forwarded: Zenoh serves them. So what
crosses by Wi-Fi while a vehicle is on deck takes no airtime.

There are two exceptions. A topic with ``{node}`` in its name has different keys for each gateway:
each forwards its own. And no gateway delivers samples that another local gateway sent through the
channel, since the network has them already; because of frames on the air this also holds for
`RETIRED_S` after that gateway is gone. A service whose server is another local gateway is left to
that one.

Samples that several of them forward may come from one local event, at one instant. Their frames
would collide at every receiver, each time, and best-effort samples have no second try. So each
holds them back until the gateways before it can have sent a frame (`Topics.drain`).

When a token disappears from the list, the next lowest gateway takes over. When one appears, the
higher one stands by.
"""

from collections.abc import Collection, Set
from typing import Final

from zacoustic.core.base.clock import Clock, seconds_to_ns
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import Stream

# The longest frame lasts 4 s and arrives from 9 km 6 s later.
RETIRED_S: Final = 10.0
"""How long a gateway that is gone still counts as local, s."""


class RedundantGateways:
    """The gateways of one local network, as one of them sees them; for the loop.

    Args:
        address: Acoustic address of this gateway, always alive.
        clock: Source of instants.
        nodes: Addresses of all nodes of the fleet; empty: unknown.
    """

    def __init__(self, address: int, clock: Clock, nodes: Collection[int] = ()) -> None:
        self.address = address
        self._nodes = frozenset(nodes)
        self._clock = clock
        self._alive = {address}
        self._retired_until: dict[int, int] = {}

    @property
    def alive(self) -> tuple[int, ...]:
        """Addresses of the local gateways, this one included, ascending."""
        return tuple(sorted(self._alive))

    @property
    def rank(self) -> int:
        """Number of local gateways with a lower address."""
        return self.alive.index(self.address)

    def update(self, address: int, *, is_alive: bool) -> bool:
        """Note that a gateway appeared or disappeared; return whether that is new."""
        if address == self.address or is_alive == (address in self._alive):
            return False
        if is_alive:
            self._alive.add(address)
        else:
            self._alive.discard(address)
            self._retired_until[address] = self._clock() + seconds_to_ns(RETIRED_S)
        return True

    def shares_network(self, source: int, stream: Stream) -> bool:
        """Return whether a sample of a node from the channel is local already."""
        if source in self._alive:
            return True
        now = self._clock()
        if now >= self._retired_until.get(source, 0):
            return False
        assert isinstance(stream.spec, TopicSpec)
        # As long as they shared a network with all who want it, it was not transmitted.
        were_here = {each for each, until in self._retired_until.items() if now < until}
        return not self._serves_all(stream.spec, self._alive | were_here)

    def forwards(self, stream: Stream) -> bool:
        """Return whether this gateway transmits local samples of the stream."""
        if not isinstance(stream.spec, TopicSpec) or not stream.may_publish(self.address):
            return False
        if self._serves_all(stream.spec, self._alive):
            return False  # Zenoh itself does
        if stream.keys.is_named_by_node:
            return self.address in stream.keys.node_names
        return self.address == min(each for each in self._alive if stream.may_publish(each))

    def delivers(self, stream: Stream) -> bool:
        """Return whether this gateway delivers received samples of the stream."""
        if not isinstance(stream.spec, TopicSpec) or not stream.may_subscribe(self.address):
            return False
        if self.publishers_beyond(stream) == ():
            return False
        return self.address == min(each for each in self._alive if stream.may_subscribe(each))

    def proxies(self, stream: Stream) -> bool:
        """Return whether this gateway takes calls or goals for a remote server."""
        if not isinstance(stream.spec, ServiceSpec | ActionSpec):
            return False
        return stream.spec.server not in self._alive and self.address == min(self._alive)

    def attends(self, stream: Stream) -> bool:
        """Return whether received goals are for this gateway's network."""
        return isinstance(stream.spec, ActionSpec) and stream.spec.server == self.address

    def asks(self, node: int) -> bool:
        """Return whether this gateway executes or sends a request to a node.

        The gateway of a local node does, and the lowest of them for a remote node that is listed;
        if no node is listed, every address may be there.
        """
        if node in self._alive:
            return node == self.address
        is_known = 1 <= node <= 254 and (not self._nodes or node in self._nodes)
        return is_known and self.address == min(self._alive)

    def publishers_beyond(self, stream: Stream) -> tuple[int, ...] | None:
        """Return the remote nodes that may publish a topic; None: any."""
        assert isinstance(stream.spec, TopicSpec)
        if stream.spec.publishers is None:
            return None
        return tuple(each for each in stream.spec.publishers if each not in self._alive)

    def _serves_all(self, spec: TopicSpec, local: Set[int]) -> bool:
        """Return whether all who want a topic are known, and among some nodes."""
        if spec.subscribers is not None:
            return local >= frozenset(spec.subscribers)
        return len(self._nodes) > 1 and local >= self._nodes
