"""A stand-in for DESERT behind its application sockets, as it was measured; no clock, no socket.

Each node has an application module (a socket, here `handle_write` and `poll_delivery`), a queue, a
medium access, a modem::

    write ─► unread bytes ─wake─► packet ─► queue ─period─► medium access ─listen─► channel
                                                                                      │
    poll_delivery ◄────────────── is a client there? ◄────────────────────────────────┘

What it does as the original does:

- One read takes what is there, `max_read_length` bytes at most, and becomes one packet. The thread
  that reads wakes a fraction of a millisecond after a write: writes closer together merge, in some
  runs and not in others, and longer ones are split. The period has no influence on that.
- The application module hands out one packet in each period, if it has one. The medium access then
  listens for a constant time and a random one before each packet. It senses no carrier: a third of
  a second of propagation makes that worth little.
- A packet goes to every other node, or to the partner where nodes are paired. It is one delivery,
  or nothing: no client, no delivery. Bytes that a client has written before it left are sent.
- Queues are unbounded there; here a node drops packets beyond `QUEUE_LIMIT_PACKETS`.

Instants are ns and never decrease. After any input poll until dry, then wait until `poll_timeout`;
events due before an instant happen at their own instants. Same seed, same calls,
same result.
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
"""Packets that wait at one node; the original has no limit. Hours of sound."""


class StandInConfig(msgspec.Struct, frozen=True, kw_only=True):
    """The settings of a DESERT script; the defaults are its sample's."""

    max_read_length: int = 64
    """Largest read, bytes, 1…4096; one value for all nodes, as there."""
    period_s: float = 0.2
    """`period_` of the application modules, s, > 0."""
    wait_s: float = 0.1
    """Constant part of the listening before a packet (`wait_costant_`), s, ≥ 0."""
    listen_s: float = 0.5
    """Longest random part of it (`listen_time_`), s, ≥ 0."""
    wake_s: float = 0.000_5
    """Longest time until the reading thread has woken, s, ≥ 0; writes closer than that may merge.
    Measured: they do without a pause, and do not with 1 ms."""
    paired: bool = False
    """Nodes 0 and 1 hear each other only, 2 and 3, and so on, as the flows of the sample."""

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
    """What to write."""


EventName: TypeAlias = Literal[
    "client", "left", "read", "dropped", "sent", "delivered", "lost", "discarded", "crashed"
]
"""What happened: a client came or left; a packet was read from the socket, dropped from a full
queue, sent, delivered to a client, lost on the channel, discarded since no client was there; all of
it was forgotten."""


class Observation(msgspec.Struct, frozen=True, kw_only=True):
    """Something that happened to a packet or a client."""

    at: int
    """Instant, ns."""
    event: EventName
    """What happened."""
    node: int
    """Index of the node where it happened."""
    size_bytes: int = 0
    """Of the packet."""
    detail: str = ""
    """Why it was lost."""


Observer: TypeAlias = Callable[[Observation], None]
"""Told of all that happens."""


class StandIn(Driver[bytes]):
    """DESERT from its application modules down.

    Args:
        channel: Between the nodes, which are numbered from 0 here, in its order.
        config: What the script sets.
        rng: Source of all randomness here; the channel has its own.
        observer: Told of all that happens.

    Raises:
        ConfigError: Paired nodes in odd number.
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
        """How often each event of `Observation` has happened."""
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
        """A client was accepted."""
        self.handle_timeout(now)
        self._nodes[node].has_client = True
        self._note("client", node)

    def handle_client_left(self, node: int, now: int) -> None:
        """The client has left; what it has written is still read."""
        self.handle_timeout(now)
        self._nodes[node].has_client = False
        self._note("left", node)

    def handle_write(self, node: int, data: bytes, now: int) -> None:
        """The client has written."""
        self.handle_timeout(now)
        place = self._nodes[node]
        place.unread += data
        if not place.is_waking:
            self._wake(node)

    def handle_crash(self, now: int) -> None:
        """The process has ended: nothing of what it had is left."""
        self.handle_timeout(now)
        self.agenda.clear()
        self._deliveries.clear()
        for node, place in enumerate(self._nodes):
            self._nodes[node] = _Node(place.phase_ns)
            self._note("crashed", node)

    def handle_timeout(self, now: int) -> None:
        """Let due events happen, in order of time."""
        self.agenda.run(now)

    def poll_delivery(self) -> Delivery | None:
        """Return the next write to a client."""
        return self._deliveries.popleft() if self._deliveries else None

    def poll_timeout(self) -> int | None:
        """Return the instant at which something happens next, ns; None: it depends on an input."""
        return self.agenda.next_at()

    def _wake(self, node: int) -> None:
        """The reading thread wakes soon."""
        self._nodes[node].is_waking = True
        delay_ns = seconds_to_ns(self._rng.random() * self.config.wake_s)
        self.agenda.push(self.agenda.now + delay_ns, self._read, node)

    def _read(self, node: int) -> None:
        """One read, one packet."""
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
        """First period of a node that begins after now."""
        periods = (self.agenda.now - place.phase_ns) // self._period_ns + 1
        return place.phase_ns + periods * self._period_ns

    def _hand_out(self, node: int) -> None:
        """A period begins: the application module hands a packet to the medium access."""
        place = self._nodes[node]
        place.access.append(place.queue.popleft())
        if place.queue:
            self.agenda.push(self._next_period(place), self._hand_out, node)
        if not place.is_sending:
            self._listen(node)

    def _listen(self, node: int) -> None:
        """The medium access listens before a packet, if there is one."""
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
        """A packet has arrived at a node, or is lost."""
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
