"""The shore's engine: what a ground station sees, and what becomes of its commands."""

from typing import Any

from tests.mavlink.messages import (
    ARMED_GUIDED,
    GROUND,
    SECOND,
    STATION,
    VEHICLE,
    Done,
    command_int,
    command_long,
    of_ground,
    report,
    run_until,
)
from zacoustic.errors import (
    CallTimeoutError,
    DeliveryError,
    OutcomeUnknownError,
    PayloadInvalidError,
    QueueFullError,
    ServiceError,
)
from zacoustic.mavlink.commands import Answer
from zacoustic.mavlink.dialect import Message
from zacoustic.mavlink.outputs import Send
from zacoustic.mavlink.shore import answer_of_error
from zacoustic.mavlink.station import StationSide
from zacoustic.mavlink.telemetry import value_of

ACCEPTED = Answer("accepted")
ARM = command_long(400, 1)


def sample(**changed: int) -> dict[str, Any]:
    return value_of(report(**changed), ARMED_GUIDED, VEHICLE)


def new_side(**arguments: Any) -> StationSide:
    return StationSide(
        "auv1",
        **{"run": 3, "ground_every_s": 20, "lost_after_s": 90, "now": 0, **arguments},
    )


def heard_side() -> StationSide:
    """An engine at instant 0 that has just heard the vehicle."""
    side = new_side()
    side.handle_telemetry(sample(), 0.0, 0)
    Done(side)
    return side


def test_a_ground_station_sees_nothing_before_the_vehicle_is_heard() -> None:
    side = new_side()
    side.handle_message(of_ground(STATION), 0)
    run_until(side, 0, 4 * SECOND)
    assert Done(side).sent == []


def test_that_the_vehicle_was_never_heard_is_said_once_and_not_in_its_name() -> None:
    side = new_side()
    run_until(side, 0, 600 * SECOND)
    done = Done(side)
    assert (done.events, done.sent) == (["vehicle_lost"], [])
    side.handle_telemetry(sample(), 0.0, 600 * SECOND)
    assert Done(side).events == ["vehicle"]


def test_each_sample_is_one_report_and_heartbeats_go_on_between_them() -> None:
    side = new_side()
    side.handle_telemetry(sample(), 2.0, 0)
    run_until(side, 0, 10 * SECOND)
    done = Done(side)
    assert done.named("HIGH_LATENCY2") == [report().fields]
    assert done.named("HEARTBEAT") == [ARMED_GUIDED.fields] * 11
    assert {(each.system, each.component) for each in done.outputs if isinstance(each, Send)} == {
        (VEHICLE, 1)
    }


def test_a_lost_vehicle_is_silent_and_said_to_be_lost_once() -> None:
    side = new_side()
    side.handle_telemetry(sample(), 30.0, 0)
    run_until(side, 0, 600 * SECOND)
    done = Done(side)
    assert len(done.named("HEARTBEAT")) == 60, "its age counts"
    assert [each["text"] for each in done.named("STATUSTEXT")] == [b"auv1: no report for 90 s"]
    assert done.events == ["vehicle", "vehicle_lost"]
    assert side.poll_timeout() is None
    side.handle_telemetry(sample(), 0.0, 600 * SECOND)
    done = Done(side)
    assert (done.events, len(done.named("HEARTBEAT"))) == (["vehicle"], 1)


def test_a_sample_that_is_too_old_is_not_shown() -> None:
    side = new_side()
    side.handle_telemetry(sample(), 90.0, 0)
    side.handle_telemetry(sample(), float("inf"), 0)
    done = Done(side)
    assert (done.sent, done.events) == ([], ["old", "old"])


def test_the_vehicle_is_told_of_a_ground_station_while_its_heartbeats_come() -> None:
    side = new_side()
    now = 0
    for _ in range(45):
        side.handle_message(of_ground(STATION), now)
        now = run_until(side, now, now + SECOND)
    run_until(side, now, 200 * SECOND)
    done = Done(side)
    assert [each.topic for each in done.published] == ["ground"] * 3
    assert done.events == ["ground_station", "ground_station_lost", "vehicle_lost"]
    assert side.poll_timeout() is None


def test_a_ground_station_that_sends_no_heartbeats_can_count_as_present() -> None:
    side = new_side(is_present=True)
    run_until(side, 0, 59 * SECOND)
    assert len(Done(side).published) == 3


