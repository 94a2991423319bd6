import random
from collections.abc import Callable
from typing import Any

import pytest

from tests.core.rmw_desert import peer
from tests.core.rmw_desert.peer import REQUEST, RESPONSE, SAMPLE, Heard, Peer, packet
from tests.core.rmw_desert.vectors import read_vectors
from tests.core.rmw_desert.vehicle import (
    ADD,
    COMMAND,
    EMPTY,
    FLAGS,
    MANY,
    NOTE,
    POSE,
    SHORE,
    SPECS,
    TRIGGER,
    TWIST,
    VEHICLE,
    hear,
    node,
    said,
    samples,
    table,
)
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import (
    CallFailed,
    CallFailure,
    GoalKey,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.core.linktypes import LinkState
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.errors import (
    LocalError,
    PayloadInvalidError,
    PayloadTooLargeError,
    QueueFullError,
    RangeUnavailableError,
    UnknownStreamError,
)

VECTORS = {vector.name: vector for vector in read_vectors()}
POSE_ITEMS = (5.5, 5.5, 0.0, 0.0, -0.25)


def test_a_sample_goes_as_the_packet_of_rmw_desert_and_nothing_else_goes() -> None:
    shore = node(SHORE)
    assert said(shore, 0) == b""
    shore.engine.publish(COMMAND, TWIST, 0)
    assert said(shore, 0) == VECTORS["twist_id4"].packet
    assert said(shore, 10 * NS_PER_S) == b""
    assert shore.engine.is_idle


def test_a_sample_of_a_peer_is_that_of_the_only_publisher_there_is() -> None:
    shore = node(SHORE)
    hear(shore, packet(SAMPLE, POSE, *POSE_ITEMS))
    hear(shore, packet(SAMPLE, NOTE, "hello"))
    pose, note = shore.got(SampleReceived)
    assert (pose.source, pose.instance, pose.age_s) == (VEHICLE, (), None)
    assert pose.value["angular_velocity"] == -0.25
    assert (note.source, note.value) == (0, {"data": "hello"})
    assert shore.engine.peers() == {}
    assert shore.engine.measurements.addresses() == []


def test_an_empty_message_is_one_zero() -> None:
    shore, vehicle = node(SHORE), node(VEHICLE)
    shore.engine.publish(EMPTY, {}, 0)
    data = said(shore, 0)
    assert data == packet(SAMPLE, EMPTY, 0)
    hear(vehicle, data * 3)
    assert samples(vehicle) == [(EMPTY, {})] * 3


def test_what_the_table_gives_to_others_is_dropped() -> None:
    shore, vehicle = node(SHORE), node(VEHICLE)
    hear(shore, packet(SAMPLE, COMMAND, *(0.0,) * 6))
    with pytest.raises(LocalError, match="not a publisher"):
        vehicle.engine.publish(COMMAND, TWIST, 0)
    assert samples(shore) == []
    assert shore.engine.stats.dropped == {"not_publisher": 1}


def test_a_call_is_asked_once_and_answered_by_its_sequence_id() -> None:
    shore, vehicle = node(SHORE), Peer()
    call_id = shore.engine.call(ADD, {"a": 2, "b": -3}, 0)
    (asked,) = vehicle.hear(said(shore, 0))
    sequence = asked.items[0]
    assert asked == Heard(REQUEST, ADD, [sequence, 2, -3])
    assert 1000 <= sequence <= 65535  # never one that rmw_desert draws
    hear(shore, packet(RESPONSE, ADD, 999, 7))  # for a client of rmw_desert
    assert shore.got(ResponseReceived) == []
    hear(shore, packet(RESPONSE, ADD, sequence, -1))
    hear(shore, packet(RESPONSE, ADD, sequence, -1))
    (answer,) = shore.got(ResponseReceived)
    assert (answer.call_id, answer.stream_id, answer.value) == (call_id, ADD, {"sum": -1})
    assert shore.engine.stats.dropped == {"unexpected_answer": 2}
    assert said(shore, 100 * NS_PER_S) == b""
    assert shore.engine.is_idle


def test_a_call_without_an_answer_fails_and_is_never_repeated() -> None:
    shore = node(SHORE)
    call_id = shore.engine.call(ADD, {"a": 1, "b": 1}, 0, timeout_s=5)
    assert said(shore, 0)
    for second in range(1, 5):
        assert said(shore, second * NS_PER_S) == b""
    assert shore.engine.poll_timeout() == 5 * NS_PER_S
    shore.engine.handle_timeout(5 * NS_PER_S)
    shore.settle()
    (failed,) = shore.got(CallFailed)
    assert (failed.call_id, failed.failure) == (call_id, CallFailure.TIMED_OUT)
    assert shore.engine.is_idle


def test_a_call_that_is_cancelled_or_too_old_does_not_leave() -> None:
    shore = node(SHORE)
    shore.engine.handle_link_state(LinkState.DOWN, 0)
    shore.engine.cancel(shore.engine.call(ADD, {"a": 1, "b": 1}, 0), 0)
    shore.engine.call(ADD, {"a": 2, "b": 2}, 0, timeout_s=1)
    shore.engine.handle_timeout(NS_PER_S)
    shore.engine.handle_link_state(LinkState.UP, NS_PER_S, shore.capabilities)
    assert said(shore, NS_PER_S) == b""
    assert [each.failure for each in shore.got(CallFailed)] == [CallFailure.TIMED_OUT]


def test_sixteen_calls_to_a_service_are_under_way_at_most() -> None:
    shore = node(SHORE)
    for number in range(16):
        shore.engine.call(ADD, {"a": number, "b": 0}, 0)
    with pytest.raises(QueueFullError, match="16 calls"):
        shore.engine.call(ADD, {"a": 16, "b": 0}, 0)
    heard = Peer().hear(said(shore, 0))
    assert [each.items[1] for each in heard] == list(range(16))
    assert len({each.items[0] for each in heard}) == 16


def test_requests_are_served_with_their_sequence_id_whatever_it_is() -> None:
    for sequence in (0, 23, 999, 2**63):
        shore, client = node(SHORE), Peer()
        hear(shore, packet(REQUEST, TRIGGER, sequence, 0))
        (request,) = shore.got(RequestReceived)
        assert request.value == {}
        answer = {"success": True, "message": ""}
        assert shore.engine.reply(request.call, answer, 0)
        assert not shore.engine.reply(request.call, answer, 0)
        (heard,) = client.hear(said(shore, 0))
        assert heard == Heard(RESPONSE, TRIGGER, [sequence, True, ""])


def test_a_response_is_the_packet_of_rmw_desert() -> None:
    shore = node(SHORE)
    hear(shore, VECTORS["req_trigger_id254"].packet)
    (request,) = shore.got(RequestReceived)
    shore.engine.reply(request.call, {"success": True, "message": ""}, 0)
    assert said(shore, 0) == VECTORS["resp_trigger_id254"].packet


def test_two_clients_with_one_sequence_id_are_both_served() -> None:
    vehicle = node(VEHICLE)
    for a, b in ((1, 1), (2, 2)):
        hear(vehicle, packet(REQUEST, ADD, 5, a, b))
    first, second = vehicle.got(RequestReceived)
    assert first.call != second.call
    vehicle.engine.reply(second.call, {"sum": 4}, 0)
    vehicle.engine.reply(first.call, {"sum": 2}, 0)
    assert [each.items for each in Peer().hear(said(vehicle, 0))] == [[5, 4], [5, 2]]


def test_a_request_that_comes_twice_runs_once_and_is_answered_again() -> None:
    vehicle = node(VEHICLE, propagation_s=1.0)
    request = packet(REQUEST, ADD, 5, 1, 1)
    hear(vehicle, request * 2)
    (only,) = vehicle.got(RequestReceived)
    vehicle.engine.reply(only.call, {"sum": 2}, 0)
    answer = said(vehicle, 0)
    hear(vehicle, request, NS_PER_S)
    assert said(vehicle, NS_PER_S) == answer == packet(RESPONSE, ADD, 5, 2)
    assert not vehicle.engine.reply(only.call, {"sum": 3}, 0)
    assert vehicle.engine.stats.dropped == {"repeated_request": 2}
    forgotten_at = vehicle.engine.poll_timeout()
    assert forgotten_at is not None
    assert 4 * NS_PER_S < forgotten_at < 5 * NS_PER_S
    vehicle.engine.handle_timeout(forgotten_at)
    hear(vehicle, request, forgotten_at)  # one of a thousand numbers, drawn again
    assert len(vehicle.got(RequestReceived)) == 2


def test_an_error_of_a_handler_has_no_form_and_a_late_answer_is_none() -> None:
    shore = node(SHORE)
    hear(shore, packet(REQUEST, TRIGGER, 5, 0))
    hear(shore, packet(REQUEST, TRIGGER, 6, 0))
    first, second = shore.got(RequestReceived)
    assert not shore.engine.reply_error(first.call, CallFailure.HANDLER, "no", 0)
    assert shore.engine.poll_timeout() == second.deadline_at
    shore.engine.handle_timeout(second.deadline_at)
    assert not shore.engine.reply(second.call, {"success": True, "message": ""}, 61 * NS_PER_S)
    assert said(shore, 61 * NS_PER_S) == b""


def test_requests_for_others_and_too_many_of_them_are_dropped() -> None:
    shore, vehicle = node(SHORE), node(VEHICLE)
    hear(shore, packet(REQUEST, ADD, 1, 2, 3))
    assert shore.engine.stats.dropped == {"not_for_us": 1}
    for sequence in range(70):
        hear(vehicle, packet(REQUEST, ADD, sequence, 2, 3))
    requests = vehicle.got(RequestReceived)
    assert len(requests) == 64
    assert vehicle.engine.stats.dropped == {"too_many_calls": 6}
    vehicle.engine.reply(requests[3].call, {"sum": 5}, 0)
    hear(vehicle, packet(REQUEST, ADD, 99, 2, 3))
    assert len(vehicle.got(RequestReceived)) == 65


NOT_TO_BE_SENT = (
    (NOTE, {"data": "x" * 128}, PayloadInvalidError, "String.data has 128 bytes"),
    (NOTE, {"data": "é" * 64}, PayloadInvalidError, "String.data has 128 bytes"),
    (NOTE, {"data": "a\0b"}, PayloadInvalidError, "String.data has a NUL"),
    (FLAGS, {"flags": [True]}, PayloadInvalidError, "Flags.flags is a sequence of booleans"),
)


@pytest.mark.parametrize(("stream_id", "value", "error", "text"), NOT_TO_BE_SENT)
def test_what_would_crash_its_receiver_is_refused(
    stream_id: int, value: Any, error: type[Exception], text: str
) -> None:
    shore = node(SHORE)
    with pytest.raises(error, match=text):
        shore.engine.publish(stream_id, value, 0)
    assert said(shore, 0) == b""


def test_sixty_four_items_and_255_bytes_go_and_no_more() -> None:
    shore, vehicle = node(SHORE), Peer()
    value = {"numbers": [1] * 60, "floats": []}
    shore.engine.publish(MANY, value, 0)
    (heard,) = vehicle.hear(said(shore, 0))
    assert len(heard.items) + 2 == 64
    with pytest.raises(PayloadTooLargeError, match=r"Many: 65 items .* allowed: 64"):
        shore.engine.publish(MANY, {"numbers": [1] * 61, "floats": []}, 0)
    longest = {"numbers": [1] * 4, "floats": [0.1] * 49}
    shore.engine.publish(MANY, longest, 0)
    data = said(shore, 0)
    assert data[2] == 255
    assert vehicle.hear(data)[0].items[:6] == [4, 1, 1, 1, 1, 49]
    with pytest.raises(PayloadTooLargeError, match=r"Many: 256 bytes .* allowed: 255"):
        shore.engine.publish(MANY, longest | {"numbers": [24, 1, 1, 1]}, 0)


def test_a_delete_and_another_encoding_are_refused() -> None:
    shore = node(SHORE)
    with pytest.raises(PayloadInvalidError, match="delete"):
        shore.engine.publish(COMMAND, None, 0, delete=True)
    with pytest.raises(PayloadInvalidError, match="text/plain; allowed: application/cbor"):
        shore.engine.publish(COMMAND, TWIST, 0, encoding="text/plain")


def test_orders_do_not_cross() -> None:
    shore = node(SHORE)
    order = RemoteCommand(kind=CommandKind.SILENCE, for_s=60.0)
    with pytest.raises(LocalError, match="no commands cross a link with wire: rmw_desert"):
        shore.engine.commands.send(VEHICLE, order, 0)


def test_no_range_is_measured() -> None:
    shore = node(SHORE, framed=True, addressed=True, acknowledges=True, measures_range=True)
    with pytest.raises(RangeUnavailableError):
        shore.engine.ranging.request(VEHICLE, 0, timeout_s=5)
    assert said(shore, 0) == b""


def test_an_engine_and_a_peer_understand_each_other(count: Callable[[int], int]) -> None:
    dice = random.Random(2)
    shore, vehicle = node(SHORE), Peer()
    for _ in range(count(10_000)):
        value = {
            part: {axis: dice.choice((0.0, 1.5, dice.uniform(-9, 9))) for axis in "xyz"}
            for part in ("linear", "angular")
        }
        shore.engine.publish(COMMAND, value, 0)
        (heard,) = vehicle.hear(said(shore, 0))
        numbers = [number for part in value.values() for number in part.values()]
        assert heard.items == pytest.approx(numbers, rel=1e-6, abs=2**-14)
        assert packet(SAMPLE, COMMAND, *numbers) == packet(SAMPLE, COMMAND, *heard.items)


def test_the_table_has_no_stream_of_orders() -> None:
    assert table().get(175) is None
    assert len(table()) == len(SPECS)
    assert peer.SAMPLE == 0


def test_what_the_wire_does_not_have_is_not_there() -> None:
    end = node(VEHICLE)
    engine = end.engine
    assert list(end.journal) == ["epoch"], "nothing else of this wire outlives the node"
    now = 100 * NS_PER_S
    goal = GoalKey(VEHICLE, 1, POSE, 0)
    with pytest.raises(UnknownStreamError, match=f"stream {POSE} is no action"):
        engine.actions.cancel_goal(goal, now)
    assert not engine.cancel_delivery(1, now)
    assert not engine.refuse_object(SHORE, 0, now)
    assert not engine.is_delivering(1)
    assert engine.delivering(POSE) == 0
    engine.subscriptions.want(POSE, now)
    assert engine.is_idle
    engine.handle_timeout(now)
    engine.forget(SHORE, now)
    assert engine.poll_timeout() is None
