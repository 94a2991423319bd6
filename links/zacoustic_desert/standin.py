"""A stand-in for DESERT behind its application sockets, by measurements; no clock, no socket.

Each node has an application module (a socket, here `handle_write` and `poll_delivery`), a queue, a
medium access, a modem::

    write ─► unread bytes ─wake─► packet ─► queue ─period─► medium access ─listen─► channel
                                                                                      │
    poll_delivery ◄────────────── is a client there? ◄────────────────────────────────┘

It behaves like DESERT in these points:

- One read takes the present bytes, at most `max_read_length`, and makes one packet of them. The
  reading thread wakes a fraction of a millisecond after a write: closer writes merge, in some runs
  and not in others, and longer ones are split. The period has no influence on that.
- The application module passes on one packet in each period, if it has one. The medium access then
  listens for a constant plus a random time before each packet. It senses no carrier: a third of a
  second of propagation makes that almost useless.
- A packet goes to every other node, or to the partner if nodes are paired. It is one delivery or
  none: without a client nothing is delivered. Bytes that a client wrote before it left are sent.
- DESERT's queues are unbounded; here a node drops packets beyond `QUEUE_LIMIT_PACKETS`.

Instants are ns and never decrease. After any input poll until dry, then wait until `poll_timeout`;
events that are due earlier happen at their own instants. The same seed and calls give the same
result.
"""

import random
from collections import Counter, deque
from collections.abc import Callable
from typing import Final, Literal, TypeAlias

import msgspec

from zacoustic.channel.agenda import Agenda
from zacoustic.channel.arrival import Reception
from zacoustic.channel.driver import Channel, Driver
from zacoustic.core.clock import DURATIONS, is_duration, seconds_to_ns
from zacoustic.errors import ConfigError
from zacoustic_desert.config import READ_LIMIT_BYTES

QUEUE_LIMIT_PACKETS: Final = 100_000
"""Most packets that wait at one node, hours of sound; DESERT has no limit."""


class StandInConfig(msgspec.Struct, frozen=True, kw_only=True):
    """The settings of a DESERT script; the defaults are those of its sample."""

    max_read_length: int = 64
    """Largest read, bytes, 1…4096; one value for all nodes, as in DESERT."""
    period_s: float = 0.2
    """`period_` of the application modules, s, > 0."""
    wait_s: float = 0.1
    """Constant part of the listening time before a packet (`wait_costant_`), s, ≥ 0."""
    listen_s: float = 0.5
    """Longest random part of it (`listen_time_`), s, ≥ 0."""
    wake_s: float = 0.000_5
    """Longest time until the reading thread wakes, s, ≥ 0; closer writes may merge. Measured: they
    merge without a pause, and do not with 1 ms."""
    paired: bool = False
    """Nodes 0 and 1 hear only each other, 2 and 3 as well, and so on: the flows of the sample."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A value outside its range.
        """
        if not 1 <= self.max_read_length <= READ_LIMIT_BYTES:
            raise ValueError(
                f"max_read_length is {self.max_read_length}; allowed: 1..{READ_LIMIT_BYTES}"
            )
        if not is_duration(self.period_s):
            raise ValueError(f"period_s is {self.period_s:g}; allowed: above 0, {DURATIONS}")
        for name in ("wait_s", "listen_s", "wake_s"):
            if not is_duration(getattr(self, name), or_zero=True):
                raise ValueError(f"{name} is {getattr(self, name):g}; allowed: 0 or more")


class Delivery(msgspec.Struct, frozen=True):
    """A packet for the client of a node: one write to its socket."""

    node: int
    """Index of the node."""
    payload: bytes
    """Bytes to write."""


EventName: TypeAlias = Literal[
    "client", "left", "read", "dropped", "sent", "delivered", "lost", "discarded", "crashed"
]
"""Kinds of events: a client came or left; a packet was read from the socket, dropped from a full
queue, sent, delivered to a client, lost on the channel, or discarded without a client; a crash
discarded everything."""


class Observation(msgspec.Struct, frozen=True, kw_only=True):
    """An event of a packet or a client."""

    at: int
    """Instant, ns."""
    event: EventName
    """Kind of the event."""
    node: int
    """Index of the node."""
    size_bytes: int = 0
    """Length of the packet."""
    detail: str = ""
    """Why the packet was lost."""


Observer: TypeAlias = Callable[[Observation], None]
"""Takes all events."""


