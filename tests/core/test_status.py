"""What a node says of itself to those that ask: who is answered, and what each answer holds."""

from pathlib import Path
from typing import Any

import pytest

from tests.core.rig import End, Rig
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import CallFailed, CallFailure, ResponseReceived
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access.spec import TdmaSpec
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.status import STATUS_STREAM_ID, JournalStatus, NodeStatus
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import LocalError
from zacoustic.run.journal import MemoryJournal, journal_in

UTC_S = 1_750_000_000


def table(name: str = "nav", **settings: Any) -> StreamTable:
    specs = [TopicSpec(stream_id=1, name=name)]
    return StreamTable(specs, **({"nodes": {1: "shore", 2: "auv1"}} | settings))


def asked(rig: Rig, run_s: float = 20.0) -> NodeStatus | CallFailed:
    """Let node 1 ask node 2; return what came of it."""
    call_id = rig[1].engine.status.ask(2, rig.now, timeout_s=30)
    rig.run(run_s)
    for failed in rig[1].got(CallFailed):
        if failed.call_id == call_id:
            return failed
    (found,) = [each for each in rig[1].got(ResponseReceived) if each.call_id == call_id]
    assert found.stream_id == STATUS_STREAM_ID
    return NodeStatus.from_wire(found.value)


def test_a_node_says_what_its_clock_shows_whether_or_not_it_is_believed() -> None:
    rig = Rig({1: table(), 2: table()})
    found = asked(rig)
    assert isinstance(found, NodeStatus)
    assert (found.utc_s, found.clock_error_s) == (None, None)
    for error_ns, error_s in ((20_000_000, 0.02), (None, None), (10**15, 3600.0)):
        rig[2].engine.handle_clock(UTC_S * NS_PER_S - rig.now, error_ns, rig.now)
        told_at = rig.now
        found = asked(rig)
        assert isinstance(found, NodeStatus)
        assert found.utc_s is not None
        assert abs(found.utc_s - UTC_S - (rig.now - told_at) / NS_PER_S) <= 20
        assert found.clock_error_s == error_s
    rig[2].engine.handle_clock(-rig.now - 5 * NS_PER_S, None, rig.now)
    found = asked(rig)
    assert isinstance(found, NodeStatus)
    assert found.utc_s == 0, "a clock of before 1970 shows the first second"


def test_tables_that_differ_do_not_keep_a_status_away() -> None:
    rig = Rig({1: table(), 2: table("other")})
    assert isinstance(asked(rig, 60.0), NodeStatus)


def test_who_is_not_in_the_list_is_told_nothing() -> None:
    rig = Rig({1: table(), 2: table(nodes={2: "auv1", 3: "usv"})})
    found = asked(rig, 40.0)
    assert isinstance(found, CallFailed)
    assert found.failure in (CallFailure.HANDLER, CallFailure.TIMED_OUT)


def test_a_table_that_has_the_id_for_itself_carries_no_status() -> None:
    own = ServiceSpec(stream_id=STATUS_STREAM_ID, name="arm", server=2)
    taken = StreamTable([own], nodes={1: "shore", 2: "auv1"})
    rig = Rig({1: taken, 2: taken})
    assert not rig[1].engine.status.is_carried
    with pytest.raises(LocalError, match="174"):
        rig[1].engine.status.ask(2, rig.now, timeout_s=30)
    with pytest.raises(LocalError, match=r"allowed: 1\.\.254"):
        Rig({1: table(), 2: table()})[1].engine.status.ask(255, 0, timeout_s=30)


def test_schedules_are_told_apart_and_clocks_are_no_part_of_them() -> None:
    def schedule(**changes: Any) -> int:
        settings: dict[str, Any] = {"slots": (1, 2), "slot_s": 3.0, "clock_error_s": 0.1}
        access = TdmaSpec(**(settings | {"max_range_m": 1000.0} | changes))
        rules = {2: TransmitRules(access=access)}
        return Rig({2: table()}, rules=rules)[2].engine.status.own(0).schedule

    assert Rig({2: table()})[2].engine.status.own(0).schedule == 0
    assert schedule() == schedule(clock_error_s=0.2) != 0
    assert len({schedule(), schedule(slots=(2, 1)), schedule(slot_s=4.0)}) == 3


def test_what_is_said_of_the_journal(tmp_path: Path) -> None:
    def said(stored: dict[str, bytes]) -> tuple[JournalStatus, int]:
        status = End(2, table(), journal=stored).engine.status.own(0)
        return status.journal, status.starts

    assert said({}) == (JournalStatus.NONE, 0)
    memory = MemoryJournal()
    assert said(dict(memory.recover().entries)) == (JournalStatus.NONE, 1)
    for start in (1, 2, 3):
        journal = journal_in(tmp_path, 2)
        entries = dict(journal.recover().entries)
        journal.close()
        assert said(entries) == (JournalStatus.KEPT, start)
    (file,) = tmp_path.glob("*.sqlite")
    file.write_bytes(b"no database" * 1000)
    journal = journal_in(tmp_path, 2)
    entries = dict(journal.recover().entries)
    journal.close()
    assert said(entries)[0] is JournalStatus.DOUBTED
    rig = Rig({2: table()})
    end = rig[2]
    end.engine.handle_journal_state("no space left", 0)
    assert end.engine.status.own(0).journal is JournalStatus.NONE, "there is none at all"


def test_what_a_number_cannot_hold_is_told_as_its_largest() -> None:
    status = NodeStatus(
        journal=JournalStatus.FAILING, starts=1 << 20, utc_s=1 << 40, clock_error_s=1e9,
        range_m=100_000,
    )  # fmt: skip
    stream = table().by_id(STATUS_STREAM_ID)
    payload = stream.response_codec.encode(status.to_wire())
    response = stream.response_codec.decode(payload)
    assert isinstance(response, dict)
    back = NodeStatus.from_wire(response)
    assert (back.starts, back.utc_s, back.range_m) == (65_535, (1 << 32) - 1, 65_535)
    assert back.clock_error_s == 3600
    assert len(payload) <= 24


@pytest.mark.parametrize("lost", [{0}, {1}, {0, 1}, {1, 2}, {0, 2, 4}])
def test_lost_frames_are_asked_again_and_a_status_arrives_once(lost: set[int]) -> None:
    rig = Rig({1: table(), 2: table()})
    call_id = rig[1].engine.status.ask(2, rig.now, timeout_s=60)
    sent = iter(range(10_000))
    rig.run(60, passes=lambda source, node, transmission: next(sent) not in lost)
    answers = [each for each in rig[1].got(ResponseReceived) if each.call_id == call_id]
    assert len(answers) == 1
