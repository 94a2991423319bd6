"""Calls over restarts: what the journal of a server keeps."""

from tests.core.calling import (
    NODES,
    acquainted,
    answer,
    call,
    entries,
    failures,
    fleet,
    requests,
    responses,
    sent_by,
    to_nobody,
)
from tests.core.rig import Rig
from zacoustic.core.base.sizes import SIZES
from zacoustic.core.engine.events import CallFailure
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable


def test_nothing_runs_and_nothing_is_confirmed_before_it_is_written_down() -> None:
    rig = acquainted()
    rig[2].commits = False
    call(rig)
    rig.run(0.1)
    assert len(sent_by(rig, 1)) > 2
    assert not any(b"\x14\xc0" in sent for sent in sent_by(rig, 2))
    assert requests(rig) == []
    rig[2].commits = True
    rig[2].settle()
    assert len(requests(rig)) == 1
    rig[2].commits = False
    answer(rig)
    rig.run(0.1)
    assert responses(rig) == []
    rig[2].commits = True
    rig[2].settle()
    rig.exchange()
    assert len(responses(rig)) == 1


def test_request_that_is_written_down_after_its_deadline_does_not_run() -> None:
    rig = acquainted()
    rig[2].commits = False
    call(rig)
    rig.run(11)
    rig[2].commits = True
    rig[2].settle()
    rig.run(60)
    assert requests(rig) == []
    assert entries(rig) == []


def test_request_that_was_not_written_down_runs_in_the_next_life() -> None:
    rig = acquainted()
    rig[2].commits = False
    call_id = call(rig)
    rig.run(0.1)
    rig.restart(2, fleet(), keeps=True)
    rig.run(1)
    assert len(requests(rig)) == 1
    answer(rig)
    rig.run(1)
    assert responses(rig) == [(call_id, b"done")]


def test_answer_survives_the_server() -> None:
    rig = acquainted()
    call_id = call(rig)
    rig.exchange()
    answer(rig, b"from the first life")
    rig.exchange(to_nobody)
    rig.restart(2, fleet(), keeps=True)
    rig.run(1)
    assert requests(rig) == []
    assert responses(rig) == [(call_id, b"from the first life")]
    rig.run(60)
    assert entries(rig) == []


def test_call_that_ran_when_the_server_died_is_unknown() -> None:
    rig = acquainted()
    call_id = call(rig)
    rig.exchange()
    assert len(requests(rig)) == 1
    rig.restart(2, fleet(), keeps=True)
    rig.run(1)
    assert requests(rig) == []
    assert failures(rig) == [(call_id, CallFailure.UNKNOWN, "")]
    rig.run(60)
    assert entries(rig) == []
    assert rig[2].engine.is_idle


def test_stored_calls_of_a_former_life_of_the_client_do_not_reach_the_present_one() -> None:
    rig = acquainted()
    call(rig, b"first life")
    rig.exchange()
    answer(rig, b"to the first life")
    rig.restart(1, fleet())
    rig.restart(2, fleet(), keeps=True)
    for number in range(SIZES.calls.count - 23 + 1):
        call(rig, b"%d" % number, timeout_s=0.001)
        rig.run(0.01, lambda source, node, transmission: source == 2)
    assert requests(rig) == []
    assert responses(rig) == []


def test_calls_of_a_table_that_has_changed_are_dropped() -> None:
    rig = acquainted()
    call_id = call(rig)
    rig.exchange()
    answer(rig)
    rig.exchange(to_nobody)
    assert len(entries(rig)) == 1
    rig.restart(2, fleet(name="disarm"), keeps=True)
    assert entries(rig) == []
    rig.run(20)
    assert responses(rig) == []
    # The request had no confirm yet, comes again, and meets the other table.
    assert [each[:2] for each in failures(rig)] == [(call_id, CallFailure.TABLE_MISMATCH)]


def test_stored_call_of_a_stream_that_is_gone_is_dropped() -> None:
    rig = acquainted()
    call(rig)
    rig.exchange()
    rig.restart(2, StreamTable([TopicSpec(stream_id=1, name="a")], nodes=NODES), keeps=True)
    assert entries(rig) == []


def test_service_without_journal_writes_nothing() -> None:
    rig = Rig({1: fleet(), 2: fleet(journal=False)})
    call(rig)
    rig.exchange()
    answer(rig)
    rig.run(1)
    assert len(responses(rig)) == 1
    assert entries(rig) == []


# Small frames
