"""The engine: one node's protocol as a function of its inputs. This file holds only the wiring.

Contract for the shell that drives an engine (the runtime, the virtual network, a test):

- Four kinds of methods. *Inputs* ``handle_*`` and *commands* (`publish`, `call`, …) change state;
  *outputs* ``poll_*`` take what the engine wants; *getters* change nothing.
- After any input or command poll until dry: `poll_journal`, `poll_transmit`, `poll_event` until
  None; then re-arm one timer from `poll_timeout`.
- ``now`` is an instant in ns of one monotonic clock and never decreases. A timer that fires early
  is handed the instant that was asked for.
- After a transmission its link sends nothing until `handle_transmit_report` has been called.
- An input from a link carries the link's name; without one it is from the first link. A
  transmission carries the name of its link.
- Call `handle_journal_committed` once a journal write from `poll_journal` is safe.
- Inputs from the channel never raise; any exception from them is a bug, and a new engine then
  continues from the journal (`zacoustic.run.replacement`). Commands raise `LocalError`s.

Who does what, on each link (`zacoustic.core.engine.linkstack`)::

    publish, call ──► TransmitQueue ──► Composer ──► Envelope ──► poll_transmit
                                           ▲ Handshake (may it be decoded, what is owed)
    poll_event ◄── Receiver ◄── Envelope ◄── handle_frame
                                MediumAccess: when a frame may start
    ranging.request, .repeat ──► Composer: frames sent to measure a range
    measurements ◄── handle_measurement, handle_frame

A stream goes by the link, route or bond that `TransmitRules.links_of_streams` names, else by
`default_link`, or the first link; so do remote commands. Ranges are measured on the first link. The
handshake is one for all links.

The wire profile of the stream table (`StreamTable.wire`) decides what is transmitted and
understood. Medium access and airtime caps are the same for all profiles.
"""

import random
from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TypeVar

from zacoustic.core.base.journal import BOOT_KEY, JournalWrite
from zacoustic.core.base.linktypes import (
    LinkCapabilities,
    LinkState,
    Measurement,
    PeerMeasured,
    ReceivedFrame,
    Transmission,
    TransmitReport,
)
from zacoustic.core.base.qos import Override
from zacoustic.core.base.sizes import SIZES, Sizes
from zacoustic.core.base.trace import Tracer, TraceSink
from zacoustic.core.base.waits import Waits
from zacoustic.core.bond.bonding import BondStatus
from zacoustic.core.engine.bondports import BondPorts
from zacoustic.core.engine.commands import AwaitedSamples, GoalCommands, SubscriptionCommands
from zacoustic.core.engine.events import Event, JournalStateChanged, LinkStateChanged
from zacoustic.core.engine.floodport import FloodPort
from zacoustic.core.engine.forwarding import Forwarding
from zacoustic.core.engine.linkstack import LinkStack
from zacoustic.core.engine.routeports import RoutePorts
from zacoustic.core.peers.handshake import PeerSeen
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.relay.paths import PathState
from zacoustic.core.relay.relay import Hop
from zacoustic.core.relay.route import Route
from zacoustic.core.schedule.access import AccessState
from zacoustic.core.schedule.context import Context, NodeContext, Tunnel
from zacoustic.core.schedule.hosttime import HostTime
from zacoustic.core.schedule.silence import Silence
from zacoustic.core.schedule.transmitter import Opening
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import StreamSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.transport.carry.status import CarryStatus, sum_of
from zacoustic.core.transport.commands.commands import Commands
from zacoustic.core.transport.commands.overrides import Overrides
from zacoustic.core.transport.contract import MakeTransport, Transport
from zacoustic.core.transport.deliveries import DeliveryEnded
from zacoustic.core.transport.keydelivery import KeyDelivery
from zacoustic.core.transport.publication import Publication
from zacoustic.core.transport.routing import Routing
from zacoustic.core.transport.status import Status
from zacoustic.core.wire.calls import CallFailure, CallKey
from zacoustic.core.wire.seal import Cipher
from zacoustic.errors import LocalError

