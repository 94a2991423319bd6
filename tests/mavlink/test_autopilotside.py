"""The vehicle's engine: what it says to the autopilot, when, and what it answers."""

import pytest

from tests.mavlink.messages import (
    ARMED_GUIDED,
    SECOND,
    STATION,
    VEHICLE,
    Done,
    ack,
    of_vehicle,
    report,
    run_until,
)
from zacoustic.mavlink.autopilot import AutopilotSide, answer_value
from zacoustic.mavlink.commands import Answer
from zacoustic.mavlink.dialect import Message, Received
from zacoustic.mavlink.execution import NO_ANSWER

ARM = {"arm": True, "force": False, "given": None}
SHORE = 1


def heard_side(**arguments: float) -> AutopilotSide:
    """An engine at instant 0 whose autopilot has just been heard."""
    side = AutopilotSide(**{"interval_s": 10, "lost_after_s": 90, "now": 0, **arguments})  # type: ignore[arg-type]
    side.handle_message(of_vehicle(ARMED_GUIDED), 0)
    Done(side)
    return side


def keep_heard(side: AutopilotSide, now: int, end: int) -> int:
    """Let time pass with a heartbeat of the autopilot each second."""
    while now < end:
        now = run_until(side, now, min(end, now + SECOND))
        side.handle_message(of_vehicle(ARMED_GUIDED), now)
    return now


def test_it_asks_the_autopilot_for_reports_and_again_when_none_come() -> None:
    side = AutopilotSide(interval_s=10, lost_after_s=90, now=0)
    side.handle_message(of_vehicle(ARMED_GUIDED), 0)
    (asked,) = Done(side).named("COMMAND_LONG")
    assert (asked["command"], asked["param1"], asked["param2"]) == (511, 235, 10e6)
    assert asked["target_system"] == VEHICLE
    keep_heard(side, 0, 31 * SECOND)
    done = Done(side)
    assert len(done.named("COMMAND_LONG")) == 1
    assert done.events == ["no_telemetry"]
    keep_heard(side, 31 * SECOND, 65 * SECOND)
    assert Done(side).events == []


def test_reports_are_published_at_most_as_often_as_asked_for() -> None:
    side = heard_side()
    for second in range(0, 41, 5):
        keep_heard(side, max(0, second - 5) * SECOND, second * SECOND)
        side.handle_message(of_vehicle(report(timestamp=second * 1000)), second * SECOND)
    times = [each.value["timestamp"] for each in Done(side).published]
    assert times == [0, 10_000, 20_000, 30_000, 40_000]


def test_a_silent_autopilot_is_said_to_be_lost_and_nothing_of_it_is_published() -> None:
    side = heard_side()
    run_until(side, 0, 6 * SECOND)
    assert Done(side).events == ["autopilot_lost"]
    assert side.poll_timeout() is None
    side.handle_message(of_vehicle(report()), 7 * SECOND)
    side.handle_request(1, "arm", ARM, SHORE, 8 * SECOND)
    done = Done(side)
    assert done.published == []
    assert done.replies == [(1, "no_autopilot", "no heartbeat of the autopilot")]
    side.handle_message(of_vehicle(ARMED_GUIDED), 9 * SECOND)
    assert "autopilot" in Done(side).events


def test_that_no_autopilot_is_there_is_said_once() -> None:
    side = AutopilotSide(interval_s=10, lost_after_s=90, now=0)
    run_until(side, 0, 600 * SECOND)
    assert Done(side).events == ["autopilot_lost"]


def test_ground_stations_and_cameras_on_the_cable_are_no_autopilots() -> None:
    side = AutopilotSide(interval_s=10, lost_after_s=90, now=0)
    side.handle_message(of_vehicle(STATION, system=255), 0)
    side.handle_message(of_vehicle(ARMED_GUIDED, component=100), 0)
    assert Done(side).outputs == []
    side = heard_side()
    side.handle_message(of_vehicle(ARMED_GUIDED, system=9), 0)
    side.handle_message(of_vehicle(report(), system=9), 0)
    assert Done(side).published == []


