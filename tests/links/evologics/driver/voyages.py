"""A voyage: whole nodes in the water, a minute of faults, then calm; all of it from one seed.

What is looked at, for each seed:

- a sample arrives once or not at all, and as it was published; a service runs once for each call at
  most; each call ends once, and with the answer to that call;
- each transmission is reported once. What is called sent was on the air, what is called delivered
  has arrived in the water at the other modem, what is called rejected was never on the air; nothing
  is on the air twice;
- `RECOVERY_S` after the last fault all links are up, and a sample that is published then crosses,
  through what the nodes still have to say to each other; one into silence crosses at once;
- in the end an idle dialogue has no timer, and holds no more than an idle dialogue does.

One seed again: ``python -m tests.links.evologics.driver.voyages SEED [SECONDS]``
"""

import gc
import random
import sys
import types
from functools import partial
from typing import Final

from tests.links.evologics.driver.courses import (
    CALLS,
    EVERYBODY,
    FAULTS_S,
    FRESH,
    Course,
    course_of,
    table_of,
)
from tests.links.evologics.driver.crew import CrewedSea, CrewNode, Given
from zacoustic.channel.arrival import Outcome
from zacoustic.core.clock import ns_to_seconds, seconds_to_ns
from zacoustic.core.engine.events import (
    CallFailed,
    Event,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.core.linktypes import TransmitOutcome, TransmitReport
from zacoustic_evologics.driver.dialogue import AtDialogue
from zacoustic_evologics.emulator import EmulatedFleet, FaultKind, Observation, scenario_of
from zacoustic_evologics.emulator.hardware.signals import SignalKind
from zacoustic_evologics.emulator.observation import SignalEmitted

RECOVERY_S: Final = 5.0
"""After so long all is well again, s."""
CROSSING_S: Final = 20.0
"""A fresh sample takes so long at most, s, while all nodes have things to say: three that collide
again and again are the business of medium access. In the middle it is 2 s."""
EXCHANGE_S: Final = 22.0
"""The same where modems acknowledge, s more: one exchange that fails takes 5.6 s."""
CONNECTION_S: Final = 60.0
"""The same where they make connections, s more: one that fails takes 24 s."""
SILENT_CROSSING_S: Final = 2.2
"""A fresh sample takes so long where nobody else speaks, s: airtime and propagation."""
CALM_S: Final = 100.0
"""What is still under way then has ended, s: calls, their memory, questions."""
OWED_S: Final = 1200.0
"""A confirmation that is owed goes within that, s: its longest pause is 256 units of a frame."""
HELD_LIMIT: Final = 200
"""Objects of an idle dialogue, with a count of everything that can be counted."""

_MESSAGES: Final = (SignalKind.IM, SignalKind.IMS)


class Voyage:
    """One voyage.

    Args:
        course: What is decided about it.
    """

    def __init__(self, course: Course) -> None:
        self.course = course
        self.rng = random.Random(f"crew/{course.seed}")
        self.emitted: dict[tuple[int, bytes], list[int]] = {}
        """By sender and content: when it began to sound, ns."""
        self.arrived: dict[tuple[int, int, bytes], list[int]] = {}
        """By sender, receiver and content: when it had arrived, ns."""
        self.published: dict[bytes, tuple[int, int]] = {}
        """By content: who published it, and on which stream."""
        self.samples: dict[tuple[int, bytes], int] = {}
        """By receiver and content: how often it arrived."""
        self.requests: dict[bytes, int] = {}
        """By content: how often it was served."""
        self.calls: dict[tuple[int, int], bytes] = {}
        """By caller and call id: what was asked."""
        self.ended: dict[tuple[int, int], int] = {}
        """By the same: how often it was answered or failed."""
        self.wrong: list[str] = []
        """What must not happen, as it is noticed."""
        self.recovered_s = self.crossed_s = 0.0
        self._number = 0
        fleet = EmulatedFleet(
            scenario_of(course.nodes, spacing_m=course.spacing_m, seed=course.seed),
            interpreter=course.interpreter,
            faults=course.plan,
            behaviour=course.behaviour,
            observer=self._observe,
        )
        self.sea = CrewedSea(
            fleet,
            table_of(course.nodes),
            self._deliver,
            config=course.config,
            is_serial=course.is_serial,
            acknowledge=course.acknowledge,
        )

    @property
    def crew(self) -> list[CrewNode]:
        return self.sea.crew

    def sail(self) -> None:
        """Let it happen, and look at all of it."""
        sea, rng = self.sea, self.rng
        while sea.now < seconds_to_ns(self.course.plan.until_s):
            for node in self.crew:
                if rng.random() < 0.6:
                    self._use(node)
            if rng.random() < 0.01:
                sea.cut(rng.choice(self.crew).address)
            sea.run(rng.uniform(0.1, 4.0))
        self._end_faults()
        self._see_recovery()
        sea.run(CALM_S)
        for node in self.crew:
            has_bursts = self.course.config.mtu > 64  # what more there is to say may fill one
            self._see_crossing(node, SILENT_CROSSING_S + CROSSING_S * has_bursts)
            sea.run(CALM_S)
        self._see_traffic()
        self._see_reports()
        sea.run(OWED_S)
        self._see_rest()
        assert not self.wrong, "; ".join(self.wrong)

    # What the applications do

    def _use(self, node: CrewNode) -> None:
        """Publish something, or call somebody."""
        others = [each.address for each in self.crew if each is not node]
        choice = self.rng.random()
        if choice < 0.3:
            self._call(node, self.rng.choice(others))
        elif choice < 0.6 or self.course.config.mtu > 64:  # there is no long broadcast
            self._publish(node, 10 * self.rng.choice(others) + EVERYBODY)
        else:
            self._publish(node, EVERYBODY)

    def _content(self) -> bytes:
        """Draw what nobody has said before."""
        self._number += 1
        longest = 150 if self.course.config.mtu > 64 else 40
        size = self.rng.choice([0, 6, 20, longest - 4])
        return self._number.to_bytes(4, "big") + self.rng.randbytes(size)

    def _publish(self, node: CrewNode, stream_id: int) -> bytes:
        content = self._content()
        self.published[content] = node.address, stream_id
        self.sea.apply(node, lambda engine, now: engine.publish(stream_id, content, now))
        return content

    def _call(self, node: CrewNode, server: int) -> None:
        content = self._content()
        call_id = self.sea.apply(
            node, lambda engine, now: engine.call(10 * server + CALLS, content, now)
        )
        self.calls[node.address, call_id] = content

    def _deliver(self, node: CrewNode, event: Event) -> None:
        match event:
            case SampleReceived():
                content = bytes(event.value)
                key = node.address, content
                self.samples[key] = self.samples.get(key, 0) + 1
                if self.published.get(content) != (event.source, event.stream_id):
                    self.wrong.append(f"{node.address} got {content!r}, published by nobody")
            case RequestReceived():
                content = bytes(event.value)
                self.requests[content] = self.requests.get(content, 0) + 1
                self.sea.after(self.rng.uniform(0.0, 3.0), partial(self._reply, node, event))
            case ResponseReceived():
                self._end_call(node, event.call_id)
                asked = self.calls[node.address, event.call_id]
                if event.value != asked[::-1]:
                    self.wrong.append(f"{node.address} asked {asked!r}, got {event.value!r}")
            case CallFailed():
                self._end_call(node, event.call_id)
            case _:
                pass

    def _reply(self, node: CrewNode, request: RequestReceived) -> None:
        answer = bytes(request.value)[::-1]
        self.sea.apply(node, lambda engine, now: engine.reply(request.call, answer, now))

    def _end_call(self, node: CrewNode, call_id: int) -> None:
        key = node.address, call_id
        self.ended[key] = self.ended.get(key, 0) + 1

    # What happens in the water

    def _observe(self, observation: Observation) -> None:
        signal = observation.signal
        contents = [signal.payload] if signal.kind in _MESSAGES else []
        contents += [packet.payload for packet in signal.packets]
        contents += [signal.piggyback.payload] if signal.piggyback is not None else []
        for content in contents:
            if isinstance(observation, SignalEmitted):
                self.emitted.setdefault((observation.node, content), []).append(observation.at)
            elif observation.outcome is Outcome.RECEIVED:
                way = observation.source, observation.node, content
                self.arrived.setdefault(way, []).append(observation.at)

    # What is looked at

    def _end_faults(self) -> None:
        """Go on until the last fault is over: late words are said, modems have started again."""
        if self.course.plan.rates.get(FaultKind.LATE):
            self.sea.run(self.course.plan.late_s)
        for node in self.crew:
            while not self.sea.fleet.is_up(node.address):
                self.sea.run(0.05)

    def _see_recovery(self) -> None:
        sea, began_at = self.sea, self.sea.now
        sea.until(lambda: all(node.is_up for node in self.crew), RECOVERY_S)
        self.recovered_s = ns_to_seconds(sea.now - began_at)
        sea.run(RECOVERY_S - self.recovered_s)
        limit_s = CROSSING_S + EXCHANGE_S * (self.course.acknowledge > 0)
        limit_s += CONNECTION_S * (self.course.config.mtu > 64)
        for node in self.crew:
            assert node.is_up, sea.voyage()
            self.crossed_s = max(self.crossed_s, self._see_crossing(node, limit_s))

    def _see_crossing(self, node: CrewNode, limit_s: float) -> float:
        """Publish until it arrives: what collides is not repeated by anybody but the publisher."""
        sea, published_at = self.sea, self.sea.now
        other = self.crew[self.crew.index(node) - 1]
        contents: list[bytes] = []
        while (passed_s := ns_to_seconds(sea.now - published_at)) < limit_s:
            if any((other.address, content) in self.samples for content in contents):
                return passed_s
            if passed_s >= 2.0 * len(contents):
                contents.append(self._publish(node, 10 * other.address + FRESH))
            sea.run(0.1)
        raise AssertionError(f"no sample crosses within {limit_s} s: {sea.voyage()}")

    def _see_traffic(self) -> None:
        assert not (twice := [key for key, times in self.samples.items() if times > 1]), twice
        assert not (again := [key for key, times in self.requests.items() if times > 1]), again
        assert set(self.requests) <= set(self.calls.values())
        assert set(self.ended) == set(self.calls)
        assert set(self.ended.values()) <= {1}

    def _see_reports(self) -> None:
        for node in self.crew:
            ids = [report.transmission_id for report in node.reports]
            assert sorted(ids) == [given.transmission.transmission_id for given in node.given]
            reports = {report.transmission_id: report for report in node.reports}
            for given in node.given:
                self._see_report(node, given, reports[given.transmission.transmission_id])
            contents = [given.transmission.frame_bytes for given in node.given]
            for (source, content), instants in self.emitted.items():
                if source == node.address and self.course.config.mtu <= 64:
                    assert len(instants) <= contents.count(content), f"twice: {content!r}"

    def _see_report(self, node: CrewNode, given: Given, report: TransmitReport) -> None:
        frame, content = given.transmission, given.transmission.frame_bytes
        told = f"{node.address}: {frame} is {report}"
        within = range(given.at, report.finished_at + 1)
        emitted = [at for at in self.emitted.get((node.address, content), ()) if at in within]
        way = node.address, frame.destination, content
        arrived = [at for at in self.arrived.get(way, ()) if at in within]
        assert given.at <= report.started_at <= report.finished_at, told
        match report.outcome:
            case TransmitOutcome.SENT:
                assert emitted, told
            case TransmitOutcome.DELIVERED:
                assert arrived, told
            case TransmitOutcome.REJECTED:
                assert not emitted, told
            case _:
                pass

    def _see_rest(self) -> None:
        for node in self.crew:
            assert node.dialogue.poll_timeout() is None, node.dialogue.state
            assert node.engine.is_idle
            assert held_by(node.dialogue) <= HELD_LIMIT, f"{node.address} holds too much"
        assert self.sea.fleet.poll_timeout() is None


def held_by(dialogue: AtDialogue) -> int:
    """Count the objects that a dialogue holds."""
    seen: set[int] = set()
    todo: list[object] = [vars(dialogue)]
    while todo:
        each = todo.pop()
        code = type | types.ModuleType | types.FunctionType | types.MethodType
        if id(each) in seen or isinstance(each, code):
            continue
        seen.add(id(each))
        todo += gc.get_referents(each)
    return len(seen)


def sail(seed: int, faults_s: float = FAULTS_S) -> Voyage:
    """Let a voyage happen; what goes wrong tells how to see it again."""
    voyage = Voyage(course_of(seed, faults_s))
    try:
        voyage.sail()
    except Exception as error:
        again = f"python -m tests.links.evologics.driver.voyages {seed} {faults_s:g}"
        raise AssertionError(f"{error}\nagain: {again}") from error
    return voyage


if __name__ == "__main__":
    again, *lasting = sys.argv[1:]
    sail(int(again), *map(float, lasting))