OtherTransport = TypeVar("OtherTransport", bound=Transport)
_NO_RULES = TransmitRules()


class Engine:
    """One node's protocol.

    Args:
        address: Address of this node, 1…254.
        table: Its streams.
        epoch: Boot epoch, 0…65535; different after each start of the node.
        rng: Source of all randomness; one number is drawn from it.
        stored: The content of the journal, from earlier boot epochs.
        rules: The rules of the config for transmission.
        trace: Takes a record of each action, or None.
        transports: Make third-party transports, one for each link
            (`zacoustic.core.transport.contract`).
        sizes: The sizes of its number windows and tables.
        cipher: Has the keys of the fleet; then `epoch` must be a number that no other start of the
            node uses. None: frames are not sealed.
    """

    def __init__(
        self,
        *,
        address: int,
        table: StreamTable,
        epoch: int,
        rng: random.Random,
        stored: Mapping[str, bytes] = MappingProxyType({}),
        rules: TransmitRules = _NO_RULES,
        trace: TraceSink | None = None,
        transports: Sequence[MakeTransport] = (),
        sizes: Sizes = SIZES,
        cipher: Cipher | None = None,
    ) -> None:
        self.address = address
        self.table = table
        self.stored = {key: each for key, each in stored.items() if key != BOOT_KEY}
        self.journal_failure = ""
        """Why the journal cannot be written now; empty: it can. Read-only."""
        self._trace = Tracer(address, trace)
        self._now = 0
        self._events: deque[Event] = deque()
        self._handed_over: Event | None = None
        self._has_begun = False
        emit = self._events.append
        node = NodeContext(
            address, table, epoch, rng, stored, rules.of_peers, emit, sizes, cipher, rules.sealing
        )
        self.stats = node.stats
        self._peers, self._handshake, self._epoch = node.peers, node.handshake, node.epoch
        self._seal, self._tell_utc = node.seal, node.moments.tell
        self._journal, self._timers = journal, timers = node.journal, node.timers
        self.measurements = node.measurements
        """Measurements of peers and modems; read-only."""
        self.doubt = node.doubt
        """Whether something from earlier boot epochs is forgotten; read-only."""
        self.twins = node.twins
        """Which addresses two nodes have; read-only."""
        self.contact = node.contact
        """Which nodes are lost; read-only."""
        self.lost_contact = node.lost_contact
        """Whether this node must act because it hears nobody; the shell reports `acted`."""
        self.clock = HostTime(
            rules.schedule, bool(rules.quiet), stored, journal=journal, timers=timers, emit=emit
        )
        """What is known of UTC; read-only."""
        self.silence = Silence(
            rules.quiet, stored, host=self.clock, journal=journal, timers=timers, emit=emit
        )
        """Commands about transmit silence: `begin` and `resume`."""
        self._stacks: dict[str, LinkStack] = {}
        self._route_ports = RoutePorts(address, rules)
        self._flood_port = FloodPort(rules.flood)
        self._bond_ports = BondPorts(address, table, rules, self.silence)
        self._links = tuple(each.name for each in rules.of_links)
        self._make_stacks(node, rules, transports)
        # Of the routes over relays only those that end here are links, of the bonds only those
        # with a link of this node.
        self._links_of_streams = {
            stream_id: name
            for stream_id, name in rules.links_of_streams.items()
            if name in self._stacks
        }
        self._first = next(iter(self._stacks.values()))
        self._default = self._stacks.get(rules.default_link, self._first)
        self.ranging = self._first.protocols.ranging
        """Commands about ranges: `request`, `cancel` and `repeat`."""
        self.actions = GoalCommands(self._stack_of)
        """Commands about goals: `send_goal` and `cancel_goal`, `accept`, `finish` and others."""
        self.subscriptions = SubscriptionCommands(self._stack_of)
        """Commands and getters about on-demand topics: `want`, `subscribers` and others."""
        self.deadlines = AwaitedSamples(self._stacks.values())
        """The awaited samples; read-only."""
        overrides = Overrides(
            address, table, override=self._override, stored=stored, journal=journal
        )
        self.commands = Commands(
            node, self._default.protocols.services, overrides, self.silence, rules.commands_from
        )
        """Commands to other nodes, and to this one: `send`, `execute`."""
        self.status = Status(
            node, self._default.protocols.services, self.clock, rules.of_links[0].access
        )
        """Questions about the status of other nodes, and that of this one: `ask`, `own`."""
        self.keys = KeyDelivery(node, self._default.protocols.services, rules.commands_from)
        """Delivery of the keys for broadcasts to other nodes: `send`."""
        self._paths = self._route_ports.paths(node)
        self.routing = Routing(
            node,
            self._default.protocols.services,
            rules.commands_from,
            self._route_ports.prober,
            self._paths,
        )
        """Commands about routes, and probes: `send`, `execute`."""
        self._has_tunnels = len(self._stacks) > len(self._links)
        for stack in self._stacks.values():
            stack.protocols.recover()

    # Inputs

    def handle_frame(self, frame: ReceivedFrame, now: int, link: str | None = None) -> None:
        """Take a frame, or a piece of a byte stream."""
        self._now = now
        self._stack(link).handle_frame(frame, now)
        self._tell_news(now)

    def handle_transmit_report(
        self, report: TransmitReport, now: int, link: str | None = None
    ) -> None:
        """Take the report of a transmission that has ended."""
        self._now = now
        self._stack(link).handle_report(report, now)

    def handle_link_state(
        self,
        state: LinkState,
        now: int,
        capabilities: LinkCapabilities | None = None,
        link: str | None = None,
    ) -> None:
        """Take a link's state; `capabilities` come with UP, and when they change."""
        self._now = now
        self._begin(now)
        stack = self._stack(link)
        has_changed = stack.handle_state(state, capabilities, now)
        self._route_ports.handle_state(stack, state, capabilities, now)
        self._flood_port.handle_state(stack, state, capabilities, now)
        for each in (stack, *self._route_ports.over(stack.name)):
            self._bond_ports.handle_state(each, each.state, now)
        if has_changed:
            self._events.append(LinkStateChanged(state=state, changed_at=now, link=stack.name))
            self._trace.note(now, "link", detail=state.value, link=stack.name)

    def handle_carrier(self, busy: bool, now: int, link: str | None = None) -> None:
        """Record the begin or end of another node's transmission at this node."""
        self._now = now
        port = self._stack(link).transmitter.port
        if port is not None:
            port.handle_carrier(busy, now)

    def handle_clock(self, offset_ns: int, error_ns: int | None, now: int) -> None:
        """Take the host's time: UTC is `now + offset_ns`, within `error_ns`; None: error unknown.

        Call it once before the link is up, when the offset has changed by more than the driver's
        jitter, and at least every ten seconds while the engine is driven.
        """
        self._now = now
        self._begin(now)
        error_ns = self.clock.tell(offset_ns, error_ns, now)
        if error_ns is not None:
            self._tell_utc(offset_ns)
        self.silence.handle_clock(now)
        for stack in self._stacks.values():
            stack.transmitter.handle_clock(offset_ns, error_ns, now)

    def handle_measurement(
        self, measurement: Measurement, now: int, link: str | None = None
    ) -> None:
        """Take a measurement of a peer, or a reading of the modem."""
        self._now = now
        stack = self._stack(link)
        peer = measurement.address if isinstance(measurement, PeerMeasured) else 0
        if isinstance(measurement, PeerMeasured):
            if not 1 <= peer <= 254 or peer == self.address:
                self.stats.drop("address")
                return
            stack.protocols.ranging.measured(measurement)
        self.measurements.handle(measurement, stack.name)
        self._events.append(measurement)
        self._trace.note(now, "measure", peer=peer)

    def handle_timeout(self, now: int) -> None:
        """Fire the timers at the instant that `poll_timeout` returned."""
        self._now = now
        self.silence.keep(now)
        for stack in self._stacks.values():
            stack.protocols.handle_timeout(now)
        self._timers.fire(now)
        for stack in self._stacks.values():
            stack.transmitter.handle_timeout(now)

    def handle_journal_committed(self, write_id: int, now: int) -> None:
        """Record that a journal write is safe."""
        self._now = now
        for stack in self._stacks.values():
            stack.protocols.note(now)
        self._journal.committed(write_id, now)
        self._tell_news(now)  # a sealed frame is read once the journal has its number

    def handle_journal_state(self, failure: str, now: int) -> None:
        """Record why the journal cannot be written; empty: it can again."""
        self._now = now
        if failure != self.journal_failure:
            self.journal_failure = failure
            self._journal.fail(failure)
            self._events.append(JournalStateChanged(failure=failure, changed_at=now))
            self._trace.note(now, "journal", detail="fails" if failure else "works")

    def handle_waiting(self, link: str, now: int) -> None:
        """Record that samples wait outside of the engine until a link, route or bond is open.

        Medium access then treats this node as one that has something to send.
        """
        self._now = now
        self._stack(link).transmitter.handle_waiting(now)

    # Commands

    def declare(self, spec: StreamSpec, now: int) -> Stream:
        """Add a stream to the table; begins a new epoch, since peers confirmed another table.

        Raises:
            ConfigError: The id or name is taken, or the spec is wrong.
        """
        self._now = now
        stream = self.table.declare(spec)
        for stack in self._stacks.values():
            stack.declared(stream)
        self._epoch.begin(now)
        return stream

    def publish(
        self,
        stream_id: int,
        value: object,
        now: int,
        *,
        instance: Instance = (),
        encoding: str | None = None,
        delete: bool = False,
        queued_at: int | None = None,
        is_dated: bool = True,
    ) -> int:
        """Queue a sample of a topic.

        Args:
            stream_id: The topic's stream.
            value: The value in the stream's type; bytes for an opaque stream; ignored for a delete.
            now: The instant.
            instance: One value number for each wildcard of the topic's name.
            encoding: The Zenoh encoding, where it is not the stream's.
            delete: Delete the key instead.
            queued_at: Instant at which the sample was made, ns, if that was before `now`.
            is_dated: Whether that is known; otherwise its age crosses as unknown.

        Returns:
            For a reliable topic the delivery id that `DeliveryEnded` will name, else 0.

        Raises:
            UnknownStreamError: No such topic, or an instance that its name does not have.
            LocalError: This node may not publish it.
            PayloadInvalidError: The type does not allow the value.
            PayloadTooLargeError: It fits no frame of this link.
        """
        self._now = now
        stack = self._stack_of(stream_id)
        publication = Publication(stream_id, value, instance, encoding, delete, queued_at, is_dated)
        delivery_id = stack.protocols.publish(publication, now)
        return stack.ids.outer(delivery_id)

    def cancel_delivery(self, delivery_id: int, now: int) -> bool:
        """Cancel a reliable sample; return False when it is not under way.

        `DeliveryEnded` follows; receivers that have part of a large one are informed.
        """
        self._now = now
        stack = self._issuer(delivery_id)
        return stack is not None and stack.protocols.cancel_delivery(
            stack.ids.inner(delivery_id), now
        )

    def refuse_object(self, source: int, transfer: int, now: int, link: str | None = None) -> bool:
        """Refuse the rest of an object named by `ObjectProgress`; return False if it has ended."""
        self._now = now
        return self._stack(link).protocols.refuse_object(source, transfer, now)

    def call(
        self, stream_id: int, value: object, now: int, *, timeout_s: float | None = None
    ) -> int:
        """Call a service; return the call id that the answer will name.

        Raises:
            UnknownStreamError: No such service.
            LocalError: This node is the server.
            PayloadInvalidError: The request's type does not allow the value.
            PayloadTooLargeError: It fits no frame of this link.
            QueueFullError: 16 calls to this service are under way or ended too recently.
        """
        self._now = now
        stack = self._stack_of(stream_id)
        return stack.protocols.call(stream_id, value, now, timeout_s=timeout_s)

    def cancel(self, call_id: int, now: int) -> None:
        """Cancel a call: its request is not sent if it still waits, and no event follows."""
        self._now = now
        stack = self._issuer(call_id)
        if stack is not None:
            stack.protocols.cancel(call_id, now)

    def reply(self, call: CallKey, value: object, now: int) -> bool:
        """Answer a request; return False when it is too late or was answered before.

        A response that cannot be sent is an error of the service: the caller gets that error before
        it is raised here.

        Raises:
            PayloadInvalidError: The response's type does not allow the value.
            PayloadTooLargeError: It fits no frame of this link.
        """
        self._now = now
        return self._stack_of(call.stream_id).protocols.reply(call, value, now)

    def reply_error(self, call: CallKey, failure: CallFailure, text: str, now: int) -> bool:
        """Answer a request with an error, its text cut to 48 bytes. False as for `reply`."""
        self._now = now
        return self._stack_of(call.stream_id).protocols.reply_error(call, failure, text, now)

    # Outputs

    def poll_transmit(self, now: int) -> Transmission | None:
        """Return the frame that is worth most now, for the first link that can take one."""
        self._now = now
        if self._has_tunnels:
            self._bond_ports.submit(now)  # also to routes
            self._route_ports.submit(now)
            self._flood_port.submit(now)
        for link in self._links:
            made = self._stacks[link].make(now)
            if made is not None:
                return made
        return None

    def poll_journal(self) -> JournalWrite | None:
        """Return the next journal write."""
        if self._handed_over is not None:
            self._settle_event()
        return self._journal.poll()

    def poll_event(self) -> Event | None:
        """Return the next event for the application.

        With the next poll for an event or a journal write the application has taken it.
        """
        now, doubt = self._now, self.silence.clock_doubt
        transmitters = [each.transmitter for each in self._stacks.values()]
        for each in transmitters:
            doubt = doubt or (each.clock_doubt(now) if each.has_schedule else "")
        self.clock.review(doubt, now)
        for each in transmitters:
            each.review(now)
        if self._handed_over is not None:
            self._settle_event()
        self._handed_over = self._events.popleft() if self._events else None
        return self._handed_over

    def poll_timeout(self) -> int | None:
        """Return the instant at which to call `handle_timeout`, ns; None: it awaits inputs only."""
        now, earliest = self._now, self._timers.next_at()
        for stack in self._stacks.values():
            frame_at = stack.transmitter.next_at(now)
            if frame_at is not None and (earliest is None or frame_at < earliest):
                earliest = frame_at
        return None if earliest is None else max(earliest, now)

    # Getters

    def access_state(self, link: str | None = None) -> AccessState | None:
        """Return what the schedule of a link does at present; None: it has none.

        Args:
            link: Name of the link; None: the first.
        """
        return self._stack(link).transmitter.access_state(self._now)

    @property
    def seal_failure(self) -> str:
        """Why frames cannot be sealed, so that nothing is transmitted; empty: they can."""
        return self._seal.failure if self._seal is not None else ""

    @property
    def epoch(self) -> int:
        """The current boot epoch."""
        return self._handshake.epoch

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links; the first one serves streams that name none."""
        return self._links

    @property
    def link_state(self) -> LinkState:
        """The last reported state of the first link."""
        return self._first.state

    @property
    def capabilities(self) -> LinkCapabilities | None:
        """The capabilities of the first link; None before it was up."""
        return self._first.capabilities

    def state_of(self, link: str) -> LinkState:
        """Return the last reported state of a link."""
        return self._stack(link).state

    def capabilities_of(self, link: str) -> LinkCapabilities | None:
        """Return the capabilities of a link; None before it was up."""
        return self._stack(link).capabilities

    @property
    def hops(self) -> list[Hop]:
        """How the hops from this node to the next ones of its routes do."""
        relays = (self._stacks[link].relay for link in self._links)
        return [hop for relay in relays if relay is not None for hop in relay.hops()]

    @property
    def routes(self) -> tuple[Route, ...]:
        """The routes over relays that end here; each is a link for the streams."""
        return tuple(route for route, _, _ in self._route_ports.ends)

    @property
    def changed_paths(self) -> Mapping[str, PathState]:
        """The routes whose path commands have changed, by name."""
        return self._paths.changed

    @property
    def bonds(self) -> list[BondStatus]:
        """What the bonds of links do at present; each is a link for the streams."""
        return self._bond_ports.statuses

    @property
    def carry(self) -> CarryStatus | None:
        """What this node keeps of carried topics; None: its table has none."""
        kept = [each.protocols.carry for each in self._stacks.values()]
        return sum_of([each for each in kept if each is not None])

    def link_of(self, stream_id: int) -> str:
        """Return the name of the link, route or bond that a stream uses."""
        return self._stack_of(stream_id).name

    def waits(self, now: int, link: str | None = None) -> Waits | None:
        """Return why the next frame waits; None: nothing waits, or it goes at once.

        Args:
            now: The instant, ns.
            link: Name of the link, route or bond; None: the first.
        """
        return self._stack(link).transmitter.waits(now)

    def opening(self, link: str, now: int) -> Opening:
        """Return whether a link, route or bond can take a frame of records now."""
        return self._stack(link).transmitter.opening(now)

    @property
    def is_idle(self) -> bool:
        """Whether nothing waits, nothing is under way, and no timer is armed."""
        is_idle = all(stack.is_idle for stack in self._stacks.values())
        return is_idle and self.poll_timeout() is None

    @property
    def owes_acknowledgement(self) -> bool:
        """Whether an acknowledgement waits and this node may transmit."""
        now = self._now
        return not self.silence.is_silent(now) and any(
            stack.state is LinkState.UP and stack.protocols.frames.owes_acknowledgement(now)
            for stack in self._stacks.values()
        )

    def transport(self, kind: type[OtherTransport], link: str | None = None) -> OtherTransport:
        """Return the third-party transport of a class; each link has its own.

        Raises:
            LocalError: This engine was made without it.
        """
        made = self._stack(link).protocols.transports
        for each in made.values():
            if isinstance(each, kind):
                return each
        names = ", ".join(made) or "none"
        raise LocalError(f"no transport {kind.name}; this engine has: {names}")

    def delivering(self, stream_id: int) -> int:
        """Return how many reliable samples of a stream have not ended."""
        return self._stack_of(stream_id).protocols.delivering(stream_id)

    def is_delivering(self, delivery_id: int) -> bool:
        """Return whether a reliable sample has not ended."""
        stack = self._issuer(delivery_id)
        return stack is not None and stack.protocols.is_delivering(stack.ids.inner(delivery_id))

    def pending(self, stream_id: int) -> int:
        """Return how many payloads of a stream wait."""
        return self._stack_of(stream_id).protocols.pending(stream_id)

    def forget(self, address: int, now: int) -> None:
        """Free everything that is kept of another node, in the journal as well.

        For a node that will not return: the state of its calls, goals and samples is lost. Calls to
        it end as cancelled; payloads that wait for it in the queue stay.

        Args:
            address: The node.
            now: The instant, ns.
        """
        self._now = now
        self._peers.forget(address, now)

    def expire(self, now: int) -> int | None:
        """Drop expired payloads; return when the next one expires, ns, or None."""
        instants = (each.protocols.queue.drop_expired(now) for each in self._stacks.values())
        return min((at for at in instants if at is not None), default=None)

    @property
    def expired(self) -> dict[int, int]:
        """Payloads that became too old before they were sent, by stream."""
        return _sum(each.protocols.queue.expired for each in self._stacks.values())

    @property
    def superseded(self) -> dict[int, int]:
        """Payloads replaced by newer ones before they were sent, by stream."""
        return _sum(each.protocols.queue.superseded for each in self._stacks.values())

    def peers(self) -> dict[int, bool]:
        """Return the nodes heard so far, and whether each has confirmed this node's table."""
        known, digest = self._handshake.peers(), self._handshake.digest
        if self._handshake.is_sealed:
            return {each: peer.shares(digest) for each, peer in known.items()}
        return {each: peer.confirmed_us for each, peer in known.items()}

    # Below the methods above

    def _make_stacks(
        self, node: NodeContext, rules: TransmitRules, transports: Sequence[MakeTransport]
    ) -> None:
        """Make the stack of each link, of each route that ends here, of each bond, of flooding."""
        links = [
            (
                own,
                Context(node, own.name, index, own.port, quantum_bytes=own.bonded.quantum_bytes),
            )
            for index, own in enumerate(rules.of_links)
        ]
        ends = [
            (
                route,
                own,
                Context(node, own.name, index, own.port, other_end=other_end, tunnel=Tunnel.ROUTE),
            )
            for index, (route, other_end, own) in enumerate(self._route_ports.ends, len(links))
        ]
        bonds = [
            (own, self._bond_ports.make(bond, own, node, index))
            for index, (bond, own) in enumerate(self._bond_ports.here, len(links) + len(ends))
        ]

        def make(
            own: LinkRules, context: Context, forwarding: Forwarding | None = None
        ) -> LinkStack:
            stack = LinkStack(
                context, rules, own, self.silence, self._trace, transports, forwarding
            )
            self._stacks[own.name] = stack
            return stack

        for own, context in links:
            over = (
                self._route_ports.relay(context),
                self._route_ports.prober_on(context),
                self._flood_port.flooding_on(context),
            )
            make(own, context, self._bond_ports.forwarding(own.name, *over))
        for route, own, context in ends:
            stack = make(own, context, self._bond_ports.forwarding(own.name))
            hop_relay = self._stacks[route.link].relay
            assert hop_relay is not None
            self._route_ports.add(route, stack, hop_relay)
        for own, context in bonds:
            self._bond_ports.add(make(own, context))
        if (flood := self._flood_port.rules) is not None:
            index = len(self._stacks)
            context = Context(node, flood.name, index, flood.port, tunnel=Tunnel.FLOOD)
            self._flood_port.add(make(flood, context))

    def _settle_event(self) -> None:
        """Note that the application has taken the last event."""
        event, self._handed_over = self._handed_over, None
        if isinstance(event, DeliveryEnded):
            stack = self._issuer(event.delivery_id)
            if stack is not None:
                stack.protocols.end_taken(stack.ids.inner(event.delivery_id))

    def _begin(self, now: int) -> None:
        """Record the first instant since the restart; later calls have no effect."""
        if self._has_begun:
            return
        self._has_begun = True
        self.contact.begin(now)
        self.lost_contact.begin(now)
        self._handshake.begin(now)
        for stack in self._stacks.values():
            stack.protocols.begin(now)

    def _stack(self, link: str | None) -> LinkStack:
        if link is None:
            return self._first
        stack = self._stacks.get(link)
        if stack is None:
            raise LocalError(f"no link {link!r}; allowed: {', '.join(self._stacks)}")
        return stack

    def _stack_of(self, stream_id: int) -> LinkStack:
        named = self._links_of_streams.get(stream_id)
        return self._default if named is None else self._stack(named)

    def _issuer(self, outer: int) -> LinkStack | None:
        """Return the link that has assigned an id; None: none has."""
        return next((each for each in self._stacks.values() if each.ids.issued(outer)), None)

    def _override(self, stream: Stream, override: Override) -> None:
        self._stack_of(stream.stream_id).protocols.override(stream, override)

    def _tell_news(self, now: int) -> None:
        """Emit the events about the sender of a frame."""
        for news in self._handshake.news:
            self._events.append(news)
            if isinstance(news, PeerSeen):
                detail = "same_table" if news.same_table else "other_table"
                self._trace.note(now, "peer", peer=news.address, detail=detail)
            else:
                self._trace.note(now, "differ", peer=news.address, streams=(news.stream_id,))
        self._handshake.news.clear()


def _sum(counters: Iterable[Mapping[int, int]]) -> dict[int, int]:
    return dict(sum(map(Counter, counters), Counter[int]()))
