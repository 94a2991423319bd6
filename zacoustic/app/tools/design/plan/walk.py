"""A model of the traffic, frame by frame: costs, waiting, repetitions.

The problem: a stream's share of the channel is not just its bytes. A frame has a preamble, several
records share one when they come together, acknowledgements and repetitions come on top, and medium
access decides how many frames there are. No formula covers all of that.

The idea: step through time with sizes in place of contents. Records wait in lanes, a frame is
composed when the node's medium access permits it (the real policies, which are pure), the channel
model of the scenario decides who receives it, and `reliable`, `calls` and `transfers` model the
consequences. Not modelled: contents, tables that differ, journals, remote commands, actions. So the
result is an estimate of the engines' behaviour, independent of them; `zacoustic sim` runs the
engines themselves, and tests/benchmarks/bench_plan.py compares the two.
"""

import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

from zacoustic.app.tools.design.plan.calls import Call
from zacoustic.app.tools.design.plan.clockwork import head_bytes_of
from zacoustic.app.tools.design.plan.items import NO_STREAM, NO_VOICE, Item
from zacoustic.app.tools.design.plan.offers import Offer, Saying
from zacoustic.app.tools.design.plan.reliable import ReliableLane
from zacoustic.app.tools.design.plan.speaker import Said, Speaker
from zacoustic.app.tools.design.plan.transfers import TransferLane
from zacoustic.channel.agenda import Agenda
from zacoustic.channel.arrival import Arrival, Emission, Reception
from zacoustic.channel.driver import Driver
from zacoustic.channel.medium import Medium
from zacoustic.channel.scenario import Scenario
from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import (
    BROADCAST,
    LinkMetrics,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.base.qos import Qos, Reliability, Stamp
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.timing import LinkTimes, Pacer
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import AGE_FIELD, StreamTable
from zacoustic.core.values.dense import DenseSample
from zacoustic.core.wire.access import ANYBODY, NOBODY, TURN_CODE, ClockTime, Turn
from zacoustic.core.wire.agreement import TAG_BYTES
from zacoustic.core.wire.frame import SYNC_BYTES
from zacoustic.core.wire.numbers import NUMBER_BYTES
from zacoustic.testing.virtualmodems import Modem

_STRIDE_S: Final = 5.0
_CLOCK_EVERY_S: Final = 10.0
_MOST_LATENCIES: Final = 20_000


class Found:
    """The result of a walk."""

    def __init__(self) -> None:
        self.airtime_s: dict[int, float] = {}
        """Airtime by node, s."""
        self.stream_airtime_s: dict[int, float] = {}
        """Airtime by stream, s; 0: no stream. A frame's airtime is divided by bytes."""
        self.walked_s = 0.0
        """Modelled time, s."""
        self.arrivals = 0
        """Received frames, each counted at each receiver."""
        self.frames = 0.0
        self.transmitted_bytes = 0.0
        self.agreement_bytes = 0.0
        """Bytes of HELLO, TAG and CONFIRM."""
        self.latencies_s: dict[int, list[float]] = {}
        """Time to each arrival by stream, s."""
        self.said: dict[int, int] = {}
        """Number of samples and calls by stream."""
        self.went: dict[int, int] = {}
        """Number of those transmitted, by stream."""
        self.refused: dict[int, int] = {}
        """Number of those larger than a frame that may not cross in parts, by stream."""
        self.lost_frames = 0
        """Number of lost arrivals."""
        self.dropped = 0
        """Number of items replaced or expired before transmission."""


class Walk(Driver[Said]):
    """One walk.

    Args:
        scenario: The channel.
        tables: The table of each node.
        rules: The config's rules of transmission, by node.
        offers: The offered traffic.
        seed: Seed of all draws.
        members: Nodes represented by each node, itself included; none: each represents itself.
    """

    def __init__(
        self,
        scenario: Scenario,
        tables: Mapping[int, StreamTable],
        rules: Mapping[int, TransmitRules],
        offers: Sequence[Offer],
        seed: int,
        members: Mapping[int, tuple[int, ...]],
    ) -> None:
        medium = self._medium = Medium(scenario)
        super().__init__(medium, Agenda())
        self.found = Found()
        self._rng = random.Random(f"plan/{seed}")
        self._rules = rules
        self._timings: dict[tuple[int, int], Pacer] = {}
        self._speakers: dict[int, Speaker] = {}
        self._transmissions = 0
        self._calls = 0
        self._last_said: dict[int, int] = {}
        self._members = {each: members.get(each, (each,)) for each in tables}
        silent = {each for group in members.values() for each in group} - set(members)
        nodes = len(tables) + len(silent)
        self._confirms = (nodes - 1) / max(1, len(tables) - 1)
        """Confirmations of a node for each modelled one."""
        modem, farthest_s = Modem(), scenario.farthest_s
        for address in tables:
            others = tuple(each for each in medium.addresses if each != address)
            listed = [each for each in tables[address].nodes if each not in {address, *silent}]
            capabilities = modem.capabilities(medium.profile(address), farthest_s)
            self._speakers[address] = Speaker(
                address, tables[address], listed or others, capabilities,
                rules[address], self._rng, len(self._members[address]),
            )  # fmt: skip
        self._tables = tables
        self._calls = 0
        for offer in offers:
            self._begin(offer)
        for address, rule in rules.items():
            if rule.access is not None:
                self._tell_clock(address)
            self._beat(address, rule)

    @property
    def now(self) -> int:
        """The instant, ns."""
        return self.agenda.now

    def run(self, until_s: float, most_arrivals: int | None = None) -> Found:
        """Model a time, s; or until that many frames have arrived."""
        found = self.found
        for address in self._speakers:
            self.serve(address)
        while found.walked_s < until_s:
            if most_arrivals is not None and found.arrivals >= most_arrivals:
                break
            found.walked_s = min(found.walked_s + _STRIDE_S, until_s)
            self.agenda.run(seconds_to_ns(found.walked_s))
        self.found.dropped = sum(each.dropped for each in self._speakers.values())
        return self.found

    def later(self, at: int, action: Callable[[], object]) -> None:
        """Schedule an action at an instant, ns."""
        self.agenda.push(max(at, self.now), action)

    def speaker(self, address: int) -> Speaker:
        """Return a node."""
        return self._speakers[address]

    def timing(self, source: int, target: int) -> Pacer:
        """Return the times in which a node answers another one."""
        return self._timings.setdefault((source, target), Pacer())

    def delivered(self, offer: Offer, began_at: int) -> None:
        """Note the arrival of an item that began at an instant, ns."""
        latencies = self.found.latencies_s.setdefault(offer.stream.stream_id, [])
        if len(latencies) < _MOST_LATENCIES:
            latencies.append((self.now - began_at) / NS_PER_S)

    def went(self, offer: Offer) -> None:
        """Note the first transmission of an item."""
        stream_id = offer.stream.stream_id
        self.found.went[stream_id] = self.found.went.get(stream_id, 0) + 1

    def serve(self, address: int) -> None:
        """Let a node transmit, if it may."""
        speaker = self._speakers[address]
        ready_at = speaker.ready_at(self.now)
        if ready_at is not None and ready_at <= self.now:
            said = speaker.say(self.now)
            if said is not None:
                self._transmit(speaker, said)
                return
            ready_at = speaker.ready_at(self.now)
        if ready_at is not None and ready_at != speaker.armed_at:
            speaker.armed_at = ready_at
            self.agenda.push(max(ready_at, self.now), self._wake, address, ready_at)

    # Offered traffic

    def _begin(self, offer: Offer) -> None:
        say = self._saying(offer)
        sayings, instants = offer.sayings(self._rng), offer.instants(self._rng)

        def act() -> None:
            say(next(sayings))
            go_on()

        def go_on() -> None:
            at = next(instants, None)
            if at is not None:
                self.later(at, act)

        go_on()

    def _saying(self, offer: Offer) -> Callable[[Saying], None]:
        """Return a function that begins one sample or call of an offer."""
        speaker = self._speakers[offer.node]
        times = LinkTimes(speaker.capabilities)
        stream, qos = offer.stream, offer.stream.qos
        said = self.found.said
        said.setdefault(stream.stream_id, 0)
        if isinstance(stream.spec, ServiceSpec):
            spec = stream.spec

            def call(saying: Saying) -> None:
                said[stream.stream_id] += 1
                self._calls += 1
                Call(
                    offer, saying.payload_bytes, self, times, self._rng, spec.server,
                    self._calls, spec.timeout_s,
                )  # fmt: skip

            return call
        receivers = tuple(
            each for each in self._tables if each != offer.node and stream.may_subscribe(each)
        )
        room_bytes = speaker.port.envelope.room_bytes
        if qos.reliability is Reliability.RELIABLE:
            lane = ReliableLane(offer, receivers, self, times, self._rng)
            transfers = TransferLane(offer, receivers, self, speaker.capabilities, room_bytes)
            most_bytes = room_bytes - TAG_BYTES - head_bytes_of(offer) - SYNC_BYTES - NUMBER_BYTES

            def publish(saying: Saying) -> None:
                said[stream.stream_id] += 1
                if saying.payload_bytes > most_bytes:
                    transfers.publish(saying.payload_bytes)
                else:
                    lane.publish(saying)

            return publish
        return lambda saying: self._say(offer, receivers, saying)

    def _say(self, offer: Offer, receivers: tuple[int, ...], saying: Saying) -> None:
        """Queue a best-effort sample."""
        stream, now = offer.stream, self.now
        self.found.said[stream.stream_id] += 1
        spec = stream.spec
        listed = spec.subscribers if isinstance(spec, TopicSpec) else None
        room_bytes = self._speakers[offer.node].port.envelope.room_bytes - TAG_BYTES
        if head_bytes_of(offer) + saying.payload_bytes > room_bytes:
            self.found.refused[stream.stream_id] = self.found.refused.get(stream.stream_id, 0) + 1
            return
        is_alone = len(receivers) == 1 and (listed is not None or stream.is_on_demand)
        item = Item(
            stream.stream_id, receivers[0] if is_alone else BROADCAST,
            head_bytes_of(offer) + saying.payload_bytes, now,
        )  # fmt: skip
        item.open_ended = not stream.codec.delimits_itself
        item.voice, item.wait_ns = offer.voice, stream.qos.linger_ns
        if stream.qos.lifespan_s is not None:
            item.expires_at = now + seconds_to_ns(stream.qos.lifespan_s)
        if saying.dense_value is not None:
            value = dict(saying.dense_value)
            if stream.qos.stamp is Stamp.AGE:
                value[AGE_FIELD] = 0
            number = self.found.said[stream.stream_id]
            item.dense = DenseSample(stream.stream_id, value, number)
        item.begins = lambda _: self.went(offer)
        item.heard = lambda node, _: self.delivered(offer, now) if node in receivers else None
        speaker = self._speakers[offer.node]
        speaker.push(("sample", stream.stream_id, offer.instance, offer.voice), item, stream.qos)
        self.serve(offer.node)

    def _beat(self, address: int, rules: TransmitRules) -> None:
        """Model heartbeats; ignores that a transmitting node sends none."""
        if rules.contact.heartbeat_s is None:
            return
        heartbeat_ns = seconds_to_ns(rules.contact.heartbeat_s)
        said_at = self.now

        def beat() -> None:
            nonlocal said_at
            last_at = self._last_said.get(address, said_at)
            due_at = last_at + heartbeat_ns * 7 // 8
            if due_at <= self.now:
                item = Item(NO_STREAM, BROADCAST, 1, self.now)
                item.is_control = True
                self._speakers[address].push(("heartbeat",), item, Qos(), depth=1)
                said_at = due_at = self.now
                self.serve(address)
                due_at = self.now + heartbeat_ns * 7 // 8
            self.later(due_at, beat)

        self.later(self.now + heartbeat_ns * 7 // 8, beat)

    # Frames

    def _wake(self, address: int, armed_at: int) -> None:
        speaker = self._speakers[address]
        if speaker.armed_at == armed_at:
            speaker.armed_at = None
            speaker.port.access.handle_timeout(self.now)
            self.serve(address)

    def _transmit(self, speaker: Speaker, said: Said) -> None:
        now = self.now
        self._transmissions += 1
        transmission = Transmission(
            transmission_id=self._transmissions, frame_bytes=bytes(said.size_bytes),
            destination=said.destination,
        )  # fmt: skip
        speaker.port.transmit(transmission.transmission_id, (), now)
        speaker.on_air, speaker.armed_at = said, None
        for item in said.items:
            if item.begins is not None:
                item.begins(now)
        emission = self.channel.transmit(speaker.address, said.size_bytes, now)
        speaker.spend(said, emission.ends_at - now, now)
        self._book(speaker.address, said, (emission.ends_at - now) / NS_PER_S)
        self.spread(emission, said)
        self.agenda.push(
            emission.ends_at, self._sounded, speaker.address, transmission, emission, said
        )

    def _book(self, address: int, said: Said, airtime_s: float) -> None:
        """Count a frame: a sample for its node, all else for each represented node."""
        found, members = self.found, self._members[address]
        if said.destination == BROADCAST:
            self._last_said[address] = self.now
        items = said.items or [Item(NO_STREAM, BROADCAST, 1, self.now)]
        items_bytes = max(1, sum(each.size_bytes for each in items))
        frames = 0.0
        for item in items:
            voices = members if item.voice == NO_VOICE else (item.voice,)
            times = self._confirms if item.is_confirm and item.voice == NO_VOICE else 1.0
            share = item.size_bytes / items_bytes * times
            frames += share * len(voices)
            for voice in voices:
                found.airtime_s[voice] = found.airtime_s.get(voice, 0.0) + airtime_s * share
            before_s = found.stream_airtime_s.get(item.stream_id, 0.0)
            found.stream_airtime_s[item.stream_id] = before_s + airtime_s * share * len(voices)
            if item.is_confirm:
                found.agreement_bytes += item.size_bytes * times * len(voices)
        found.frames += frames
        found.transmitted_bytes += said.size_bytes * frames
        found.agreement_bytes += said.opening_bytes * frames

    def _sounded(
        self, address: int, transmission: Transmission, emission: Emission, said: Said
    ) -> None:
        speaker = self._speakers[address]
        report = TransmitReport(
            transmission_id=transmission.transmission_id, outcome=TransmitOutcome.SENT,
            started_at=emission.started_at, finished_at=self.now,
        )  # fmt: skip
        speaker.on_air = None
        speaker.port.finish(report, self.now)
        for item in said.items:
            if item.ends is not None:
                item.ends(self.now)
        self.serve(address)

    def notices(self, arrival: Arrival) -> bool:
        """Tell whether a node's modem notices the beginning of a sound."""
        is_there = arrival.node in self._speakers
        return is_there and self._medium.profile(arrival.node).notices(arrival.snr_db)

    def begin(self, arrival: Arrival, sent: Said) -> None:
        """Handle the beginning of a sound at a node."""
        self._carrier(self._speakers[arrival.node], 1)

    def _carrier(self, speaker: Speaker, change: int) -> None:
        was, speaker.carriers = speaker.carriers, speaker.carriers + change
        if (was == 0) != (speaker.carriers == 0):
            speaker.port.handle_carrier(speaker.carriers > 0, self.now)

    def end(self, reception: Reception, sent: Said, is_noticed: bool) -> None:
        """Handle the end of a sound at a node: the frame's contents have arrived, or are lost."""
        arrival, said = reception.arrival, sent
        self.found.arrivals += 1
        speaker = self._speakers.get(arrival.node)
        if speaker is None:
            return
        if is_noticed:
            self._carrier(speaker, -1)
        if said.destination not in (arrival.node, BROADCAST):
            self.serve(arrival.node)
            return
        is_received = reception.is_received and reception.corrupt_seed is None
        self.found.lost_frames += not is_received
        if is_received:
            speaker.port.heard(arrival.source, said.size_bytes, self.now)
            self._control(speaker, arrival, said)
            speaker.heard(arrival.source, said, self.now)
        for item in said.items:
            told = item.heard if is_received else item.lost
            if told is not None and item.destination in (arrival.node, BROADCAST):
                told(arrival.node, self.now)
            if is_received and item.stream_id == NO_STREAM and item.destination == arrival.node:
                speaker.confirmed(arrival.source)
        self.serve(arrival.node)

    def _control(self, speaker: Speaker, arrival: Arrival, said: Said) -> None:
        """Hand over the medium-access controls of a frame, and when its sender listens."""
        calls = [item.call for item in said.items if item.call is not None]
        if not calls and not said.controls:
            return
        frame = ReceivedFrame(
            frame_bytes=bytes(said.size_bytes), received_at=self.now, source=arrival.source,
            destination=said.destination,
            metrics=LinkMetrics(propagation_s=arrival.propagation_s),
        )  # fmt: skip
        for call in calls:
            speaker.port.handle_call(arrival.source, call, frame, self.now)
        for control in _controls(said.controls):
            if isinstance(control, Turn) and control.node not in (
                NOBODY, ANYBODY, speaker.address,
            ):  # fmt: skip
                continue
            speaker.port.handle_control(arrival.source, control, frame, self.now)

    def _tell_clock(self, address: int) -> None:
        speaker = self._speakers[address]
        speaker.port.access.handle_clock(0, 0, self.now)
        self.later(self.now + seconds_to_ns(_CLOCK_EVERY_S), lambda: self._tell_clock(address))
        if self.now:
            self.serve(address)


def _controls(said: bytes) -> Iterator[Turn | ClockTime]:
    while said:
        size_bytes = 3 if said[0] == TURN_CODE else 8
        body, said = said[1:size_bytes], said[size_bytes:]
        yield Turn.decode(body) if size_bytes == 3 else ClockTime.decode(body)
