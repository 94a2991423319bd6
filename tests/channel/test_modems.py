"""What all simple modems do, told by a driver that only takes notes."""

from typing import Any, NamedTuple

from zacoustic.channel.acknowledgement import ACKNOWLEDGEMENT_BYTES, patience_ns, turnaround_ns
from zacoustic.channel.agenda import Agenda
from zacoustic.channel.arrival import Arrival, Reception
from zacoustic.channel.faults.faults import FaultSpec
from zacoustic.channel.faults.loss import LossSpec
from zacoustic.channel.medium import Medium
from zacoustic.channel.modems import Ending, Modems, Station
from zacoustic.channel.scenario import LinkSpec, NodeSpec, Scenario

NS = 1_000_000_000
THERE_NS = NS  # 1500 m


class Sent(NamedTuple):
    frame_bytes: bytes
    destination: int
    acknowledge: bool = False


class Noted(Modems[Station[Sent], Sent]):
    """Notes ``(instant, node, what)``."""

    def __init__(self, **more: Any) -> None:
        nodes = tuple(
            NodeSpec(address=at, position=(1500.0 * (at - 1), 0.0, 10.0)) for at in (1, 2)
        )
        super().__init__(Medium(Scenario(nodes=nodes, channel="none", **more)), Agenda())
        self.stations = {at: Station(at, self.medium.profile(at)) for at in (1, 2)}
        self.notes: list[tuple[int, int, object]] = []
        self.airtime_ns = self.stations[1].profile.airtime_ns

    def note(self, station: Station[Sent], what: object) -> None:
        self.notes.append((self.agenda.now, station.address, what))

    def of(self, node: int) -> list[tuple[int, object]]:
        return [(at, what) for at, address, what in self.notes if address == node]

    def asks(self, frame: Sent) -> bool:
        return frame.acknowledge

    def finished(
        self,
        station: Station[Sent],
        frame: Sent,
        ending: Ending,
        started_at: int,
        answer: Arrival | None,
    ) -> None:
        self.note(station, (ending, started_at, answer and answer.source))

    def carrier(self, station: Station[Sent], is_heard: bool) -> None:
        self.note(station, is_heard)

    def hand_over(self, station: Station[Sent], reception: Reception, frame: Sent) -> None:
        self.note(station, reception.damage(frame.frame_bytes))

    def settle(self, station: Station[Sent]) -> None:
        pass


def test_frame_is_handed_over_behind_its_carrier_and_acknowledged() -> None:
    modems = Noted()
    modems.send(1, Sent(b"far?", 2, acknowledge=True))
    modems.agenda.run()
    there_at = modems.airtime_ns(4) + THERE_NS
    answers_at = there_at + turnaround_ns(modems.stations[2].profile) + THERE_NS
    answered_at = answers_at + modems.airtime_ns(ACKNOWLEDGEMENT_BYTES)
    assert modems.of(2) == [(THERE_NS, True), (there_at, False), (there_at, b"far?")]
    assert modems.of(1) == [
        (answers_at, True),
        (answered_at, False),
        (answered_at, (Ending.DELIVERED, 0, 2)),
    ]
    assert not modems.losses
    assert not modems.stations[1].pending


def test_modem_that_transmits_itself_does_not_answer() -> None:
    modems = Noted()
    modems.send(1, Sent(b"far?", 2, acknowledge=True))
    modems.agenda.run(modems.airtime_ns(4) + THERE_NS)
    modems.send(2, Sent(bytes(64), 1))
    modems.agenda.run()
    given_up_at = modems.airtime_ns(4) + patience_ns(modems.stations[1].profile, 1.0)
    assert (given_up_at, (Ending.NOT_DELIVERED, 0, None)) in modems.of(1)
    assert [what for _, what in modems.of(1) if isinstance(what, bytes)] == [bytes(64)]


def test_lost_and_damaged_answers_are_none() -> None:
    back = LinkSpec(source=2, target=1, loss=LossSpec(frame=1.0))
    for faulty in (Noted(links=(back,)), Noted(faults=FaultSpec(corrupt=1.0))):
        faulty.send(1, Sent(b"far?", 2, acknowledge=True))
        faulty.agenda.run()
        (end,) = [what for _, what in faulty.of(1) if isinstance(what, tuple)]
        assert end == (Ending.NOT_DELIVERED, 0, None)
    assert [what for _, what in faulty.of(2) if isinstance(what, bytes)] != [b"far?"]


def test_late_and_repeated_frames_come_when_the_scenario_wants() -> None:
    modems = Noted(faults=FaultSpec(duplicate=1.0, duplicate_after_s=0.25))
    modems.send(1, Sent(b"twice", 2))
    modems.agenda.run()
    there_at = modems.airtime_ns(5) + THERE_NS
    assert modems.of(2)[2:] == [(there_at, b"twice"), (there_at + NS // 4, b"twice")]
    late = Noted(faults=FaultSpec(jitter_s=5.0))
    late.send(1, Sent(b"late", 2))
    late.agenda.run()
    assert late.of(2)[-1][0] > modems.airtime_ns(4) + THERE_NS


def test_frame_waits_for_the_modem_and_is_forgotten_or_refused_without_one() -> None:
    modems = Noted(loss=LossSpec(frame=1.0))
    first, second, third = (Sent(bytes((each,)), 2) for each in (1, 2, 3))
    ready_at = modems.airtime_ns(1)
    modems.send(1, first)
    modems.send(1, second)
    modems.agenda.run(ready_at - 1)
    modems.send(1, third)
    modems.stations[1].pending.remove(third)
    modems.agenda.run()
    sent = [(Ending.SENT, at, None) for at in (0, ready_at)]
    assert modems.of(1) == [(ready_at, sent[0]), (2 * ready_at, sent[1])]
    assert modems.losses == {"noise": 2}
    modems.stations[1].is_up = False
    now = modems.agenda.now
    modems.send(1, third)
    modems.agenda.run()
    assert modems.of(1)[-1] == (now, (Ending.ABORTED, now, None))