def test_heartbeats_last_as_long_as_shore_is_heard_and_end_with_a_word() -> None:
    side = heard_side(lost_after_s=30)
    keep_heard(side, 0, 5 * SECOND)
    assert Done(side).named("HEARTBEAT") == [], "an autopilot counts from the first one"
    side.handle_ground(5 * SECOND)
    keep_heard(side, 5 * SECOND, 20 * SECOND)
    side.handle_ground(20 * SECOND)
    keep_heard(side, 20 * SECOND, 60 * SECOND)
    done = Done(side)
    assert len(done.named("HEARTBEAT")) == 45, "from 5 s to 50 s, one a second"
    assert done.events == ["ground_station", "no_telemetry", "ground_station_lost"]
    side.handle_ground(60 * SECOND)
    side.handle_timeout(60 * SECOND)
    done = Done(side)
    assert (done.events, len(done.named("HEARTBEAT"))) == (["ground_station"], 1)


def test_a_command_from_shore_is_a_sign_of_life_and_one_of_the_vehicle_is_not() -> None:
    side = heard_side()
    side.handle_request(1, "arm", ARM, None, SECOND)
    assert Done(side).events == ["command"]
    side.handle_request(2, "arm", ARM, 4, SECOND)
    assert Done(side).events == ["command"], "another vehicle"
    side.handle_request(3, "arm", ARM, SHORE, SECOND, is_shore=True)
    assert "ground_station" in Done(side).events


def test_a_command_is_repeated_until_the_autopilot_answers() -> None:
    side = heard_side()
    side.handle_request(1, "arm", ARM, None, 0)
    keep_heard(side, 0, 2 * SECOND)
    sent = [each["confirmation"] for each in Done(side).named("COMMAND_LONG")]
    assert sent == [0, 1]
    side.handle_message(of_vehicle(ack(176, 0)), 2 * SECOND)
    assert Done(side).replies == [], "of another command"
    side.handle_message(of_vehicle(ack(400, 0)), 2 * SECOND)
    assert Done(side).replies == [(1, "accepted", "")]


def test_a_refusal_comes_with_what_the_autopilot_said() -> None:
    side = heard_side()
    side.handle_request(1, "arm", ARM, None, 0)
    text = {"severity": 2, "text": "PreArm: Compass not healthy", "id": 0, "chunk_seq": 0}
    side.handle_message(of_vehicle(Message("STATUSTEXT", {**text, "severity": 6})), 0)
    side.handle_message(of_vehicle(Message("STATUSTEXT", text)), 0)
    side.handle_message(of_vehicle(ack(400, 4)), 0)
    assert Done(side).replies == [(1, "failed", "PreArm: Compass not healthy")]


def test_an_autopilot_that_does_not_answer_may_have_done_it() -> None:
    side = heard_side()
    side.handle_request(1, "arm", ARM, None, 0)
    keep_heard(side, 0, 9 * SECOND)
    done = Done(side)
    assert len(done.named("COMMAND_LONG")) == 5
    assert done.replies == [(1, "no_answer", "the autopilot does not answer; it may have done it")]


def test_in_progress_gives_an_autopilot_more_time_and_no_repetition() -> None:
    side = heard_side()
    side.handle_request(1, "mode", {"base_mode": 1, "custom_mode": 4, "custom_submode": 0}, None, 0)
    for second in (0, 15):
        side.handle_message(of_vehicle(ack(176, 5)), second * SECOND)
        keep_heard(side, second * SECOND, (second + 15) * SECOND)
    done = Done(side)
    commands = [each["command"] for each in done.named("COMMAND_LONG")]
    assert commands.count(176) == 1
    assert done.replies == []
    side.handle_message(of_vehicle(ack(176, 0)), 30 * SECOND)
    assert Done(side).replies == [(1, "accepted", "")]


def test_commands_go_one_after_the_other() -> None:
    side = heard_side()
    side.handle_request(1, "arm", ARM, None, 0)
    side.handle_request(2, "arm", {**ARM, "arm": False}, None, 0)
    side.handle_request(3, "mode", {"base_mode": 1, "custom_mode": 4, "custom_submode": 0}, None, 0)
    sent = [(each["command"], each["param1"]) for each in Done(side).named("COMMAND_LONG")]
    assert sent == [(400, 1)]
    side.handle_message(of_vehicle(ack(400, 0)), SECOND)
    done = Done(side)
    assert done.replies == [(1, "accepted", "")]
    assert [each["param1"] for each in done.named("COMMAND_LONG")] == [0]
    side.handle_message(of_vehicle(ack(400, 5)), SECOND)
    assert [each["command"] for each in Done(side).named("COMMAND_LONG")] == [176], "it is there"


