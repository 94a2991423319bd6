"""What the components of an engine share; each takes what it needs when it is made.

What a node knows of another node holds on every link: its table, its boot epoch, its presence. So
do the journal and the node's own boot epoch. What depends on airtimes is separate for each link:
the queue, repetitions and their pauses, number windows, runs of objects, counters.
"""

import enum
import random
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from zacoustic.core.base.generators import Generators
from zacoustic.core.base.journal import BOOT_KEY, LIFE_KEY, JournalPort, stored_apart
from zacoustic.core.base.linkids import LinkIds
from zacoustic.core.base.moments import Moments
from zacoustic.core.base.sizes import SIZES, Sizes
from zacoustic.core.base.stats import EngineStats
from zacoustic.core.base.timers import Timers
from zacoustic.core.peers.agreementpolicy import POLICIES, SEALED
from zacoustic.core.peers.alarms import SealAlarms
from zacoustic.core.peers.bootepoch import BootEpoch
from zacoustic.core.peers.contact import Contact
from zacoustic.core.peers.doubt import Doubt
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.peers.lives import Lives
from zacoustic.core.peers.lostcontact import LostContact
from zacoustic.core.peers.measurements import Measurements
from zacoustic.core.peers.peerrules import PeerRules
from zacoustic.core.peers.peers import Peers
from zacoustic.core.peers.reception import Reception
from zacoustic.core.peers.sealing import Seal
from zacoustic.core.peers.statements import Statements
from zacoustic.core.peers.twins import Twins
from zacoustic.core.schedule.hearing import hear_medium
from zacoustic.core.schedule.linkseal import LinkSeal, SealRules, Unsealed
from zacoustic.core.schedule.pacers import Pacers
from zacoustic.core.schedule.queue import TransmitQueue
from zacoustic.core.schedule.replybudget import ReplyBudget
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.seal import Cipher

_SEALING = SealRules()


