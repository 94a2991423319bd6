"""The medium on the asyncio loop: one clock, one agenda, one timer.

`zacoustic.channel.modems` has the behaviour of modems, on an agenda without a clock. `SimMedium`
gives it one: its instants are those of the loop since the medium was made, times the time scale. An
event that the loop handles late is computed for its due instant, so a busy machine delays messages
and changes no outcome.

An attached modem is a function that takes messages. In this process that is a `SimLink`
(`SimMedium.link`), in another one a connection of `server`.
"""

import asyncio
import random
import time
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import msgspec

from zacoustic.channel.agenda import Agenda
from zacoustic.channel.faults.faults import corrupt
from zacoustic.channel.medium import Arrival, Emission, Medium, Outcome, Reception
from zacoustic.channel.modems import Ending, Modems, Sound
from zacoustic.channel.propagation.position import Position
from zacoustic.channel.scenario import Scenario
from zacoustic.core.clock import Clock
from zacoustic.core.linktypes import LinkCapabilities, LinkMetrics, TransmitOutcome
from zacoustic.errors import LinkOpenError
from zacoustic.link.alarm import Alarm
from zacoustic.link.serving import ScaledClock
from zacoustic_sim.connection import ConnectionReceiver
from zacoustic_sim.link import SimConfig, SimLink
from zacoustic_sim.messages import (
    Answered,
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
    """A modem has attached to the channel."""

    address: int
    """Address of the node."""


class Detached(msgspec.Struct, frozen=True):
    """A modem has detached."""

    address: int
    """Address of the node."""


Observation: TypeAlias = Attached | Detached | Emission | Reception
"""Events for an observer of the medium."""


class SimMedium(Modems[Place, Transmit]):
    """The channel of a scenario, driven by the running loop.

    Args:
        scenario: The channel and its nodes.
        time_scale: How many times faster than real time, > 0.
        clock: Source of instants.
        observer: Takes all events, with the instant of the channel, ns.

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
        super().__init__(Medium(scenario), Agenda())
        self.scenario = scenario
        self.time_scale = time_scale
        self.clock = clock
        self._scaled = ScaledClock(time_scale, clock)
        self._alarm = Alarm(self._scaled.now, self._expire, time_scale=time_scale)
        self._observer = observer
        self._latest_at = 0
        for address in self.medium.addresses:
            self.stations[address] = Place(address, self.medium.profile(address))

    @property
    def is_quiet(self) -> bool:
        """Whether nothing is pending: no sound on the channel, no timer set."""
        return not len(self.agenda)

    def link(self, address: int, config: SimConfig | None = None) -> SimLink:
        """Return the modem of a node, for this process; it attaches when it opens."""
        connection = LocalConnection(self, address)
        return SimLink(connection, config, node_address=address, clock=self.clock)

    def attach(self, address: int, tell: Tell) -> Welcome:
        """Attach a modem.

        Args:
            address: Address of the node.
            tell: Takes the medium's messages from now on, on the loop.

        Raises:
            LinkOpenError: The scenario has no such node, or another modem is attached there.
        """
        place = self.stations.get(address)
        if place is None:
            there = ", ".join(str(each) for each in self.stations)
            raise LinkOpenError(f"the scenario has no node {address}; it has {there}")
        if place.tell is not None:
            raise LinkOpenError(f"node {address} is taken by another modem")
        place.plug(tell)
        self._observe(Attached(address))
        asyncio.get_running_loop().call_soon(self.settle, place)
        return Welcome(self._capabilities(place), place.profile.name, self.time_scale)

    def detach(self, address: int) -> None:
        """Detach a modem; its sound goes on. May be repeated."""
        place = self.stations[address]
        if place.tell is not None:
            place.unplug()
            self._observe(Detached(address))

    def move(self, address: int, position: Position) -> None:
        """Set the position of a node from now on: x east, y north, z down, m.

        Raises:
            ValueError: No such node, or a coordinate that is not a number or too large.
        """
        self.agenda.run(self._now())
        self.medium.move(address, position, self.agenda.now)

    def transmit(self, address: int, request: Transmit) -> None:
        """Transmit a frame of a node; `Finished` follows, even if it cannot be transmitted."""
        self.agenda.run(self._now())
        place = self.stations[address]
        limit = place.profile.mtu_bytes
        if not 1 <= len(request.frame_bytes) <= limit:
            place.reject(request, f"frame of {len(request.frame_bytes)} bytes; allowed: 1..{limit}")
        elif place.pending:
            place.reject(request, "the modem is transmitting")
        else:
            self.send(address, request)
        self._alarm.set(self.agenda.next_at())

    def close(self) -> None:
        """Stop the clock and detach all modems; nothing is called afterwards. May be repeated."""
        for place in self.stations.values():
            place.unplug()
        self.agenda.clear()
        self._alarm.stop()

    # Called by the base class

    def asks(self, frame: Transmit) -> bool:
        """Tell whether a frame asks for an acknowledgement."""
        return frame.acknowledge

    def emitted(self, station: Place, emission: Emission) -> None:
        """Report an emission; a frame that the modem takes before `ready_at` waits."""
        station.ready_at = emission.ready_at
        self._observe(emission)

    def finished(
        self,
        station: Place,
        frame: Transmit,
        ending: Ending,
        started_at: int,
        answer: Arrival | None,
    ) -> None:
        """Report the end of a frame, with the measurements of its acknowledgement."""
        lasted_ns = self._node_ns(self.agenda.now - started_at)
        outcome, ago_ns = TransmitOutcome(ending.value), self._ago_ns()
        station.say(Finished(frame.transmission_id, outcome, lasted_ns=lasted_ns, ago_ns=ago_ns))
        if answer is not None:
            station.say(Answered(answer.source, self._metrics(answer), ago_ns))

    def end(self, reception: Reception, sent: Sound[Place, Transmit], is_noticed: bool) -> None:
        """Handle the end of a sound."""
        self._observe(reception)
        super().end(reception, sent, is_noticed)

    def delays_s(self, reception: Reception) -> Sequence[float]:
        """Return delays; an unchecked modem also delivers noticed frames that noise destroyed."""
        arrival = reception.arrival
        is_garbled = (
            reception.outcome is Outcome.NOISE and not arrival.dropped and self.notices(arrival)
        )
        return reception.delays_s if is_garbled else super().delays_s(reception)

    def hand_over(self, station: Place, reception: Reception, frame: Transmit) -> None:
        """Deliver a received frame to a modem."""
        arrival, frame_bytes = reception.arrival, reception.damage(frame.frame_bytes)
        if not reception.is_received:
            frame_bytes = corrupt(frame_bytes, random.Random(arrival.sequence))
        station.say(
            Heard(
                source=arrival.source,
                destination=frame.destination,
                frame_bytes=frame_bytes,
                metrics=self._metrics(arrival),
                damaged=not reception.is_received,
                ago_ns=self._ago_ns(),
            )
        )

    def settle(self, station: Place) -> None:
        """Report whether others are audible, after the frame that may have ended."""
        station.tell_carrier()

    # Below the methods above

    def _metrics(self, arrival: Arrival) -> LinkMetrics:
        return LinkMetrics(
            snr_db=arrival.snr_db,
            received_level_db=arrival.received_level_db,
            propagation_s=arrival.propagation_s / self.time_scale,
            range_m=arrival.distance_m,
            range_rate_m_s=arrival.range_rate_m_s * self.time_scale,
        )

    def _capabilities(self, place: Place) -> LinkCapabilities:
        """Return the capabilities of a node's modem, in the clock of the node."""
        profile, scale = place.profile, self.time_scale
        return LinkCapabilities(
            mtu_bytes=profile.mtu_bytes,
            bit_rate_bps=profile.bit_rate_bps * scale,
            preamble_s=profile.preamble_s / scale,
            gap_s=profile.gap_s / scale,
            propagation_s=self.farthest_s / scale,
            half_duplex=profile.half_duplex,
            # With this fault modems do not notice damage: they do not check.
            checked=self.scenario.faults.corrupt == 0.0,
            senses_carrier=not profile.separates_senders,
            acknowledges=True,
            reports=METRICS,
            measures=METRICS,
            measures_range=True,
        )

    def _observe(self, observation: Observation) -> None:
        if self._observer is not None:
            self._observer(self._now(), observation)

    def _now(self) -> int:
        """Instant of the channel, ns since the medium was made; never decreases."""
        self._latest_at = max(self._latest_at, self._scaled.now())
        return self._latest_at

    def _node_ns(self, channel_ns: int) -> int:
        return round(channel_ns / self.time_scale)

    def _ago_ns(self) -> int:
        """Return how late the present event is, in the clock of the nodes, ns."""
        return self._node_ns(max(0, self._now() - self.agenda.now))

    def _expire(self, due_at: int) -> None:
        # The loop may be early by its resolution; the due instant counts.
        try:
            self.agenda.run(max(self._now(), due_at))
        finally:
            self._alarm.set(self.agenda.next_at())


class LocalConnection:
    """A modem's connection to a medium in the same process.

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
