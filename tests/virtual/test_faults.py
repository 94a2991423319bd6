"""What goes wrong in a virtual network, and that nothing else does."""

import random
from collections.abc import Mapping
from functools import partial
from typing import Any

import pytest

from tests.virtual.fleet import line
from zacoustic.channel.agenda import Agenda
from zacoustic.channel.faults.nodefaults import ClockSpec, JournalSpec, JumpSpec, SpanSpec
from zacoustic.core.base.journal import EPOCH_KEY, LIFE_KEY, JournalWrite
from zacoustic.core.base.qos import Qos
from zacoustic.core.base.trace import TraceRecord, TraceSink
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.linktypes import LinkState
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import NodeDownError, VirtualNetwork
from zacoustic.testing.virtualclock import NodeClock
from zacoustic.testing.virtualjournal import VirtualJournal

YEAR_S = 3.2e7
TABLE = StreamTable(
    [TopicSpec(stream_id=1, name="a", qos=Qos(depth=100))], nodes={1: "a", 2: "b", 3: "c"}
)


def network(**settings: Any) -> VirtualNetwork:
    return VirtualNetwork(line(0, 300, 600, channel="none", **settings), TABLE)


def write(key: str, value: bytes | None, write_id: int = 1) -> JournalWrite:
    return JournalWrite(write_id=write_id, key=key, value=value)


# Journals


def test_a_commit_is_there_all_or_none() -> None:
    for draw, there in ((0.4, True), (0.6, False)):
        journal = VirtualJournal(1, JournalSpec(commit_s=1.0, untold=0.5))
        journal.add(write("a", b"1"))
        assert journal.begin()
        journal.finish()
        for key in "abc":
            journal.add(write(key, b"2"))
        journal.begin()
        journal.add(write("d", b"2"))
        journal.crash(draw)
        expected = {"a": b"2", "b": b"2", "c": b"2"} if there else {"a": b"1"}
        assert journal.entries == expected
        kept = [journal.is_journalled(number) for number in range(1, 7)]
        assert kept == [True, there, there, there, False, False]
        journal.add(write("a", None))
        journal.begin()
        journal.finish()
        assert "a" not in journal.entries
        assert journal.is_journalled(6)


def test_a_journal_that_keeps_nothing_knows_the_epoch_only() -> None:
    journal = VirtualJournal(1, JournalSpec(keeps=False))
    journal.add(write(EPOCH_KEY, b"\x00\x07"))
    journal.add(write("a", b"1"))
    journal.begin()
    journal.finish()
    journal.crash(0.0)
    assert journal.entries == {EPOCH_KEY: b"\x00\x07"}
    assert journal.begin_life() == 8


class WritingEngine(Engine):
    """Writes down the number of its life, and notes what it was given and told."""

    given: list[Mapping[str, bytes]]

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.told: list[int] = []
        self.failures: list[str] = []
        self.own: list[JournalWrite] = []

    def poll_journal(self) -> JournalWrite | None:
        return self.own.pop(0) if self.own else super().poll_journal()

    def handle_journal_committed(self, write_id: int, now: int) -> None:
        self.told.append(write_id)
        super().handle_journal_committed(write_id, now)

    def handle_journal_state(self, failure: str, now: int) -> None:
        self.failures.append(failure)
        super().handle_journal_state(failure, now)


def writing(commit_s: float, **settings: Any) -> tuple[VirtualNetwork, list[WritingEngine]]:
    engines: list[WritingEngine] = []

    def build(
        *,
        address: int,
        table: StreamTable,
        epoch: int,
        rng: random.Random,
        rules: TransmitRules,
        stored: Mapping[str, bytes],
        trace: TraceSink | None,
    ) -> Engine:
        engine = WritingEngine(
            address=address,
            table=table,
            epoch=epoch,
            rng=rng,
            rules=rules,
            stored=stored,
            trace=trace,
        )
        engines.append(engine)
        return engine

    faults = {"journal": {"commit_s": commit_s, **settings}}
    medium = VirtualNetwork(
        line(0, 300, channel="none", faults=faults), {1: TABLE, 2: TABLE}, build=build
    )
    return medium, engines


def add(engine: Engine, now: int, write: JournalWrite) -> None:
    assert isinstance(engine, WritingEngine)
    engine.own.append(write)


