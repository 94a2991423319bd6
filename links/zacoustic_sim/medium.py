"""The driver of the channel model on the asyncio loop: one clock, one heap, one timer.

`zacoustic.channel.Medium` knows what sound does and has no clock. `SimMedium` gives it one: the
instants of the channel are those of the loop, counted from the moment at which the medium was made,
times the time scale. It keeps what is to come in a heap and arms one timer for the first of it. An
event that the loop handles late is computed for the instant at which it was due, so that a busy
machine delays messages and changes no outcome.

A modem that attaches is a function that takes messages. In this process that is a `SimLink`
(`SimMedium.link`), in another one a connection of `server`.
"""

import asyncio
import heapq
import itertools
import math
import random
import time
from collections.abc import Callable
from typing import Any, Final, TypeAlias

import msgspec

from zacoustic.channel.acknowledgement import ACKNOWLEDGEMENT_BYTES, patience_ns, turnaround_ns
from zacoustic.channel.faults import corrupt
from zacoustic.channel.medium import Arrival, Emission, Medium, Outcome, Reception
from zacoustic.channel.scenario import Scenario
from zacoustic.core.clock import Clock, ns_to_seconds, seconds_to_ns
from zacoustic.core.linktypes import LinkCapabilities, LinkMetrics, TransmitOutcome
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic_sim.connection import ConnectionReceiver
from zacoustic_sim.link import SimConfig, SimLink
from zacoustic_sim.messages import (
    Answered,
    Carrier,
    Finished,
    Heard,
    Refused,
    ServerMessage,
    Transmit,
    Welcome,
)
from zacoustic_sim.place import Place, Tell

METRICS: Final = frozenset(
    {"snr_db", "received_level_db", "propagation_s", "range_m", "range_rate_m_s"}
)
"""Fields of `LinkMetrics` that the simulated modem fills."""


class Attached(msgspec.Struct, frozen=True):
    """A modem has taken its place on the channel."""

    address: int
    """Of the node."""


class Detached(msgspec.Struct, frozen=True):
    """A modem has left."""

    address: int
    """Of the node."""


Observation: TypeAlias = Attached | Detached | Emission | Reception
"""What an observer of the medium sees."""