def result_of(
    side: AutopilotSide, given: int | None, now: int, *, client: int = SHORE, service: str = "arm"
) -> str:
    value = ARM if service == "arm" else {"action": "land"}
    side.handle_message(of_vehicle(ARMED_GUIDED), now)
    side.handle_request(1, service, {**value, "given": given}, client, now)
    side.handle_message(of_vehicle(ack(400 if service == "arm" else 21, 0)), now)
    (reply,) = Done(side).replies
    return reply[1]


def dated_side() -> AutopilotSide:
    """An engine whose clock is at 61 s at instant 0."""
    return heard_side(clock_ms=61_000)


def test_a_command_that_a_later_one_has_overtaken_is_not_executed() -> None:
    side = dated_side()
    assert result_of(side, 61_002, 3 * SECOND) == "accepted"
    assert result_of(side, 61_001, 3 * SECOND) == "superseded"
    assert result_of(side, 61_003, 3 * SECOND) == "accepted"
    assert result_of(side, 61_002, 3 * SECOND, client=4) == "superseded", "whoever gave it"
    assert result_of(side, None, 3 * SECOND) == "accepted", "of a program that says no time"


def test_a_second_bridge_locks_nobody_out() -> None:
    side = dated_side()
    given = [61_000 + 500 * count for count in range(8)]
    results = [result_of(side, each, SECOND * 4) for each in given]  # of two, in turn
    assert results == ["accepted"] * 8


def test_a_command_is_not_executed_once_its_station_has_given_up() -> None:
    side = dated_side()
    assert result_of(side, 61_000, 59 * SECOND) == "accepted"
    assert result_of(side, 61_000, 61 * SECOND) == "expired"
    assert result_of(side, 61_000, 3600 * SECOND) == "expired"
    assert result_of(side, 61_000, 3600 * SECOND, service="abort") == "accepted"


def test_a_late_command_is_no_sign_of_shore() -> None:
    side = dated_side()
    keep_heard(side, 0, 100 * SECOND)
    Done(side)
    value = {**ARM, "given": 61_000}
    side.handle_request(1, "arm", value, SHORE, 100 * SECOND, is_shore=True)
    assert "ground_station" not in Done(side).events


def test_a_command_that_waits_too_long_at_the_autopilot_is_not_sent() -> None:
    side = dated_side()
    now = keep_heard(side, 0, 55 * SECOND)
    for number in (1, 2):
        value = {"arm": number == 1, "force": False, "given": 61_000 + number}
        side.handle_request(number, "arm", value, SHORE, now)
    keep_heard(side, now, 80 * SECOND)
    done = Done(side)
    assert [each["param1"] for each in done.named("COMMAND_LONG") if each["command"] == 400] == (
        [1.0] * 4
    )
    assert [each[:2] for each in done.replies] == [(1, "no_answer"), (2, "expired")]


@pytest.mark.parametrize("clock_ms", [61_000, 2**32 - 1])
def test_reports_carry_the_time_by_which_commands_are_judged(clock_ms: int) -> None:
    side = heard_side(clock_ms=clock_ms)
    side.handle_message(of_vehicle(report()), 2 * SECOND)
    assert [each.value["clock"] for each in Done(side).published] == [(clock_ms + 2000) % 2**32]
    assert result_of(side, clock_ms, 4 * SECOND) == "accepted"
    assert result_of(side, (clock_ms + 5000) % 2**32, 4 * SECOND) == "accepted", "clocks differ"


def test_nothing_from_before_a_restart_of_the_bridge_is_executed() -> None:
    for clock_ms in (500_000, 2**31 + 61_000):
        side = heard_side(clock_ms=clock_ms)
        assert result_of(side, 61_000, 3 * SECOND) == "expired"