def test_a_command_is_one_call_however_often_it_is_repeated() -> None:
    side = heard_side()
    for confirmation in (0, 1, 2):
        side.handle_message(
            of_ground(command_long(400, 1, confirmation=confirmation)), confirmation * SECOND
        )
    done = Done(side)
    (call,) = done.calls
    assert (call.service, call.value["arm"], call.value["order"]) == ("arm", True, (3 << 16) + 1)
    assert done.acks == [(400, 5)] * 3
    side.handle_answer(call.number, ACCEPTED, 3 * SECOND)
    side.handle_message(of_ground(command_long(400, 1, confirmation=3)), 4 * SECOND)
    done = Done(side)
    assert (done.calls, done.acks) == ([], [(400, 0), (400, 0)])
    assert done.named("COMMAND_ACK")[0]["target_system"] == GROUND[0]


def test_the_same_command_given_anew_is_a_new_call() -> None:
    side = heard_side()
    side.handle_message(of_ground(ARM), 0)
    side.handle_answer(Done(side).calls[0].number, ACCEPTED, SECOND)
    side.handle_message(of_ground(ARM), 2 * SECOND)
    assert len(Done(side).calls) == 1


def test_a_command_that_cannot_say_that_it_is_repeated_shares_the_answer_for_five_seconds() -> None:
    side = heard_side()
    goto = command_int(192, -1, 1, 0, 0.0, 10, 20, 5)
    side.handle_message(of_ground(goto), 0)
    side.handle_answer(Done(side).calls[0].number, ACCEPTED, SECOND)
    side.handle_message(of_ground(goto), 4 * SECOND)
    done = Done(side)
    assert (done.calls, done.acks) == ([], [(192, 0), (192, 0)])
    side.handle_message(of_ground(goto), 6 * SECOND)
    assert len(Done(side).calls) == 1


def test_after_another_command_of_the_service_nothing_is_a_repetition() -> None:
    side = heard_side()
    for confirmation, arm in ((0, 1), (0, 0), (1, 1)):
        message = command_long(400, arm, confirmation=confirmation)
        side.handle_message(of_ground(message), 0)
        (call,) = Done(side).calls
        side.handle_answer(call.number, ACCEPTED, 0)


def test_commands_are_numbered_in_the_order_in_which_they_were_given() -> None:
    side = heard_side()
    for message in (ARM, command_long(400, 0), command_long(21)):
        side.handle_message(of_ground(message), 0)
    orders = [each.value["order"] & 0xFFFF for each in Done(side).calls]
    assert orders == [1, 2, 3]


def test_progress_is_reported_each_second_until_the_answer_and_never_of_a_lost_vehicle() -> None:
    side = heard_side()
    side.handle_message(of_ground(ARM), 0)
    (call,) = Done(side).calls
    run_until(side, 0, 100 * SECOND)
    done = Done(side)
    assert done.acks == [(400, 5)] * 89
    side.handle_answer(call.number, Answer("no_answer", "it may have been done"), 100 * SECOND)
    done = Done(side)
    assert done.acks == [(400, 4)]
    assert done.named("STATUSTEXT")[0]["text"] == b"arm: it may have been done"
    assert side.poll_timeout() is None


def test_a_refusal_on_shore_is_answered_at_once_and_calls_nothing() -> None:
    side = heard_side()
    side.handle_message(of_ground(command_long(185, 1)), 0)
    done = Done(side)
    assert (done.calls, done.acks, done.events) == ([], [(185, 3)], ["refused"])


def test_commands_for_another_vehicle_are_left_to_it() -> None:
    side = heard_side()
    other = {**ARM.fields, "target_system": 9}
    side.handle_message(of_ground(Message("COMMAND_LONG", other)), 0)
    assert Done(side).outputs == []


def test_a_long_text_goes_in_parts() -> None:
    for length, parts in ((45, 1), (46, 2), (95, 3)):
        side = heard_side()
        side.handle_message(of_ground(ARM), 0)
        side.handle_answer(Done(side).calls[0].number, Answer("failed", "x" * length), 0)
        texts = Done(side).named("STATUSTEXT")
        assert b"".join(each["text"] for each in texts) == b"arm: " + b"x" * length
        assert len(texts) == parts
        assert [each.get("chunk_seq", 0) for each in texts] == [*range(parts)]


def test_a_call_that_fails_says_whether_the_command_may_have_been_executed() -> None:
    for error, code in (
        (CallTimeoutError("a: b"), 4),
        (OutcomeUnknownError("a: b"), 4),
        (ServiceError("a: b"), 4),
        (DeliveryError("a: nobody serves it"), 1),
        (QueueFullError("a: b"), 1),
        (PayloadInvalidError("a: b"), 2),
    ):
        assert answer_of_error(error).code == code