class StandIn(Driver[bytes]):
    """DESERT from its application modules down.

    Args:
        channel: Channel between the nodes, which are numbered from 0 here, in its order.
        config: Settings of the script.
        rng: Source of all randomness here; the channel has its own.
        observer: Takes all events.

    Raises:
        ConfigError: Nodes are paired, and their number is odd.
    """

    def __init__(
        self,
        channel: Channel,
        config: StandInConfig | None = None,
        *,
        rng: random.Random,
        observer: Observer | None = None,
    ) -> None:
        self.config = config or StandInConfig()
        self._addresses = channel.addresses
        if self.config.paired and len(self._addresses) % 2:
            raise ConfigError(
                f"{len(self._addresses)} nodes cannot be paired; allowed: an even number"
            )
        super().__init__(channel, Agenda())
        self.counts: Counter[str] = Counter()
        """Number of observations by event."""
        self._rng = rng
        self._observer = observer
        self._period_ns = seconds_to_ns(self.config.period_s)
        self._nodes = [_Node(rng.randrange(self._period_ns)) for _ in self._addresses]
        self._deliveries: deque[Delivery] = deque()

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return len(self._nodes)

    def waiting(self, node: int) -> int:
        """Count the packets of a node that are not transmitted yet."""
        return len(self._nodes[node].queue) + len(self._nodes[node].access)

    def handle_client(self, node: int, now: int) -> None:
        """Note that a client was accepted."""
        self.handle_timeout(now)
        self._nodes[node].has_client = True
        self._note("client", node)

    def handle_client_left(self, node: int, now: int) -> None:
        """Note that the client has left; what it has written is still read."""
        self.handle_timeout(now)
        self._nodes[node].has_client = False
        self._note("left", node)

    def handle_write(self, node: int, data: bytes, now: int) -> None:
        """Take bytes that the client has written."""
        self.handle_timeout(now)
        place = self._nodes[node]
        place.unread += data
        if not place.is_waking:
            self._wake(node)

    def handle_crash(self, now: int) -> None:
        """End the process: discard all its state."""
        self.handle_timeout(now)
        self.agenda.clear()
        self._deliveries.clear()
        for node, place in enumerate(self._nodes):
            self._nodes[node] = _Node(place.phase_ns)
            self._note("crashed", node)

    def handle_timeout(self, now: int) -> None:
        """Run due events in order of time."""
        self.agenda.run(now)

    def poll_delivery(self) -> Delivery | None:
        """Return the next write to a client."""
        return self._deliveries.popleft() if self._deliveries else None

    def poll_timeout(self) -> int | None:
        """Return the next due instant, ns; None: none before an input."""
        return self.agenda.next_at()

    def _wake(self, node: int) -> None:
        """Schedule the reading thread's wake-up."""
        self._nodes[node].is_waking = True
        delay_ns = seconds_to_ns(self._rng.random() * self.config.wake_s)
        self.agenda.push(self.agenda.now + delay_ns, self._read, node)

    def _read(self, node: int) -> None:
        """Read once and make one packet."""
        place = self._nodes[node]
        place.is_waking = False
        payload = bytes(place.unread[: self.config.max_read_length])
        del place.unread[: len(payload)]
        if self.waiting(node) >= QUEUE_LIMIT_PACKETS:
            self._note("dropped", node, payload)
        else:
            self._note("read", node, payload)
            place.queue.append(payload)
            if len(place.queue) == 1:
                self.agenda.push(self._next_period(place), self._hand_out, node)
        if place.unread:
            self._wake(node)

    def _next_period(self, place: "_Node") -> int:
        """Return when the next period of a node begins, after now."""
        periods = (self.agenda.now - place.phase_ns) // self._period_ns + 1
        return place.phase_ns + periods * self._period_ns

    def _hand_out(self, node: int) -> None:
        """Begin a period: the application module passes a packet to the medium access."""
        place = self._nodes[node]
        place.access.append(place.queue.popleft())
        if place.queue:
            self.agenda.push(self._next_period(place), self._hand_out, node)
        if not place.is_sending:
            self._listen(node)

    def _listen(self, node: int) -> None:
        """Let the medium access listen before a packet, if there is one."""
        place = self._nodes[node]
        place.is_sending = bool(place.access)
        if place.is_sending:
            listening_s = self.config.wait_s + self._rng.random() * self.config.listen_s
            self.agenda.push(self.agenda.now + seconds_to_ns(listening_s), self._send, node)

    def _send(self, node: int) -> None:
        payload = self._nodes[node].access.popleft()
        emission = self.channel.transmit(self._addresses[node], len(payload), self.agenda.now)
        self._note("sent", node, payload)
        self.spread(emission, payload)
        self.agenda.push(emission.ready_at, self._listen, node)

    def end(self, reception: Reception, sent: bytes, is_noticed: bool) -> None:
        """Handle a packet that has arrived at a node, or is lost."""
        node = self._addresses.index(reception.arrival.node)
        if self.config.paired and reception.arrival.source != self._addresses[node ^ 1]:
            return
        if not reception.is_received:
            self._note("lost", node, sent, reception.outcome.value)
            return
        payload = reception.damage(sent)
        for after_s in reception.delays_s:
            if after_s:
                at = self.agenda.now + seconds_to_ns(after_s)
                self.agenda.push(at, self._deliver, node, payload)
            else:
                self._deliver(node, payload)

    def _deliver(self, node: int, payload: bytes) -> None:
        if not self._nodes[node].has_client:
            self._note("discarded", node, payload)
            return
        self._note("delivered", node, payload)
        self._deliveries.append(Delivery(node, payload))

    def _note(self, event: EventName, node: int, payload: bytes = b"", detail: str = "") -> None:
        self.counts[event] += 1
        if self._observer is not None:
            self._observer(
                Observation(
                    at=self.agenda.now,
                    event=event,
                    node=node,
                    size_bytes=len(payload),
                    detail=detail,
                )
            )


class _Node:
    """One application module and its medium access."""

    def __init__(self, phase_ns: int) -> None:
        # Offset of its periods, ns.
        self.phase_ns = phase_ns
        self.has_client = False
        self.unread = bytearray()
        self.is_waking = False
        self.queue: deque[bytes] = deque()
        self.access: deque[bytes] = deque()
        self.is_sending = False
