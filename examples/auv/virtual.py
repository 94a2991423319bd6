"""The dive in virtual time: craft and shore on real engines, the channel of `water.json5` between.

It keeps what the promises are about: the latency of each command, where the vehicle truly
was when it said that it had arrived, and what became of every reliable sample.
"""

import math
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec

from examples.auv.craft import Craft
from examples.auv.dive import Dive
from examples.auv.messages import (
    GOTO,
    NAV,
    PHOTO,
    STATUS,
    STOP,
    Done,
    Progress,
    Reached,
    Waypoint,
)
from examples.auv.orders import execute, serve
from examples.auv.shore import Answer, Carrier, Shore
from examples.auv.start import (
    NAV_PERIOD_S,
    SHORE,
    START,
    STATUS_PERIOD_S,
    VEHICLE,
    modem_at,
)
from zacoustic import Reliability
from zacoustic.config import config_from_mapping
from zacoustic.core.clock import ns_to_seconds
from zacoustic.core.engine.events import (
    CallFailed,
    DeliveryEnded,
    Event,
    GoalKey,
    GoalStatus,
    LinkStateChanged,
    PeerFound,
    PeerLost,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.core.transport.actions.events import (
    CancelRequested,
    FeedbackReceived,
    GoalAnswered,
    GoalFailed,
    GoalReceived,
    ResultReceived,
)
from zacoustic.json5 import read_json5
from zacoustic.testing import Engine, Modem, VirtualNetwork, scenario_from_mapping

TICK_S: Final = 0.5

_HERE: Final = Path(__file__).parent
T = TypeVar("T")


class Arrival(msgspec.Struct, frozen=True):
    """A command, and when the vehicle had it."""

    name: str
    sent_at_s: float
    took_s: float


class VirtualDive(Carrier):
    """Vehicle, shore and channel.

    Args:
        seed: Of the losses and of the vehicle's noise.
        loss: Share of the frames that is lost, each way, 0…1.
    """

    def __init__(self, *, seed: int = 1, loss: float = 0.0) -> None:
        whole: Any = read_json5(_HERE / "fleet.json5")
        section = whole["plugins"]["acoustic"]
        configs = {
            address: config_from_mapping(section, source="fleet.json5", address=address)
            for address in (SHORE, VEHICLE)
        }
        water: Any = read_json5(_HERE / "water.json5")
        water |= {"seed": seed, "loss": {"frame": loss}}
        rules = {address: config.rules for address, config in configs.items()}

        self.craft = Craft(START, seed=seed)
        self.shore = Shore()
        self.arrivals: list[Arrival] = []
        self.stopped_at_s: float | None = None
        self.missed: list[tuple[float, float]] = []
        """Where the vehicle truly was when a goal ended: distance, and error of the depth, m."""
        self.outcomes: dict[str, int] = {}
        """Reliable samples of both sides, by how they ended."""
        self.published = 0
        """Reliable samples of both sides."""
        self._answers: dict[int, tuple[Answer, str, float]] = {}
        self._goals: dict[GoalKey, tuple[Answer, float]] = {}
        self._sent_at_s: dict[tuple[int, bytes], float] = {}
        self._served: tuple[GoalKey, Waypoint] | None = None
        self._called_at_s: dict[str, list[float]] = {}
        self._dive: Dive | None = None
        self.table = configs[SHORE].table
        self._ids = {stream.name: stream.stream_id for stream in self.table}
        self._names = {number: name for name, number in self._ids.items()}
        self.network = VirtualNetwork(
            scenario_from_mapping(water, source="water.json5"),
            {address: config.table for address, config in configs.items()},
            modem=Modem(acknowledges=True),
            deliver=self._deliver,
            digest=False,
            rules=rules,
        )
        for to, every_s in configs[SHORE].ranges_to().items():
            self.network.apply(SHORE, partial(_repeat_range, to, every_s))
        self.network.every(NAV_PERIOD_S, self._report, first_s=1.0)
        self.network.every(STATUS_PERIOD_S, self._status, first_s=2.0)
        self.network.every(TICK_S, self._tick, first_s=TICK_S)

    @property
    def now_s(self) -> float:
        """Virtual time, s."""
        return ns_to_seconds(self.network.now)

    def run(self, dive: Dive, *, limit_s: float = 5400.0) -> None:
        """Run a script to its end, and a little longer, so that all that is under way ends."""
        self._dive = dive
        while not dive.is_over and self.now_s < limit_s:
            self.network.run(until_s=self.now_s + 10.0)
        self.network.run(until_s=self.now_s + 120.0)

    def unaccounted(self) -> int:
        """Count the reliable samples that have not ended, and calls and goals without an end."""
        calls = sum(1 for answer, _, _ in self._answers.values() if not answer.ended)
        goals = sum(1 for answer, _ in self._goals.values() if not answer.ended)
        return self.published - sum(self.outcomes.values()) + calls + goals

    # Orders of the shore

    def put(self, topic: str, value: msgspec.Struct) -> None:
        """Publish a sample of the shore."""
        self._called_at_s.setdefault(topic, []).append(self.now_s)
        self._publish(SHORE, topic, msgspec.to_builtins(value))

    def call(self, service: str, value: msgspec.Struct) -> Answer:
        """Call a service of the vehicle."""
        answer, request = Answer(), msgspec.to_builtins(value)
        number = self._ids[service]
        self._called_at_s.setdefault(service, []).append(self.now_s)
        call = self.network.apply(SHORE, lambda engine, now: engine.call(number, request, now))
        self._answers[call] = (answer, service, self.now_s)
        return answer

    def send_goal(self, waypoint: Waypoint) -> Answer:
        """Send a way-point to the vehicle."""
        answer, goal = Answer(), msgspec.to_builtins(waypoint)
        number = self._ids[GOTO]
        self._called_at_s.setdefault(GOTO, []).append(self.now_s)
        key = self.network.apply(
            SHORE, lambda engine, now: engine.actions.send_goal(number, goal, now)
        )
        self._goals[key] = (answer, self.now_s)
        return answer

    # What the vehicle does by itself

    def _report(self) -> None:
        self.craft.advance(self.now_s)
        self._publish(VEHICLE, NAV, msgspec.to_builtins(self.craft.nav()))
        progress = self.craft.progress
        if progress is not None and self._served is not None:
            key, feedback = self._served[0], msgspec.to_builtins(progress)
            self.network.apply(
                VEHICLE, lambda engine, now: engine.actions.publish_feedback(key, feedback, now)
            )

    def _status(self) -> None:
        self.craft.advance(self.now_s)
        self._publish(VEHICLE, STATUS, msgspec.to_builtins(self.craft.status()))

    def _tick(self) -> None:
        self.craft.advance(self.now_s)
        place = self.craft.motion
        self.network.move(VEHICLE, modem_at(place.north_m, place.east_m, place.depth_m))
        while (ended := self.craft.poll_goal()) is not None:
            if self._served is None:
                continue
            key, waypoint = self._served
            self._served = None
            place = self.craft.motion
            if ended.reached:
                away_m = math.hypot(place.north_m - waypoint.north, place.east_m - waypoint.east)
                self.missed.append((away_m, abs(place.depth_m - waypoint.depth)))
            status = GoalStatus.SUCCEEDED if ended.reached else GoalStatus.ABORTED
            result = msgspec.to_builtins(ended.result)
            self._finish(key, status, result)
        if self._dive is not None:
            self._dive.poke(self.now_s)

    def _finish(self, key: GoalKey, status: GoalStatus, result: object) -> None:
        self.network.apply(
            VEHICLE, lambda engine, now: engine.actions.finish(key, status, result, now)
        )

    def _publish(self, address: int, topic: str, value: object) -> None:
        self.network.publish(address, self._ids[topic], value)
        if self.table.by_name(topic).qos.reliability is Reliability.RELIABLE:
            self.published += 1

    # Events of the engines

    def _deliver(self, address: int, event: Event) -> None:
        if isinstance(event, LinkStateChanged):
            return  # also called while the network is being made
        # Commands to an engine wait until all its events are out: at this instant, but later.
        self.network.at(self.now_s, lambda: self._take(address, event))

    def _take(self, address: int, event: Event) -> None:
        if isinstance(event, DeliveryEnded):
            outcome = event.outcome.value
            self.outcomes[outcome] = self.outcomes.get(outcome, 0) + 1
        elif address == VEHICLE:
            self.craft.advance(self.now_s)
            self._take_at_vehicle(event)
        else:
            self._take_at_shore(event)
            if self._dive is not None:
                self._dive.poke(self.now_s)

    def _take_at_vehicle(self, event: Event) -> None:
        craft = self.craft
        match event:
            case SampleReceived():
                topic = self._names[event.stream_id]
                self._arrived(topic)
                execute(craft, topic, event.value)
                if topic == STOP:
                    self.stopped_at_s = self.now_s
            case RequestReceived():
                self._serve(event)
            case GoalReceived():
                self._begin(event)
            case CancelRequested():
                craft.cancel_goto()
                goal = event.goal
                self.network.apply(
                    VEHICLE,
                    lambda engine, now: engine.actions.answer_cancel(goal, now, accepted=True),
                )
            case PeerLost():
                craft.shore_lost()
            case PeerFound():
                craft.shore_found()
            case _:
                pass

    def _serve(self, event: RequestReceived) -> None:
        service = self._names[event.call.stream_id]
        self._arrived(service)
        done, picture = serve(self.craft, service, event.value)
        answer = msgspec.to_builtins(done)
        self.network.apply(VEHICLE, lambda engine, now: engine.reply(event.call, answer, now))
        if picture:
            self._publish(VEHICLE, PHOTO, picture)

    def _begin(self, event: GoalReceived) -> None:
        self._arrived(GOTO)
        waypoint = msgspec.convert(event.value, Waypoint)
        refusal = self.craft.goto(waypoint)
        goal = event.goal
        if refusal:
            self.network.apply(
                VEHICLE, lambda engine, now: engine.actions.reject(goal, now, text=refusal)
            )
            return
        self._served = (goal, waypoint)
        self.network.apply(VEHICLE, lambda engine, now: engine.actions.accept(goal, now))

    def _take_at_shore(self, event: Event) -> None:
        match event:
            case SampleReceived():
                self._hear(event)
            case ResponseReceived():
                self._answers[event.call_id][0].answered(msgspec.convert(event.value, Done))
            case CallFailed():
                self._answers[event.call_id][0].failed(f"{event.failure.name}: {event.text}")
            case GoalAnswered():
                answer = self._goals[event.goal][0]
                answer.accepted = event.accepted
                if not event.accepted:
                    answer.failed(event.text)
            case FeedbackReceived():
                self.shore.progress = msgspec.convert(event.value, Progress)
            case ResultReceived():
                answer = self._goals[event.goal][0]
                if event.status is GoalStatus.SUCCEEDED:
                    answer.reached(msgspec.convert(event.value, Reached))
                else:
                    answer.failed(event.status.name)
            case GoalFailed():
                self._goals[event.goal][0].failed(f"{event.failure.name}: {event.text}")
            case _:
                pass

    def _hear(self, event: SampleReceived) -> None:
        name = self._names[event.stream_id]
        if event.age_s is None:
            self.shore.hear(name, event.value, self.now_s)
        else:
            self.shore.hear(name, event.value, self.now_s, event.age_s, 0.0)

    def _arrived(self, name: str) -> None:
        """Note the latency of the newest command of a name."""
        sent = self._called_at_s.get(name)
        if sent:
            sent_at_s = sent[-1]
            self.arrivals.append(Arrival(name, sent_at_s, self.now_s - sent_at_s))


def _repeat_range(to: int, every_s: float, engine: Engine, now: int) -> None:
    engine.ranging.repeat(to, every_s, now)