def test_an_abort_is_never_too_old_and_what_came_before_it_is() -> None:
    side = dated_side()
    assert result_of(side, 61_002, 3 * SECOND) == "accepted"
    assert result_of(side, 61_001, 3 * SECOND, service="abort") == "accepted"
    assert result_of(side, None, 3 * SECOND, service="abort") == "accepted", "of the gateway itself"
    assert result_of(side, 63_000, 4 * SECOND) == "superseded"
    assert result_of(side, 64_001, 4 * SECOND) == "accepted"


def test_an_abort_goes_at_once_and_nothing_from_before_it_goes_after_it() -> None:
    side = heard_side()
    side.handle_request(1, "arm", ARM, None, 0)
    side.handle_request(2, "arm", {**ARM, "arm": False}, None, 0)
    side.handle_request(3, "abort", {"action": "land"}, None, 0)
    done = Done(side)
    sent = [(each["command"], each["param1"]) for each in done.named("COMMAND_LONG")]
    assert sent == [(400, 1), (21, 0)]
    assert [each[:2] for each in done.replies] == [(2, "superseded")]
    keep_heard(side, 0, 2 * SECOND)
    side.handle_message(of_vehicle(ack(21, 0)), 2 * SECOND)
    keep_heard(side, 2 * SECOND, 20 * SECOND)
    done = Done(side)
    assert {each["command"] for each in done.named("COMMAND_LONG")} <= {21, 511}
    assert [each[:2] for each in done.replies] == [(1, "no_answer"), (3, "accepted")]


def test_a_late_second_acknowledgement_does_not_end_the_next_command() -> None:
    side = heard_side()
    side.handle_request(1, "arm", ARM, None, 0)
    keep_heard(side, 0, 2 * SECOND)
    side.handle_message(of_vehicle(ack(400, 0)), 2 * SECOND)
    side.handle_request(2, "arm", {**ARM, "arm": False}, None, 2 * SECOND)
    Done(side)
    side.handle_message(of_vehicle(ack(400, 0)), 3 * SECOND)
    assert Done(side).replies == []
    side.handle_message(of_vehicle(ack(400, 2)), 3 * SECOND)
    assert Done(side).replies == [(2, "denied", "")]


def test_a_copy_of_an_acknowledgement_is_none() -> None:
    side = heard_side()
    copied = Received(message=ack(400, 0), system=VEHICLE, component=1, sequence=17)
    side.handle_request(1, "arm", ARM, None, 0)
    side.handle_message(copied, 0)
    side.handle_request(2, "arm", {**ARM, "arm": False}, None, 0)
    side.handle_message(copied, SECOND)
    assert [each[0] for each in Done(side).replies] == [1]


def test_a_lost_acknowledgement_costs_the_next_command_a_repetition() -> None:
    side = heard_side()
    side.handle_request(1, "arm", ARM, None, 0)
    keep_heard(side, 0, 9 * SECOND)  # five sendings, no acknowledgement
    side.handle_request(2, "arm", {**ARM, "arm": False}, None, 9 * SECOND)
    Done(side)
    now = 9 * SECOND
    for sent in range(1, 7):
        side.handle_message(of_vehicle(ack(400, 0)), now)
        assert len(Done(side).replies) == (sent == 6)
        now = keep_heard(side, now, now + 2 * SECOND)


def test_a_refusal_of_a_repetition_says_nothing_about_the_first() -> None:
    side = heard_side()
    side.handle_request(1, "arm", ARM, None, 0)
    keep_heard(side, 0, 2 * SECOND)
    side.handle_message(of_vehicle(ack(400, 2)), 2 * SECOND)
    assert Done(side).replies == []
    keep_heard(side, 2 * SECOND, 5 * SECOND)
    assert Done(side).replies == [(1, "no_answer", "denied once; another try may have been done")]


def test_what_is_in_progress_too_long_makes_the_next_answer_doubtful() -> None:
    side = heard_side()
    side.handle_request(1, "arm", ARM, None, 0)
    keep_heard(side, 0, 9 * SECOND)
    side.handle_request(2, "arm", {**ARM, "arm": False}, None, 9 * SECOND)
    side.handle_message(of_vehicle(ack(400, 5)), 9 * SECOND)  # of the first
    Done(side)
    for _ in range(6):
        side.handle_message(of_vehicle(ack(400, 0)), 10 * SECOND)
    assert Done(side).replies == [(2, "no_answer", NO_ANSWER)]