class NodeContext:
    """The components that a node has once, however many links it has.

    Args:
        address: Address of the node, 1…254.
        table: Its streams.
        epoch: Its boot epoch, 0…65535.
        rng: Source of all randomness; one number is drawn from it.
        stored: The content of the journal, from earlier boot epochs.
        rules: How to treat the other nodes.
        emit: Takes events.
        sizes: The sizes of its number windows and tables.
        cipher: Has the keys of the fleet; None: frames are not sealed.
        sealing: The sealing settings of the config.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        epoch: int,
        rng: random.Random,
        stored: Mapping[str, bytes],
        rules: PeerRules,
        emit: Callable[[Any], None],
        sizes: Sizes = SIZES,
        cipher: Cipher | None = None,
        sealing: SealRules = _SEALING,
    ) -> None:
        self.address = address
        self.table = table
        self.stored = stored
        self.emit = emit
        """Takes an event for the application."""
        self.sizes = sizes
        """The sizes of number windows and tables."""
        self.generators = Generators.drawn_from(rng)
        """Random number generators, one for each component."""
        self.journal = JournalPort()
        """Holds what must survive a restart."""
        self.moments = Moments(stored)
        """Find instants again after a restart."""
        self.timers = Timers()
        """Call components back when an instant has come."""
        self.stats = EngineStats()
        self.peers = Peers()
        """The other nodes, and signals about them."""
        self.measurements = Measurements(self.peers)
        """Measurements of peers and modem."""
        self.doubt = Doubt(address, table, stored, self.journal, emit)
        """Whether something from earlier boot epochs is forgotten."""
        self.twins = Twins(address, self.doubt, emit)
        """Which addresses two nodes have."""
        self.peers.restarted.connect(self.twins.heard_epoch)
        self.seal: Seal | None = None
        """Seals and opens frames; None: they are not sealed."""
        if cipher is not None:
            self.seal = Seal(address, epoch, cipher, self.journal, stored, self._announced)
            self.peers.restarted.connect(self.seal.life_began)
        self.alarms = SealAlarms(emit)
        """Report refused frames."""
        self.sealing = sealing
        """The sealing settings of the config."""
        share = sealing.reply_share if cipher is not None else None
        self.replies = ReplyBudget(share, self.alarms.costly)
        """How much the other nodes can make this node transmit."""
        self.peers.forgotten.connect(self.replies.peer_forgotten)
        self.handshake = Handshake(
            address,
            epoch,
            table,
            self.peers,
            self.generators.of("handshake"),
            SEALED if cipher is not None else POLICIES[rules.agreement],
        )
        """What is agreed with the other nodes."""
        self.lives = Lives(table, stored, self.journal, self.peers)
        """Which boot epochs of other nodes are over."""
        self.contact = Contact(address, rules.contact, self.peers, self.timers, emit)
        """Which nodes are lost."""
        self.lost_contact = LostContact(
            address,
            rules.contact.lost_contact,
            stored,
            journal=self.journal,
            timers=self.timers,
            emit=emit,
        )
        """Whether this node must act because it hears nobody."""
        self.epoch = BootEpoch(self.handshake, self.journal, self.seal)
        """The boot epoch."""

    # Below the methods above

    def _announced(self, address: int) -> bytes:
        peer = self.peers.get(address)
        return peer.digest if peer is not None else b""


class Tunnel(enum.Enum):
    """A link whose frames go inside those of other links."""

    ROUTE = enum.auto()
    BOND = enum.auto()
    FLOOD = enum.auto()


class Context:
    """The node on one link.

    Args:
        node: The components that all links share.
        link: Name of the link.
        index: Index of the link at this node; the first is 0.
        port: The link's number in sealed frames, the same at both ends; None: the index.
        other_end: The only other node on the link; None: there may be more.
        tunnel: What it is if its frames go inside those of other links; None: it is a link.
        quantum_bytes: A frame on the link is paid for as the next multiple of so many bytes.
    """

    def __init__(
        self,
        node: NodeContext,
        link: str,
        index: int = 0,
        port: int | None = None,
        *,
        other_end: int | None = None,
        tunnel: Tunnel | None = None,
        quantum_bytes: int = 1,
    ) -> None:
        apart = index > 0
        self.port_number = index if port is None else port
        """The link's number in sealed frames."""
        self.node = node
        self.link = link
        """Name of the link."""
        self.address = node.address
        self.table = node.table
        self.sizes = node.sizes
        """The sizes of number windows and tables."""
        common = {key: node.stored[key] for key in (LIFE_KEY, BOOT_KEY) if key in node.stored}
        self.stored = {**stored_apart(node.stored, link if apart else None), **common}
        """The journal's content for this link, and the number of this boot."""
        self.ids = LinkIds(link, index)
        """Maps ids of this link to those that the application sees."""
        self.generators = node.generators.apart(link) if apart else node.generators
        """Random number generators, one for each component."""
        self.moments = node.moments
        """Find instants again after a restart."""
        self.journal = node.journal.apart(link) if apart else node.journal
        """Holds what must survive a restart."""
        self.timers = node.timers.apart(link) if apart else node.timers
        """Call components back when an instant has come."""
        self.is_route = tunnel is Tunnel.ROUTE
        """Whether it is a route over relays."""
        self.is_inside = tunnel is not None
        """Whether its frames go inside those of other links."""
        self.other_end = other_end
        """The only other node on this link; None: there may be more."""
        self.others = [each for each in node.table.nodes if each != node.address]
        """Addresses of the listed nodes at other ends of this link; empty: any may be there."""
        if other_end is not None:
            self.others = [other_end]
        self.settling_ns = 0
        """A duplicate may arrive so late, ns, if that is later than the link itself shows."""
        is_tunnel = tunnel is not None
        self.stats = node.stats.on(link, is_tunnel=is_tunnel, quantum_bytes=quantum_bytes)
        self.peers = node.peers
        """The other nodes, and signals about them."""
        self.doubt = node.doubt
        """Whether something from earlier boot epochs is forgotten."""
        self.handshake = node.handshake
        """What is agreed with the other nodes."""
        self.lives = node.lives
        """Which boot epochs of other nodes are over."""
        self.epoch = node.epoch
        """The boot epoch of the node."""
        self.reception = Reception()
        """Dispatches arriving messages to the components that registered for them."""
        self.queue = TransmitQueue(self.generators.of("spread"))
        """Records that wait for a frame."""
        self.seal: Unsealed = Unsealed()
        """Closes the link's frames."""
        if node.seal is not None:
            self.reception.came_again.connect(node.seal.reintroduce)
            self.seal = LinkSeal(
                node.seal, node.sealing, node.table, self.port_number,
                lambda: node.handshake.digest,
            )  # fmt: skip
        self.pacers = Pacers(node.peers, partial(node.handshake.introduce, link))
        if node.seal is not None:
            self.pacers.may_have_restarted.connect(node.seal.pass_mark)
        """When to repeat to each of the other nodes."""
        Statements(self.handshake, self.peers, self.lives, self.reception)
        hear_medium(self.reception)
        self.peers.forgotten.connect(self.queue.peer_forgotten)

    def is_crowd(self) -> bool:
        """Return whether at least two other nodes are known on this link, and not lost.

        When they were heard does not matter: whoever talks to another node is heard by nobody else
        where modems hand over only frames for their own node.
        """
        known, lost = self.others or self.peers, self.node.contact.lost
        are_lost = sum(each in known for each in lost) if lost else 0
        return len(known) - are_lost > 1

    @property
    def is_sealed(self) -> bool:
        """Whether the link's frames are sealed."""
        return self.node.seal is not None

    def emit(self, event: Any) -> None:  # noqa: ANN401 (each transport has its own events)
        """Take an event for the application."""
        self.node.emit(self.ids.of_event(event))
