"""Calls over water that loses frames: what is repeated, and how the numbers go round."""

import pytest

from tests.core.calling import (
    acquainted,
    answer,
    call,
    ends,
    entries,
    failures,
    fleet,
    requests,
    responses,
    sent_by,
    to_nobody,
)
from tests.core.rig import Rig, link
from zacoustic.core.base.sizes import SIZES
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.engine.events import CallFailed, CallFailure, ResponseReceived
from zacoustic.core.linktypes import LinkState
from zacoustic.core.wire.agreement import WIRE_VERSION, Hello
from zacoustic.errors import QueueFullError


def test_request_is_repeated_until_the_server_has_confirmed_it() -> None:
    rig = acquainted()
    call(rig)
    rig.run(0.1, to_nobody)
    assert len(sent_by(rig, 1)) > 2
    rig.run(0.5)
    assert len(sent_by(rig, 2)) == 1
    rig.frames.clear()
    rig.run(5)
    assert rig.frames == []
    answer(rig)
    rig.exchange()
    assert len(responses(rig)) == len(requests(rig)) == 1


def test_answer_is_repeated_until_the_client_has_confirmed_it() -> None:
    rig = acquainted()
    call_id = call(rig)
    rig.exchange()
    answer(rig)
    rig.run(0.1, lambda source, node, transmission: source == 2)
    repeated = [sent for sent in sent_by(rig, 2) if sent != b"\x14\xc0"]
    assert len(repeated) > 3
    assert all(sent.endswith(b"\x14\x40done") for sent in repeated)
    assert all(sent.endswith(b"\x14\xc0") for sent in sent_by(rig, 1)[1:])
    assert responses(rig) == [(call_id, b"done")]
    rig.run(0.5)
    rig.frames.clear()
    rig.run(60)
    assert rig.frames == []
    assert rig[1].engine.is_idle
    assert rig[2].engine.is_idle


def test_calls_that_are_due_together_share_frames() -> None:
    rig = acquainted()
    for number in range(SIZES.calls.window):
        call(rig, b"%d" % number)
    rig.run(0.5)
    assert len(sent_by(rig, 1)) == 2
    for number in range(SIZES.calls.window):
        answer(rig, b"re %d" % number, number=number)
    rig.run(1)
    expected = [b"re %d" % each for each in range(SIZES.calls.window)]
    assert [value for _, value in responses(rig)] == expected
    assert len(rig.frames) < 16


def test_cancelled_request_is_not_repeated() -> None:
    rig = acquainted()
    call_id = call(rig)
    rig.run(0.05, to_nobody)
    rig[1].engine.cancel(call_id, rig.now)
    rig.frames.clear()
    rig.run(60)
    assert rig.frames == []
    assert rig[1].got(CallFailed) == []


def test_record_that_does_not_fit_a_new_link_is_not_repeated() -> None:
    rig = acquainted()
    call_id = call(rig, b"x" * 50)
    rig.exchange(to_nobody)
    rig[1].engine.handle_link_state(LinkState.UP, rig.now, link(mtu_bytes=32))
    rig[1].capabilities = link(mtu_bytes=32)
    rig.run(20)
    assert failures(rig) == [(call_id, CallFailure.TIMED_OUT, "no answer before the deadline")]


# Several


def test_several_clients_have_the_same_numbers() -> None:
    rig = Rig({address: fleet(nodes=3) for address in (1, 2, 3)})
    for client in (1, 3):
        rig[client].engine.call(20, b"from %d" % client, rig.now)
    rig.exchange()
    assert [(each.call.client, each.value) for each in requests(rig)] == [
        (1, b"from 1"),
        (3, b"from 3"),
    ]
    for request in requests(rig):
        rig[2].engine.reply(request.call, b"re " + request.value, rig.now)
    rig.run(1)
    for client in (1, 3):
        assert [e.value for e in rig[client].got(ResponseReceived)] == [b"re from %d" % client]


def test_hundreds_of_calls_go_round_the_numbers() -> None:
    rig = acquainted()
    for number in range(5 * SIZES.calls.count):
        call(rig, b"%d" % number)
        rig.run(0.5)
        assert answer(rig, b"re %d" % number)
        rig.run(0.5)
    assert [value for _, value in responses(rig)] == [
        b"re %d" % number for number in range(5 * SIZES.calls.count)
    ]
    assert len(requests(rig)) == 5 * SIZES.calls.count
    assert len(entries(rig)) <= SIZES.calls.count
    assert rig[1].engine.epoch == 1


