"""An autopilot, the two bridges' engines, and ground stations, in virtual time.

The autopilot and the stations are written from the MAVLink pages and share no code with the
bridges: what the autopilot's log says has happened, and a station believes what a real one would.
Between them are a cable and a channel that lose, delay, and duplicate.
"""

import heapq
import itertools
import random
from collections.abc import Callable
from typing import Any, Final

import msgspec

from tests.mavlink.messages import ARMED_GUIDED, SECOND, STATION, VEHICLE, report
from zacoustic.mavlink.autopilot import AutopilotSide
from zacoustic.mavlink.bridge import Engine
from zacoustic.mavlink.commands import Answer
from zacoustic.mavlink.dialect import Message, Received
from zacoustic.mavlink.outputs import Call, Publish, Reply, Send
from zacoustic.mavlink.station import StationSide

ACCEPTED, NOT_NOW, DENIED, FAILED, IN_PROGRESS = 0, 1, 2, 4, 5
TIMEOUT_S: Final = 60.0

Effect = tuple[object, ...]
ABORTS: Final[set[Effect]] = {("land",), ("return",)}


class Faults(msgspec.Struct, frozen=True):
    """What goes wrong, as probabilities and times, s."""

    deny: float = 0.0
    """Commands that the autopilot refuses."""
    progress: float = 0.0
    """Commands that it acknowledges as in progress first; not on a cable that loses."""
    cable_loss: float = 0.0
    cable_delay_s: float = 0.05
    """Longest delay of the cable, which keeps the order."""
    copies: float = 0.0
    """Acknowledgements that come twice, the second time up to three seconds later."""
    call_loss: float = 0.0
    """Requests and answers that are lost; a gateway repeats them until the time-out."""
    call_delay_s: float = 3.0
    late: float = 0.0
    """Requests that a relay has kept for up to five minutes."""
    report_loss: float = 0.0
    reboots: bool = False
    """Whether the autopilot starts again in the middle."""


class Given(msgspec.Struct):
    """A command of a station, and what the station was told."""

    bridge: int
    effect: Effect
    at_s: float
    told: int | None = None
    told_at_s: float = float("inf")
    is_replaced: bool = False
    """The station has given another command whose acknowledgement looks the same."""


class Executed(msgspec.Struct, frozen=True):
    """A command that has reached the autopilot."""

    at_s: float
    effect: Effect
    result: int


class Line:
    """A cable in one direction: keeps the order, loses, is late."""

    def __init__(self, world: "World") -> None:
        self.world = world
        self.free_at = 0

    def carry(self, take: Callable[[], None]) -> None:
        world, faults = self.world, self.world.faults
        if world.rng.random() < faults.cable_loss:
            return
        delay = round(world.rng.uniform(0.001, faults.cable_delay_s) * SECOND)
        self.free_at = max(self.free_at, world.now + delay)
        world.at(self.free_at, take)


