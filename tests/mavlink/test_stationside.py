"""The shore's engine: what a ground station sees, and what becomes of its commands."""

from typing import Any

import pytest

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
from zacoustic.mavlink.dialect import Message, PacketCodec
from zacoustic.mavlink.outputs import Send
from zacoustic.mavlink.shore import answer_of_error
from zacoustic.mavlink.station import StationSide
from zacoustic.mavlink.telemetry import value_of

ACCEPTED = Answer("accepted")
ARM = command_long(400, 1)
LAND, GUIDED = command_long(21), command_long(176, 1, 4)
GOTO = command_int(192, -1, 1, 0, 0.0, 10, 20, 5)
SET_GUIDED = Message("SET_MODE", {"target_system": VEHICLE, "base_mode": 1, "custom_mode": 4})


def item(command: int, current: int = 2) -> Message:
    """A guided MISSION_ITEM_INT."""
    fields: dict[str, Any] = {"target_system": VEHICLE, "target_component": 1, "frame": 6}
    fields |= {"command": command, "current": current, "x": 10, "y": 20, "z": 5.0}
    return Message("MISSION_ITEM_INT", {**fields, **{f"param{at}": 0.0 for at in range(1, 5)}})


def sample(**changed: int) -> dict[str, Any]:
    return value_of(report(**changed), ARMED_GUIDED, VEHICLE) | {"clock": 61_000}