def test_client_begins_an_epoch_when_no_number_is_proved_free() -> None:
    rig = acquainted()
    for _ in range(SIZES.calls.count):
        call(rig, timeout_s=0.01)
        rig.run(0.1, to_nobody)
    assert rig[1].engine.epoch == 1
    assert len(failures(rig)) == SIZES.calls.count
    call_id = call(rig)
    assert rig[1].engine.epoch == 2
    rig.exchange()
    assert answer(rig)
    rig.run(1)
    assert responses(rig) == [(call_id, b"done")]
    assert requests(rig)[-1].call.epoch == 2


def test_number_that_is_not_proved_free_is_refused_while_another_call_is_under_way() -> None:
    rig = acquainted()
    call(rig, {"n": 1}, stream_id=21)
    for _ in range(SIZES.calls.count):
        call(rig, timeout_s=0.01)
        rig.run(0.1, to_nobody)
    with pytest.raises(QueueFullError, match="no number is proved free"):
        call(rig)


# Lives


def test_first_answer_of_a_life_names_it_and_later_ones_do_not() -> None:
    rig = ends()
    call(rig)
    rig.exchange()
    answer(rig)
    rig.exchange()
    assert sent_by(rig, 2)[-1].endswith(b"\x14\x00\x41done")
    rig.run(1)
    rig.frames.clear()
    call(rig)
    rig.exchange()
    answer(rig, b"fine")
    rig.run(1)
    assert b"\x14\x41fine" in sent_by(rig, 2)
    assert [value for _, value in responses(rig)] == [b"done", b"fine"]


def test_answer_is_named_anew_when_the_request_comes_again_so() -> None:
    rig = acquainted()
    call(rig)
    rig.exchange()
    answer(rig)
    rig.exchange(to_nobody)
    assert sent_by(rig, 2)[-1] == b"\x14\x40done"
    rig[2].hear(
        Hello(WIRE_VERSION, 1, fleet().digest).encode() + b"\x14\x00please", rig.now, source=1
    )
    rig.exchange()
    assert sent_by(rig, 2)[-1].endswith(b"\x14\x00\x41done")
    assert len(requests(rig)) == len(responses(rig)) == 1


@pytest.mark.parametrize("number", range(SIZES.calls.count))
def test_no_answer_to_a_former_life_is_taken_whatever_the_number(number: int) -> None:
    rig = acquainted()
    rig.restart(1, fleet())
    call(rig, b"second life")
    rig.exchange(to_nobody)
    # The server has not heard of the second life. It introduces itself, as to any stranger.
    records = bytes((0x14, 0x40 | number)) + b"to the first"
    rig[1].hear(
        Hello(WIRE_VERSION, 1, fleet().digest).encode() + records, rig.now, source=2, destination=1
    )
    rig.now += seconds_to_ns(1)
    for kind in (0x40, 0x80, 0xC0):
        payload = b"" if kind == 0xC0 else b"\x01"
        for head in ((0x14, kind | number), (0x14, number, kind | 1)):
            rig[1].hear(bytes(head) + payload, rig.now, source=2, destination=1)
    assert rig[1].got(ResponseReceived) == []
    assert rig[1].got(CallFailed) == []
    assert rig[1].engine.stats.dropped["unexpected_answer"] == 7


def test_calls_of_a_former_life_are_known_until_nothing_of_it_can_arrive() -> None:
    rig = ends()
    first = Hello(WIRE_VERSION, 1, fleet().digest).encode()
    rig[2].hear(first + b"\x14\x00first life", 0, source=1)
    rig.restart(1, fleet())
    for _ in range(2):
        call(rig)
        rig.exchange()
    assert "call/1/1/20/0" in entries(rig)
    rig.run(8)
    assert "call/1/1/20/0" in entries(rig)
    call(rig)
    rig.exchange()
    assert [name.split("/")[2] for name in entries(rig)] == ["2"] * 3


def test_late_introduction_of_a_former_life_ends_no_call() -> None:
    rig = ends()
    first = Hello(WIRE_VERSION, 1, fleet().digest).encode()
    rig[2].hear(first + b"\x14\x00first life", 0, source=1)
    rig.restart(1, fleet())
    call_id = call(rig)
    rig.exchange()
    rig[2].hear(first + b"\x14\x00first life", rig.now, source=1)
    answer(rig, b"too early")
    rig.run(9)
    assert [each.value for each in requests(rig)] == [b"first life", b"please"]
    assert responses(rig) == [(call_id, b"too early")]


# The journal