class Autopilot:
    """Executes what it gets, and keeps the truth in its log."""

    def __init__(self, world: "World") -> None:
        self.world = world
        self.log: list[Executed] = []
        self.line = Line(world)
        self.sequence = itertools.count()
        self.started_at = -100 * SECOND
        self.busy: dict[int, int] = {}
        self.interval_ns: int | None = None

    def restart(self) -> None:
        self.started_at = self.world.now
        self.busy.clear()
        self.interval_ns = None

    def beat(self) -> None:
        self.say(ARMED_GUIDED)
        self.world.after(1.0, self.beat)

    def report(self, interval_ns: int) -> None:
        if self.interval_ns == interval_ns:
            self.say(report(timestamp=(self.world.now - self.started_at) // 1_000_000))
            self.world.after(interval_ns / SECOND, lambda: self.report(interval_ns))

    def take(self, message: Message) -> None:
        if message.name not in ("COMMAND_LONG", "COMMAND_INT"):
            return
        fields, rng, faults = message.fields, self.world.rng, self.world.faults
        command = fields["command"]
        if command == 511:
            if self.interval_ns is None:
                self.interval_ns = round(fields["param2"] * 1000)
                self.report(self.interval_ns)
            self.acknowledge(command, ACCEPTED)
            return
        if self.busy.get(command, 0) > self.world.now:
            self.note(fields, NOT_NOW)
            self.acknowledge(command, NOT_NOW)
            return
        result = DENIED if rng.random() < faults.deny else ACCEPTED
        self.note(fields, result)
        if rng.random() < faults.progress and not fields.get("confirmation"):
            takes_s = rng.uniform(2, 15)
            self.busy[command] = self.world.now + round(takes_s * SECOND)
            self.acknowledge(command, IN_PROGRESS)
            self.world.after(takes_s, lambda: self.acknowledge(command, result))
        else:
            self.acknowledge(command, result)

    def note(self, fields: dict[str, Any], result: int) -> None:
        effect: Effect
        match fields["command"]:
            case 400:
                effect = ("arm", fields["param1"] == 1, fields["param2"] != 0)
            case 176:
                effect = ("mode", int(fields["param2"]))
            case 192:
                effect = ("goto", fields["frame"], fields["x"], fields["y"], round(fields["z"]))
            case 20:
                effect = ("return",)
            case 21:
                effect = ("land",)
            case other:
                raise AssertionError(other)
        self.log.append(Executed(self.world.now_s, effect, result))

    def acknowledge(self, command: int, result: int) -> None:
        fields = {"command": command, "result": result}
        fields |= {"target_system": 255, "target_component": 190}
        self.say(Message("COMMAND_ACK", fields))

    def say(self, message: Message) -> None:
        received = Received(
            message=message, system=VEHICLE, component=1, sequence=next(self.sequence) % 256
        )
        world = self.world

        def arrive() -> None:
            world.vehicle.handle_message(received, world.now)
            is_ack = message.name == "COMMAND_ACK"
            if is_ack and world.rng.random() < world.faults.copies:
                again_s = world.rng.uniform(0, 3)
                world.after(again_s, lambda: world.vehicle.handle_message(received, world.now))

        self.line.carry(arrive)


class Station:
    """A ground station: takes an acknowledgement for that of its last command of the kind.

    Args:
        world: Where it is.
        number: Its number.
        bridge: Number of its bridge.
    """

    def __init__(self, world: "World", number: int, bridge: int) -> None:
        self.world = world
        self.number = number
        self.bridge = bridge
        self.system = 255 - number
        self.open: dict[object, Given] = {}
        self.closed: dict[object, Given] = {}
        self.said: dict[object, tuple[str, dict[str, Any]]] = {}
        self.said_at_s = 0.0

    def beat(self) -> None:
        self.say(STATION)
        self.world.after(1.0, self.beat)

    def give(self, message: Message, effect: Effect) -> Given:
        kind = self.kind_of(message)
        repeated = self.repeated(kind, message, effect)
        if repeated is not None:
            self.say(message)
            return repeated
        self.said_at_s = self.world.now_s
        given = Given(self.bridge, effect, self.world.now_s)
        self.world.given.append(given)
        if kind in self.open:
            self.open[kind].is_replaced = True
        self.open[kind] = given
        self.say(message)
        return given

    def repeated(self, kind: object, message: Message, effect: Effect) -> Given | None:
        """Return the command that a message repeats: it gets no answer of its own."""
        before = self.open.get(kind, self.closed.get(kind))
        said = (message.name, message.fields | {"confirmation": 0})
        is_same, self.said[kind] = said == self.said.get(kind), said
        if before is None or not is_same:
            return None
        of_bridge = [each for each in self.world.given if each.bridge == self.bridge]
        is_last, is_open = of_bridge[-1] is before, kind in self.open
        says_so = message.fields.get("confirmation", 0) > 0 and effect not in ABORTS
        is_soon = self.world.now_s - self.said_at_s < 3.5
        if is_open:
            return before if says_so or (is_last and is_soon) else None
        # What was not executed may be tried again.
        is_remembered = before.told != NOT_NOW and self.world.now_s - before.told_at_s < 59.9
        return before if says_so and is_last and is_remembered else None

    def kind_of(self, message: Message) -> object:
        if message.name.startswith("MISSION_ITEM"):
            return "mission"
        return 11 if message.name == "SET_MODE" else message.fields["command"]

    def say(self, message: Message) -> None:
        received = Received(message=message, system=self.system, component=190)
        self.world.shores[self.bridge].handle_message(received, self.world.now)

    def hear(self, message: Message) -> None:
        fields = message.fields
        if fields.get("target_system", self.system) != self.system:
            return
        if message.name == "MISSION_ACK":
            result = {0: ACCEPTED, 14: DENIED}.get(fields["type"], -1)
            self.close("mission", result)
        elif message.name == "COMMAND_ACK" and fields["result"] != IN_PROGRESS:
            self.close(fields["command"], fields["result"])

    def close(self, kind: object, result: int) -> None:
        given = self.open.pop(kind, None)
        if given is not None:
            given.told, given.told_at_s = result, self.world.now_s
            self.closed[kind] = given


class World:
    """All of it.

    Args:
        rng: Source of every chance.
        faults: What goes wrong.
        bridges: For each station, the number of its bridge.
    """

    def __init__(self, rng: random.Random, faults: Faults, bridges: tuple[int, ...]) -> None:
        self.rng = rng
        self.faults = faults
        self.now = 0
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self._numbers = itertools.count()
        self._calls: dict[int, Callable[[Answer], None]] = {}
        self.given: list[Given] = []
        self.autopilot = Autopilot(self)
        self._to_autopilot = Line(self)
        self.vehicle = AutopilotSide(
            interval_s=10, lost_after_s=90, clock_ms=rng.randrange(2**32), now=0
        )
        self.shores = [
            StationSide("auv1", ground_every_s=20, lost_after_s=90, now=0)
            for _ in range(max(bridges) + 1)
        ]
        self.stations = [Station(self, number, bridge) for number, bridge in enumerate(bridges)]
        self.autopilot.beat()
        for station in self.stations:
            station.beat()
        if faults.reboots:
            self.after(rng.uniform(30, 80), self.autopilot.restart)

    @property
    def now_s(self) -> float:
        return self.now / SECOND

    def at(self, instant: int, take: Callable[[], None]) -> None:
        heapq.heappush(self._events, (instant, next(self._order), take))

    def after(self, seconds: float, take: Callable[[], None]) -> None:
        self.at(self.now + round(seconds * SECOND), take)

    def run(self, until_s: float, is_over: Callable[[], bool] = lambda: False) -> None:
        """Go on until an instant, or until something is over."""
        until = round(until_s * SECOND)
        engines: tuple[Engine, ...] = (self.vehicle, *self.shores)
        while not is_over():
            due = [at for each in engines if (at := each.poll_timeout()) is not None]
            event_at = self._events[0][0]
            at = max(self.now, min(event_at, *due) if due else event_at)
            if at > until:
                break
            self.now = at
            if event_at <= at:
                heapq.heappop(self._events)[2]()
            else:
                for each in engines:
                    each.handle_timeout(at)
            self._pump()
        self.now = max(self.now, min(until, self.now if is_over() else until))

    def _pump(self) -> None:
        while (output := self.vehicle.poll()) is not None:
            if isinstance(output, Send):
                self._to_autopilot.carry(lambda sent=output: self.autopilot.take(sent.message))  # type: ignore[misc]
            elif isinstance(output, Publish):
                self._report(output.value)
            elif isinstance(output, Reply):
                self._calls.pop(output.number)(output.answer)
        for number, shore in enumerate(self.shores):
            while (output := shore.poll()) is not None:
                if isinstance(output, Call):
                    self._call(number, output)
                elif isinstance(output, Publish):
                    self.after(self.rng.uniform(1, 4), lambda: self.vehicle.handle_ground(self.now))
                elif isinstance(output, Send):
                    for station in self.stations:
                        if station.bridge == number:
                            station.hear(output.message)

    def _report(self, value: dict[str, Any]) -> None:
        crossed = {**value, "clock": round(value["clock"], -3)}
        age_s = self.rng.uniform(0, 3)
        for shore in self.shores:
            if self.rng.random() < self.faults.report_loss:
                continue
            delay_s = age_s + self.rng.uniform(0.5, 3)
            self.after(
                delay_s,
                lambda shore=shore: shore.handle_telemetry(crossed, age_s, self.now),  # type: ignore[misc]
            )

    def _call(self, shore: int, call: Call) -> None:
        """Carry a call over the channel: executed at most once, answered until its time-out."""
        number, faults, rng = next(self._numbers), self.faults, self.rng
        side, given_at = self.shores[shore], self.now
        is_over = is_there = False

        def end(answer: Answer) -> None:
            nonlocal is_over
            if not is_over:
                is_over = True
                side.handle_answer(call.number, answer, self.now)

        def answered(answer: Answer) -> None:
            try_until_lucky(lambda: end(answer))

        def arrive() -> None:
            nonlocal is_there
            if not is_there:
                is_there = True
                self._calls[number] = answered
                self.vehicle.handle_request(
                    number, call.service, call.value, 1, self.now, is_shore=True
                )

        def try_until_lucky(take: Callable[[], None]) -> None:
            delay_s = rng.uniform(0.5, faults.call_delay_s)
            if rng.random() >= faults.call_loss:
                self.after(delay_s, take)
            elif self.now + round(12 * SECOND) < given_at + round(TIMEOUT_S * SECOND):
                self.after(12, lambda: try_until_lucky(take))

        if rng.random() < faults.late:
            self.after(rng.uniform(20, 300), arrive)
        else:
            try_until_lucky(arrive)
        self.after(TIMEOUT_S, lambda: end(Answer("no_answer", "no answer in time")))


def problems(given: list[Given], log: list[Executed], faults: Faults) -> list[str]:
    """Return where what the stations were told is not what the autopilot did.

    Args:
        given: The commands, in the order in which they were given.
        log: What the autopilot did.
        faults: What went wrong, if anything.
    """
    found = []
    for place, one in enumerate(given):
        mine = [each for each in log if each.effect == one.effect and each.at_s >= one.at_s]
        others = [each for each in given[:place] if each.effect == one.effect]
        later = (each.at_s for each in given[place + 1 :] if each.effect == one.effect)
        until_s = min(later, default=float("inf"))
        alone = [each for each in mine if each.at_s < until_s]
        # What they may still do looks the same: on the cable, or late, as only an abort may be.
        earlier = [
            each
            for each in others
            if each.told_at_s + faults.cable_delay_s > one.at_s
            or (each.effect in ABORTS and each.told not in (ACCEPTED, DENIED))
        ]
        in_time = [each.result for each in mine if each.at_s <= one.told_at_s]
        words = f"command {place + 1} {one.effect} at {one.at_s:.1f} s was told {one.told}"
        if one.told is None and not one.is_replaced:
            found.append(f"{words}: no end")
        elif one.told == ACCEPTED and ACCEPTED not in in_time:
            found.append(f"{words}, and was not executed")
        elif one.told == DENIED and DENIED not in in_time:
            found.append(f"{words}, which the autopilot did not say")
        was_done = not earlier and any(each.result == ACCEPTED for each in alone)
        if one.told in (DENIED, NOT_NOW) and was_done:
            found.append(f"{words}, and was executed")
        late_s = one.at_s + TIMEOUT_S + faults.cable_delay_s + 1
        late = [each.at_s for each in alone if each.at_s > late_s and not earlier]
        if late and one.effect not in ABORTS:
            found.append(f"{words}, and was executed at {late[0]:.1f} s: its station had given up")
        if one.told == FAILED and faults == Faults(call_delay_s=faults.call_delay_s):
            found.append(f"{words}, without any fault")
    found += _last_wins(given, log)
    return found


def _last_wins(given: list[Given], log: list[Executed]) -> list[str]:
    """Return whether something that was given before the last accepted command came after it."""
    accepted = [place for place, each in enumerate(given) if each.told == ACCEPTED]
    done = [each for each in log if each.result == ACCEPTED]
    if not accepted or not done:
        return []
    last = given[accepted[-1]]
    if any(each.bridge != last.bridge and abs(each.at_s - last.at_s) < 2 for each in given):
        return []  # given at once at two bridges: nobody can say which came first
    after = {each.effect for each in given[accepted[-1] + 1 :]}
    # An abort is never too old, whatever came after it.
    late = (each for each in given if each.told != ACCEPTED or each.told_at_s > last.at_s)
    after |= {each.effect for each in late} & ABORTS
    if done[-1].effect in {last.effect, *after}:
        return []
    return [f"the last command told as accepted is {last.effect}, the last one done {done[-1]}"]