def test_what_was_committed_is_given_to_the_next_life_and_nothing_else() -> None:
    medium, engines = writing(1.0)
    medium.run(until_s=5)
    medium.apply(1, partial(add, write=write("a", b"1", 91)))
    medium.run(until_s=5.5)
    medium.apply(1, partial(add, write=write("b", b"1", 92)))
    medium.run(until_s=6.5)
    assert engines[0].told[-1] == 91
    assert medium.journal(1).entries.keys() == {EPOCH_KEY, LIFE_KEY, "a"}
    medium.crash(1)
    medium.run(until_s=20)
    medium.start(1)
    lives = {EPOCH_KEY: b"\x00\x02", LIFE_KEY: b"\x00\x00\x00\x00\x00\x00\x00\x02"}
    assert dict(engines[-1].stored) == {**lives, "a": b"1"}
    assert engines[-1].epoch == 2
    assert medium.life(1) == 2


def test_writes_during_a_commit_are_the_next_commit() -> None:
    medium, engines = writing(1.0)
    medium.run(until_s=5)
    for number in range(4):
        one = partial(add, write=write(f"{number}", b"1", 90 + number))
        medium.at(5 + 0.3 * number, partial(medium.apply, 1, one))
    medium.run(until_s=6.1)
    assert engines[0].told[-1:] == [90]
    medium.run(until_s=7.1)
    assert engines[0].told[-4:] == [90, 91, 92, 93]


def test_a_full_disk_is_told_and_the_commit_comes_later() -> None:
    medium, engines = writing(0.1, fails=[{"node": 1, "from_s": 10, "to_s": 30}])
    medium.run(until_s=15)
    medium.apply(1, partial(add, write=write("a", b"1", 91)))
    medium.run(until_s=29)
    assert engines[0].failures == ["no space left on the device"]
    assert 91 not in engines[0].told
    medium.run(until_s=40)
    assert engines[0].failures == ["no space left on the device", ""]
    assert engines[0].told[-1] == 91
    assert engines[1].failures == []


def test_nothing_is_sent_before_the_epoch_is_committed() -> None:
    medium = VirtualNetwork(
        line(0, 300, channel="none", faults={"journal": {"commit_s": 20}}), TABLE, trace=None
    )
    medium.publish(1, 1, b"x")
    medium.run(until_s=19)
    assert medium.engine(1).stats.frames_transmitted == 0
    medium.crash(1)
    medium.start(1)
    assert medium.engine(1).epoch == 2
    medium.publish(1, 1, b"x")
    medium.run(until_s=60)
    assert medium.engine(1).stats.frames_transmitted > 0
    assert [event.value for event in medium.samples(2)] == [b"x"]


# Crashes


def test_a_crashed_node_does_nothing_until_it_is_started() -> None:
    medium = network(faults={"crashes": [{"node": 2, "at_s": [50], "restart_after_s": 100}]})
    for second in range(0, 300, 10):
        medium.at(second, partial(medium.publish, 1, 1, b"%d" % second))
    medium.run(until_s=100)
    assert not medium.is_running(2)
    with pytest.raises(NodeDownError, match="node 2 is down"):
        medium.publish(2, 1, b"x")
    with pytest.raises(NodeDownError):
        medium.engine(2)
    medium.run(until_s=400)
    got = [int(event.value) for event in medium.samples(2)]
    assert [second for second in got if second < 50 or second >= 150] == got
    assert got[-1] == 290
    assert medium.losses["node_down"] >= 9
    assert sum(stats.frames_received for stats in medium.stats()) > 30
    assert len(list(medium.stats())) == 4


def test_crashes_at_a_rate_go_on_until_their_end() -> None:
    crash = {"node": 3, "every_s": 100, "restart_after_s": 5, "to_s": 10_000, "reboots": True}
    lives: list[tuple[int, bool]] = []
    scenario = line(0, 300, 600, channel="none", faults={"crashes": [crash]})
    medium = VirtualNetwork(
        scenario, TABLE, lives=lambda address, is_alive: lives.append((address, is_alive))
    )
    medium.run(until_s=30_000)
    assert 70 < medium.life(3) < 120
    assert lives == [(3, False), (3, True)] * (medium.life(3) - 1)
    assert medium.is_quiet


def test_the_modem_ends_what_a_crashed_node_has_begun() -> None:
    medium = network()
    medium.publish(1, 1, b"x" * 40)
    medium.run(until_s=0.1)
    medium.restart(1)
    medium.run(until_s=30)
    assert [event.value for event in medium.samples(2)] == [b"x" * 40]


# Clocks


def test_a_clock_that_drifts_is_slow_or_fast_and_never_early() -> None:
    for ppm in (-100.0, 0.1, 50.0):
        clock = NodeClock(ClockSpec(node=1, drift_ppm=ppm))
        assert clock.local(10**15) == 10**15 + round(10**9 * ppm)
        for local in (1, 10**9 + 1, 123_456_789_012_345):
            instant = clock.instant(local)
            assert clock.local(instant) >= local > clock.local(instant - 1)