def new_side(**arguments: Any) -> StationSide:
    return StationSide(
        "auv1",
        **{"ground_every_s": 20, "lost_after_s": 90, "now": 0, **arguments},
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
    assert (call.service, call.value["arm"]) == ("arm", True)
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


def test_a_command_that_cannot_say_that_it_is_repeated_is_new_after_the_answer() -> None:
    for message in (GOTO, SET_GUIDED, item(16)):
        side = heard_side()
        side.handle_message(of_ground(message), 0)
        side.handle_message(of_ground(message), SECOND)
        (call,) = Done(side).calls
        side.handle_answer(call.number, ACCEPTED, 2 * SECOND)
        side.handle_message(of_ground(message), 2 * SECOND + 1)
        assert len(Done(side).calls) == 1


def test_after_another_command_of_the_service_nothing_is_a_repetition() -> None:
    side = heard_side()
    for confirmation, arm in ((0, 1), (0, 0), (1, 1)):
        message = command_long(400, arm, confirmation=confirmation)
        side.handle_message(of_ground(message), 0)
        (call,) = Done(side).calls
        side.handle_answer(call.number, ACCEPTED, 0)


@pytest.mark.parametrize("is_answered", [True, False])
@pytest.mark.parametrize(
    ("same", "other"),
    [(LAND, GUIDED), (LAND, SET_GUIDED), (GOTO, LAND), (SET_GUIDED, LAND), (item(16), GOTO)],
)
def test_after_any_other_command_the_same_one_is_new(
    same: Message, other: Message, is_answered: bool
) -> None:
    side = heard_side()
    for message in (same, other, same):
        side.handle_message(of_ground(message), 0)
        (call,) = Done(side).calls
        if is_answered:
            side.handle_answer(call.number, ACCEPTED, 0)


def test_an_answer_that_comes_after_a_later_command_is_not_remembered() -> None:
    side = heard_side()
    calls = []
    for message in (GOTO, SET_GUIDED):
        side.handle_message(of_ground(message), 0)
        calls += Done(side).calls
    for call in reversed(calls):
        side.handle_answer(call.number, ACCEPTED, 0)
    side.handle_message(of_ground(GOTO), 0)
    assert len(Done(side).calls) == 1


@pytest.mark.parametrize("confirmation", [0, 1])
def test_an_abort_is_never_answered_from_memory(confirmation: int) -> None:
    side = heard_side()
    side.handle_message(of_ground(LAND), 0)
    side.handle_answer(Done(side).calls[0].number, ACCEPTED, 0)
    side.handle_message(of_ground(command_long(21, confirmation=confirmation)), 1)
    assert len(Done(side).calls) == 1


def test_a_command_under_way_is_shared_if_the_station_says_that_it_repeats_it() -> None:
    side = heard_side()
    for message in (GUIDED, LAND, command_long(176, 1, 4, confirmation=1)):
        side.handle_message(of_ground(message), 0)
    assert [each.service for each in Done(side).calls] == ["mode", "abort"]


def test_a_command_gets_no_acknowledgement_that_would_be_taken_for_that_of_a_later_one() -> None:
    for first, second, third in (
        (ARM, command_long(400, 0), GUIDED),
        (item(16), item(20), SET_GUIDED),
    ):
        side = heard_side()
        for message in (first, second, third):
            side.handle_message(of_ground(message), 0)
        calls = Done(side).calls
        side.handle_answer(calls[0].number, ACCEPTED, 0)
        done = Done(side)
        assert [each.name for each in done.sent] == ["STATUSTEXT"]
        assert done.sent[0].fields["text"] == f"an earlier {calls[0].service}: accepted".encode()
        run_until(side, 0, SECOND)
        side.handle_answer(calls[1].number, ACCEPTED, SECOND)
        assert Done(side).sent[-1].name in ("COMMAND_ACK", "MISSION_ACK")


@pytest.mark.parametrize("was_heard", [True, False])
def test_while_the_vehicle_is_not_heard_only_an_abort_is_passed_on(was_heard: bool) -> None:
    side = heard_side() if was_heard else new_side()
    now = run_until(side, 0, 100 * SECOND)
    Done(side)
    for message, ends in (
        (ARM, [("COMMAND_ACK", 1)]),
        (SET_GUIDED, [("COMMAND_ACK", 1)]),
        (GOTO, [("COMMAND_ACK", 1)]),
        (item(16), [("MISSION_ACK", 1)]),
    ):
        side.handle_message(of_ground(message), now)
        done = Done(side)
        found = [each for each in done.sent if each.name != "STATUSTEXT"]
        assert [(each.name, each.fields.get("result", 1)) for each in found] == ends
        assert (done.calls, done.events) == ([], ["refused"])
    side.handle_message(of_ground(LAND), now)
    assert [each.service for each in Done(side).calls] == ["abort"]
    side.handle_telemetry(sample(), 0.0, now)
    side.handle_message(of_ground(ARM), now)
    assert [each.service for each in Done(side).calls] == ["arm"]


@pytest.mark.parametrize("message", [LAND, GOTO, item(16)])
def test_a_command_that_is_given_again_after_a_while_is_new(message: Message) -> None:
    side = heard_side()
    for at in (0, 3 * SECOND, 6 * SECOND):  # a station that repeats
        side.handle_message(of_ground(message), at)
    assert len(Done(side).calls) == 1
    side.handle_message(of_ground(message), 10 * SECOND)
    assert len(Done(side).calls) == 1


def test_the_time_of_the_vehicle_is_that_of_the_report_with_the_least_delay() -> None:
    side = heard_side()
    side.handle_telemetry(sample() | {"clock": 69_000}, 0.0, 10 * SECOND)  # two seconds late
    side.handle_message(of_ground(ARM), 10 * SECOND)
    side.handle_telemetry(sample() | {"clock": 4_000_000_000}, 0.0, 20 * SECOND)  # restarted
    side.handle_message(of_ground(LAND), 21 * SECOND)
    side.handle_telemetry(sample() | {"clock": 4_000_008_000}, 2.0, 30 * SECOND)
    side.handle_message(of_ground(ARM), 31 * SECOND)
    given = [each.value["given"] for each in Done(side).calls]
    assert given == [71_000, 4_000_001_000, 4_000_011_000]


def test_a_refused_mission_item_is_refused_as_one() -> None:
    side = heard_side()
    side.handle_message(of_ground(item(22)), 0)
    assert [each.name for each in Done(side).sent] == ["STATUSTEXT", "MISSION_ACK"]


def test_a_command_carries_the_time_of_the_vehicle_and_each_a_later_one() -> None:
    side = heard_side()  # at 61 s of the vehicle
    for at, message in ((0, ARM), (0, command_long(400, 0)), (5 * SECOND, command_long(21))):
        side.handle_message(of_ground(message), at)
    assert [each.value["given"] for each in Done(side).calls] == [61_000, 61_001, 66_000]


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


def texts(done: Done) -> list[str]:
    sent = [each.fields["text"] for each in done.sent if each.name == "STATUSTEXT"]
    return [text.decode() for text in sent]


def test_a_refusal_on_shore_says_why_to_the_station_too() -> None:
    side = heard_side()
    side.handle_message(of_ground(command_long(400, 3)), SECOND)
    done = Done(side)
    assert texts(done) == ["command 400: denied, param1 3; allowed: 0, 1"]
    assert [each.name for each in done.sent] == ["STATUSTEXT", "COMMAND_ACK"]


def test_what_is_polled_is_answered_each_time_and_told_once_in_a_minute() -> None:
    side, sent, events = heard_side(), [], []
    for second in range(1, 121):
        side.handle_message(of_ground(command_long(512, 148)), second * SECOND)
        done = Done(side)
        sent += [each.name for each in done.sent]
        events += done.events
    assert sent.count("COMMAND_ACK") == 120
    assert sent.count("STATUSTEXT") == 2
    assert events.count("refused") == 2


TARGET = {"target_system": VEHICLE, "target_component": 1}
FTP = [1, 0, 7, 4, 4, 0, 0, 0, 9, 0, 0, 0, *b"abcd"]


@pytest.mark.parametrize(
    ("message", "answer"),
    [
        (Message("MISSION_COUNT", {**TARGET, "count": 9, "mission_type": 0}), "MISSION_ACK"),
        (Message("MISSION_REQUEST_LIST", {**TARGET, "mission_type": 1}), "MISSION_ACK"),
        (Message("MISSION_CLEAR_ALL", {**TARGET, "mission_type": 0}), "MISSION_ACK"),
        (item(16, current=0), "MISSION_ACK"),
        (Message("PARAM_REQUEST_LIST", TARGET), None),
        (Message("PARAM_REQUEST_READ", {**TARGET, "param_id": "X", "param_index": -1}), None),
        (Message("FILE_TRANSFER_PROTOCOL", {**TARGET, "payload": FTP}), "FILE_TRANSFER_PROTOCOL"),
        (Message("LOG_REQUEST_LIST", {**TARGET, "start": 0, "end": 9}), None),
        (Message("MANUAL_CONTROL", {"target": VEHICLE, "x": 1, "y": 0, "z": 0}), None),
    ],
)
def test_what_does_not_cross_is_answered_on_shore_at_no_byte(
    message: Message, answer: str | None
) -> None:
    side = heard_side()
    for second in (1, 2, 3):
        side.handle_message(of_ground(message), second * SECOND)
    done = Done(side)
    assert (done.calls, done.published) == ([], [])
    assert [f"{message.name}: unsupported (" in text for text in texts(done)] == [True]
    answers = [each for each in done.sent if each.name != "STATUSTEXT"]
    assert [each.name for each in answers] == ([answer] * 3 if answer else [])
    if answer == "MISSION_ACK":
        assert answers[0].fields["type"] == 3
        assert answers[0].fields["mission_type"] == message.fields.get("mission_type", 0)
    if answer == "FILE_TRANSFER_PROTOCOL":
        payload = answers[0].fields["payload"]
        assert payload[:13] == [2, 0, 7, 129, 1, 4, 0, 0, 9, 0, 0, 0, 7]
        assert len(payload) == 251
    for each in answers:
        PacketCodec().pack(each, system=VEHICLE, component=1)


def test_what_is_of_another_system_or_component_is_left_alone() -> None:
    side = heard_side()
    for target in ({**TARGET, "target_system": VEHICLE + 1}, {**TARGET, "target_component": 100}):
        side.handle_message(of_ground(Message("PARAM_REQUEST_LIST", target)), SECOND)
    assert Done(side).sent == []


def test_a_report_is_shown_as_instruments_where_that_is_wanted() -> None:
    side = new_side(has_instruments=True)
    side.handle_telemetry(sample(), 0.0, 0)
    sent = {each.name: each.fields for each in Done(side).sent}
    position, hud = sent["GLOBAL_POSITION_INT"], sent["VFR_HUD"]
    assert (position["lat"], position["lon"]) == (-378_123_450, 1_449_631_230)
    assert (position["alt"], position["hdg"], position["vz"]) == (-21_000, 9000, 20)
    assert (hud["heading"], hud["throttle"]) == (90, 33)
    assert sent["SYS_STATUS"]["battery_remaining"] == 87
    assert sent["SYS_STATUS"]["voltage_battery"] == 65535
    for name in ("GLOBAL_POSITION_INT", "VFR_HUD", "SYS_STATUS"):
        PacketCodec().pack(Message(name, sent[name]), system=VEHICLE, component=1)
    side.handle_telemetry(sample(latitude=2**31 - 1, battery=-1), 0.0, SECOND)
    sent = {each.name: each.fields for each in Done(side).sent}
    assert "GLOBAL_POSITION_INT" not in sent
    assert sent["SYS_STATUS"]["battery_remaining"] == -1