def test_only_what_the_autopilot_says_just_before_it_refuses_is_the_reason() -> None:
    text = {"severity": 4, "text": "Battery 1 low", "id": 0, "chunk_seq": 0}
    side = heard_side()
    side.handle_message(of_vehicle(Message("STATUSTEXT", text)), 0)
    side.handle_request(1, "arm", ARM, None, SECOND // 2)
    side.handle_message(of_vehicle(Message("STATUSTEXT", text)), SECOND)
    side.handle_message(of_vehicle(ack(400, 4)), 2 * SECOND + 1)
    assert Done(side).replies == [(1, "failed", "")]
    side.handle_request(2, "arm", ARM, None, 3 * SECOND)
    side.handle_message(of_vehicle(Message("STATUSTEXT", text)), 3 * SECOND)
    keep_heard(side, 3 * SECOND, 12 * SECOND)
    assert Done(side).replies == [(2, "no_answer", NO_ANSWER)], "never in place of this"


def test_acknowledgements_for_another_ground_station_are_not_ours() -> None:
    side = heard_side()
    side.handle_request(1, "arm", ARM, None, 0)
    theirs = {"command": 400, "result": 0, "target_system": 254}
    side.handle_message(of_vehicle(Message("COMMAND_ACK", theirs)), 0)
    of_a_program = {**theirs, "target_system": 255, "target_component": 230}
    side.handle_message(of_vehicle(Message("COMMAND_ACK", of_a_program)), 0)
    assert Done(side).replies == []


def test_an_autopilot_without_high_latency2_has_it_composed() -> None:
    side = heard_side()
    side.handle_message(of_vehicle(ack(511, 3)), 0)
    done = Done(side)
    assert done.events == ["composed"]
    assert {each["param1"] for each in done.named("COMMAND_LONG")} == {33, 74, 1, 42, 62}
    keep_heard(side, 0, 9 * SECOND)
    position = {
        "time_boot_ms": 9000, "lat": -378_123_450, "lon": 1_449_631_230, "alt": -21_400,
        "relative_alt": -21_400, "vx": 0, "vy": 0, "vz": 0, "hdg": 9_100,
    }  # fmt: skip
    hud = {
        "airspeed": 0, "groundspeed": 1.21, "heading": 90, "throttle": 44, "alt": -21.4,
        "climb": -0.24,
    }  # fmt: skip
    status = {
        "onboard_control_sensors_enabled": 0x2F, "onboard_control_sensors_health": 0x0F,
        "battery_remaining": 71,
    }  # fmt: skip
    side.handle_message(of_vehicle(Message("GLOBAL_POSITION_INT", position)), 9 * SECOND)
    keep_heard(side, 9 * SECOND, 10 * SECOND)
    assert Done(side).published == [], "no speeds yet"
    keep_heard(side, 10 * SECOND, 19 * SECOND)
    for name, fields in (("GLOBAL_POSITION_INT", position), ("VFR_HUD", hud)):
        side.handle_message(of_vehicle(Message(name, fields)), 19 * SECOND)
    side.handle_message(of_vehicle(Message("SYS_STATUS", status)), 19 * SECOND)
    keep_heard(side, 19 * SECOND, 40 * SECOND)
    (one,) = Done(side).published
    wanted = {
        "timestamp": 9000, "latitude": -37.812345, "altitude": -21, "target_altitude": -21,
        "heading": 92, "throttle": 44, "groundspeed": 1.2, "climb_rate": -0.2, "battery": 71,
        "failure_flags": 1, "wp_num": 65535, "custom_mode": 4, "base_mode": 217, "eph": 25.5,
    }  # fmt: skip
    assert {name: one.value[name] for name in wanted} == wanted


def test_an_answer_fits_its_stream() -> None:
    value = answer_value(Answer("failed", "é" * 40))
    assert (value["success"], value["text"]) == (False, "é" * 25)
    assert answer_value(Answer("accepted")) == {
        "success": True, "result": "accepted", "text": None,
    }  # fmt: skip