def test_a_reboot_begins_the_monotonic_clock_anew_and_not_the_wall_clock() -> None:
    jump = JumpSpec(at_s=50, by_s=-YEAR_S)
    clock = NodeClock(ClockSpec(node=1, offset_s=5, jumps=(jump,)))
    before = clock.wall(49 * NS_PER_S)
    assert clock.wall(51 * NS_PER_S) - before == 2 * NS_PER_S - round(YEAR_S) * NS_PER_S
    wall = clock.wall(100 * NS_PER_S)
    clock.reboot(100 * NS_PER_S)
    assert clock.local(100 * NS_PER_S) == NS_PER_S
    assert clock.local(101 * NS_PER_S) == 2 * NS_PER_S
    assert clock.wall(100 * NS_PER_S) == wall


def test_engines_live_by_their_own_clocks_and_the_trace_by_that_of_the_network() -> None:
    clocks = [{"node": 1, "drift_ppm": 10_000}]
    crashes = [{"node": 2, "at_s": [100], "reboots": True}]
    records: list[TraceRecord] = []
    medium = VirtualNetwork(
        line(0, 300, channel="none", faults={"clocks": clocks, "crashes": crashes}),
        TABLE,
        trace=records.append,
    )
    medium.every(20, partial(medium.publish, 1, 1, b"x"), first_s=10)
    medium.run(until_s=500)
    assert len(medium.samples(2)) >= 22
    assert medium.local_ns(1) == 505 * NS_PER_S
    assert medium.local_ns(2) == 401 * NS_PER_S
    assert [record.at for record in records] == sorted(record.at for record in records)
    assert medium.samples(2)[-1].received_at < 401 * NS_PER_S


def test_an_engine_hears_of_the_wall_clock_if_its_node_knows_how_wrong_it_is() -> None:
    told: list[tuple[int, int | None]] = []

    class Listening(Engine):
        def handle_clock(self, offset_ns: int, error_ns: int | None, now: int) -> None:
            told.append((offset_ns, error_ns))
            super().handle_clock(offset_ns, error_ns, now)

    spec = {"node": 1, "error_s": 0.5, "offset_s": 3, "jumps": [{"at_s": 40, "by_s": 1e8}]}
    ignorant = {"node": 2, "offset_s": 7}
    scenario = line(0, 300, channel="none", faults={"clocks": [spec, ignorant]})
    medium = VirtualNetwork(scenario, TABLE, build=Listening)
    medium.run(until_s=100)
    assert len(told) == 2
    assert told[1][0] - told[0][0] == 10**8 * NS_PER_S
    assert {error for _, error in told} == {NS_PER_S // 2}


# Modems


def test_an_unplugged_modem_hears_nothing_and_comes_back() -> None:
    states: list[tuple[int, LinkState]] = []
    faults = {"unplugged": [{"node": 2, "from_s": 50, "to_s": 150}]}
    medium = network(faults=faults)
    for second in range(0, 300, 10):
        medium.at(second, partial(medium.publish, 1, 1, b"%d" % second))
    medium.at(100, lambda: states.append((2, medium.engine(2).link_state)))
    medium.run(until_s=400)
    states.append((2, medium.engine(2).link_state))
    assert states == [(2, LinkState.DOWN), (2, LinkState.UP)]
    got = [int(event.value) for event in medium.samples(2)]
    assert got == [second for second in range(0, 300, 10) if not 50 <= second < 150]
    assert medium.losses == {"unplugged": 10}


def test_a_blackout_of_a_pair_leaves_the_third_alone() -> None:
    medium = network(faults={"blackouts": [{"pair": [1, 2], "from_s": 0, "to_s": 1000}]})
    for second in range(0, 300, 10):
        medium.at(second, partial(medium.publish, 1, 1, b"%d" % second))
    medium.run(until_s=400)
    assert medium.samples(2) == []
    assert len(medium.samples(3)) == 30


# Time


def test_a_timer_that_is_armed_for_now_for_ever_is_an_error() -> None:
    agenda = Agenda()

    def again() -> None:
        agenda.push(agenda.now, again)

    agenda.push(5, again)
    with pytest.raises(RuntimeError, match="time stands still at 5 ns"):
        agenda.run()


def test_a_span_ends_after_it_begins() -> None:
    with pytest.raises(ValueError, match="to_s is 1; allowed: above from_s"):
        SpanSpec(node=1, from_s=1, to_s=1)