class SimMedium:
    """The channel of a scenario, driven by the running loop.

    Args:
        scenario: The channel and its nodes.
        time_scale: How many times faster than real, > 0.
        clock: Where instants come from.
        observer: Told, with the instant of the channel in ns, of all that happens.

    Raises:
        ConfigError: The time scale is not above 0.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        time_scale: float = 1.0,
        clock: Clock = time.monotonic_ns,
        observer: Callable[[int, Observation], None] | None = None,
    ) -> None:
        if not 0 < time_scale < math.inf:
            raise ConfigError(f"time scale is {time_scale:g}; allowed: above 0")
        self.scenario = scenario
        self.time_scale = time_scale
        self.clock = clock
        self._medium = Medium(scenario)
        self._observer = observer
        self._nodes = {
            address: Place(address, self._medium.profile(address))
            for address in self._medium.addresses
        }
        self._origin_at = clock()
        self._latest_at = 0
        self._order = itertools.count()
        self._heap: list[tuple[int, int, Callable[..., None], tuple[Any, ...]]] = []
        self._timer: asyncio.TimerHandle | asyncio.Handle | None = None
        self._timer_at = 0

    def link(self, address: int, config: SimConfig | None = None) -> SimLink:
        """Return the modem of a node, for this process; it attaches when it is opened."""
        connection = LocalConnection(self, address)
        return SimLink(connection, config, node_address=address, clock=self.clock)

    def attach(self, address: int, tell: Tell) -> Welcome:
        """Give a modem its place.

        Args:
            address: Of the node.
            tell: Takes the medium's messages from now on, on the loop.

        Raises:
            LinkOpenError: The scenario has no such node, or another modem has the place.
        """
        node = self._nodes.get(address)
        if node is None:
            there = ", ".join(str(each) for each in self._nodes)
            raise LinkOpenError(f"the scenario has no node {address}; it has {there}")
        if node.tell is not None:
            raise LinkOpenError(f"node {address} is taken by another modem")
        node.tell = tell
        self._now()
        self._observe(Attached(address))
        if node.audible:
            asyncio.get_running_loop().call_soon(node.say, Carrier(True))
        return Welcome(self._capabilities(node), node.profile.name, self.time_scale)

    def detach(self, address: int) -> None:
        """Remove a modem from the channel; its sound goes on. May be repeated."""
        node = self._nodes[address]
        if node.tell is not None:
            node.tell = None
            if node.waits_for is not None:
                node.waits_for, node.is_busy = None, False
            self._now()
            self._observe(Detached(address))

    def transmit(self, address: int, request: Transmit) -> None:
        """Send a frame from a node; `Finished` follows, also for a frame that cannot be sent."""
        self._advance(self._now())
        node = self._nodes[address]
        limit = node.profile.mtu_bytes
        if not 1 <= len(request.frame_bytes) <= limit:
            node.reject(request, f"frame of {len(request.frame_bytes)} bytes; allowed: 1..{limit}")
        elif node.is_busy:
            node.reject(request, "the modem is transmitting")
        else:
            node.is_busy = True
            # Within the gap the modem takes the frame and waits.
            self._push(max(self._latest_at, node.ready_at), self._emit, node, request)
            self._advance(self._latest_at)
        self._arm()

    def close(self) -> None:
        """Stop the clock and let all modems go; nothing is called after it. May be repeated."""
        for node in self._nodes.values():
            node.tell = None
        self._heap.clear()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _emit(self, at: int, node: Place, request: Transmit) -> None:
        """The sound leaves the node."""
        emission = self._medium.transmit(node.address, len(request.frame_bytes), at)
        node.ready_at = emission.ready_at
        self._spread(node, emission, self._end_arrival, request)
        self._push(emission.ends_at, self._end_emission, node, request, at)

    def _spread(
        self, node: Place, emission: Emission, end: Callable[..., None], *about: object
    ) -> None:
        """Sound leaves a node: put its arrivals on the agenda."""
        node.silent_at = emission.ends_at
        self._observe(emission)
        for arrival in emission.arrivals:
            if self._is_noticed(arrival):
                self._push(arrival.starts_at, self._begin_arrival, arrival)
            self._push(arrival.ends_at, end, arrival, *about)

    def _end_emission(self, at: int, node: Place, request: Transmit, started_at: int) -> None:
        if request.acknowledge and node.tell is not None:
            node.waits_for = request, started_at
            limit_ns = patience_ns(node.profile, self._farthest_s(node))
            self._push(at + limit_ns, self._give_up, node, request)
        else:
            self._finish(at, node, request, started_at, TransmitOutcome.SENT)

    def _give_up(self, at: int, node: Place, request: Transmit) -> None:
        """The acknowledgement will not come any more."""
        if node.waits_for is not None and node.waits_for[0] is request:
            self._finish(at, node, request, node.waits_for[1], TransmitOutcome.NOT_DELIVERED)

    def _finish(
        self, at: int, node: Place, request: Transmit, started_at: int, outcome: TransmitOutcome
    ) -> None:
        node.is_busy = False
        node.waits_for = None
        lasted_ns, ago_ns = self._node_ns(at - started_at), self._ago_ns(at)
        node.say(Finished(request.transmission_id, outcome, lasted_ns=lasted_ns, ago_ns=ago_ns))

    def _begin_arrival(self, at: int, arrival: Arrival) -> None:
        self._nodes[arrival.node].hear_begin()

    def _end_arrival(self, at: int, arrival: Arrival, request: Transmit) -> None:
        """Decide what became of a frame and hand it over; only then does its carrier end."""
        reception = self._medium.finish(arrival)
        self._observe(reception)
        node = self._nodes[arrival.node]
        if reception.is_received or self._is_garbled(reception):
            heard = self._heard(reception, request)
            if request.acknowledge and request.destination == node.address and not heard.damaged:
                self._push(at + turnaround_ns(node.profile), self._acknowledge, arrival, request)
            first_at = at + seconds_to_ns(reception.delay_s)
            if first_at > at:
                self._push(first_at, self._deliver, node, heard)
            else:
                self._deliver(at, node, heard)
            for after_s in reception.duplicates_after_s:
                self._push(first_at + seconds_to_ns(after_s), self._deliver, node, heard)
        if self._is_noticed(arrival):
            node.hear_end()

    def _acknowledge(self, at: int, arrival: Arrival, request: Transmit) -> None:
        """The modem that has received a frame says so, if it is there and has nothing else to do.

        Sound that it has not begun yet waits for the end of this.
        """
        node = self._nodes[arrival.node]
        if node.tell is None or node.is_busy or at < node.silent_at:
            return
        emission = self._medium.transmit(node.address, ACKNOWLEDGEMENT_BYTES, at)
        node.ready_at = max(node.ready_at, emission.ready_at)
        asker = self._nodes[arrival.source]
        self._spread(node, emission, self._end_answer, asker, request)

    def _end_answer(self, at: int, answer: Arrival, asker: Place, request: Transmit) -> None:
        """An acknowledgement has arrived, at the modem that waits for it or at another one."""
        reception = self._medium.finish(answer)
        self._observe(reception)
        waits_for = asker.waits_for
        is_for_it = answer.node == asker.address and reception.is_received
        if is_for_it and waits_for is not None and waits_for[0] is request:
            self._finish(at, asker, request, waits_for[1], TransmitOutcome.DELIVERED)
            asker.say(Answered(answer.source, self._metrics(answer), self._ago_ns(at)))
        if self._is_noticed(answer):
            self._nodes[answer.node].hear_end()

    def _deliver(self, at: int, node: Place, heard: Heard) -> None:
        node.say(msgspec.structs.replace(heard, ago_ns=self._ago_ns(at)))

    def _heard(self, reception: Reception, request: Transmit) -> Heard:
        arrival, frame_bytes = reception.arrival, request.frame_bytes
        garbled = not reception.is_received
        seed = arrival.sequence if garbled else reception.corrupt_seed
        if seed is not None:
            frame_bytes = corrupt(frame_bytes, random.Random(seed))
        return Heard(
            source=arrival.source,
            destination=request.destination,
            frame_bytes=frame_bytes,
            metrics=self._metrics(arrival),
            damaged=garbled,
        )

    def _metrics(self, arrival: Arrival) -> LinkMetrics:
        return LinkMetrics(
            snr_db=arrival.snr_db,
            received_level_db=arrival.received_level_db,
            propagation_s=arrival.propagation_s / self.time_scale,
            range_m=arrival.distance_m,
            range_rate_m_s=arrival.range_rate_m_s * self.time_scale,
        )

    def _is_noticed(self, arrival: Arrival) -> bool:
        profile = self._nodes[arrival.node].profile
        return not profile.separates_senders and arrival.snr_db >= profile.detection_snr_db

    def _is_garbled(self, reception: Reception) -> bool:
        """Whether a modem without a check would deliver something: noticed, destroyed by noise."""
        arrival = reception.arrival
        return (
            reception.outcome is Outcome.NOISE and not arrival.dropped and self._is_noticed(arrival)
        )

    def _capabilities(self, node: Place) -> LinkCapabilities:
        """What the modem of a node can do, in the clock of the node."""
        profile, scale = node.profile, self.time_scale
        return LinkCapabilities(
            mtu_bytes=profile.mtu_bytes,
            bit_rate_bps=profile.bit_rate_bps * scale,
            preamble_s=profile.preamble_s / scale,
            gap_s=profile.gap_s / scale,
            propagation_s=self._farthest_s(node) / scale,
            half_duplex=profile.half_duplex,
            # The fault is that modems do not notice the damage: then they do not check.
            checked=self.scenario.faults.corrupt == 0.0,
            senses_carrier=not profile.separates_senders,
            acknowledges=True,
            reports=METRICS,
            measures=METRICS,
            measures_range=True,
        )

    def _farthest_s(self, node: Place) -> float:
        """Propagation delay to the node that is farthest away now, s."""
        now = self._now()
        here = self._medium.position(node.address, now)
        farthest_m = max(
            math.dist(here, self._medium.position(address, now)) for address in self._nodes
        )
        return farthest_m / self.scenario.sound_speed_m_s

    def _observe(self, observation: Observation) -> None:
        if self._observer is not None:
            self._observer(self._latest_at, observation)

    def _now(self) -> int:
        """Instant of the channel, ns since the medium was made; never decreases."""
        now = round((self.clock() - self._origin_at) * self.time_scale)
        self._latest_at = max(self._latest_at, now)
        return self._latest_at

    def _node_ns(self, channel_ns: int) -> int:
        return round(channel_ns / self.time_scale)

    def _ago_ns(self, at: int) -> int:
        """How long ago, in the clock of the nodes, an instant of the channel was."""
        return max(0, self._node_ns(self._latest_at - at))

    def _push(self, at: int, handler: Callable[..., None], *arguments: object) -> None:
        heapq.heappush(self._heap, (at, next(self._order), handler, arguments))

    def _advance(self, until: int) -> None:
        """Let due events happen, in order of time."""
        self._latest_at = max(self._latest_at, until)
        while self._heap and self._heap[0][0] <= until:
            at, _, handler, arguments = heapq.heappop(self._heap)
            handler(at, *arguments)

    def _arm(self) -> None:
        """Set the one timer for the first event."""
        if not self._heap:
            return
        due_at = self._heap[0][0]
        if self._timer is not None:
            if self._timer_at == due_at:
                return
            self._timer.cancel()
        self._timer_at = due_at
        delay_ns = self._origin_at + math.ceil(due_at / self.time_scale) - self.clock()
        loop = asyncio.get_running_loop()
        if delay_ns <= 0:
            self._timer = loop.call_soon(self._expire)
        else:
            self._timer = loop.call_later(ns_to_seconds(delay_ns), self._expire)

    def _expire(self) -> None:
        self._timer = None
        try:
            # The loop may be early by its resolution: then it is the due instant that counts.
            self._advance(max(self._now(), self._timer_at))
        finally:
            self._arm()


class LocalConnection:
    """The way from a modem to a medium in the same process.

    Calls go through the loop, so that the medium never calls back from within a call of the modem.
    """

    hint = ""

    def __init__(self, medium: SimMedium, node_address: int) -> None:
        self.address = "this process"
        self._medium = medium
        self._node_address = node_address
        self._receiver: ConnectionReceiver | None = None
        self._is_attached = False

    def open(self, receiver: ConnectionReceiver) -> None:
        """Attach, soon."""
        self._receiver = receiver
        asyncio.get_running_loop().call_soon(self._attach)

    def send(self, message: Transmit) -> bool:
        """Transmit, soon."""
        if not self._is_attached:
            return False
        asyncio.get_running_loop().call_soon(self._transmit, message)
        return True

    async def close(self) -> None:
        """Detach."""
        self._receiver = None
        if self._is_attached:
            self._is_attached = False
            self._medium.detach(self._node_address)

    def _attach(self) -> None:
        if self._receiver is None or self._is_attached:
            return
        try:
            welcome: ServerMessage = self._medium.attach(self._node_address, self._tell)
            self._is_attached = True
        except LinkOpenError as error:
            welcome = Refused(str(error))
        self._tell(welcome)

    def _transmit(self, message: Transmit) -> None:
        if self._is_attached:
            self._medium.transmit(self._node_address, message)

    def _tell(self, message: ServerMessage) -> None:
        if self._receiver is not None:
            self._receiver.message_received(message, self._medium.clock())
