"""Commands of a ground station as requests, and requests as commands for an autopilot."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.mavlink.messages import PX4, VEHICLE, command_int, command_long, of_ground
from zacoustic.mavlink.commands import (
    Answer,
    GroundCommand,
    Refusal,
    answer_of_code,
    command_for_autopilot,
    read_command,
)
from zacoustic.mavlink.dialect import Message, PacketCodec, Received
from zacoustic.mavlink.entries import RESULTS

ARDUPILOT = 3
NAN = math.nan


def command(message: Message) -> GroundCommand:
    found = read_command(of_ground(message))
    assert isinstance(found, GroundCommand)
    return found


def refusal(message: Message) -> str:
    found = read_command(of_ground(message))
    assert isinstance(found, Refusal)
    return found.answer.result


def for_autopilot(found: GroundCommand, autopilot: int = ARDUPILOT) -> Message:
    return command_for_autopilot(
        found.service, found.value, system=VEHICLE, autopilot=autopilot, confirmation=0
    )


@pytest.mark.parametrize(
    "sent",
    [
        command_long(400, 1),
        command_long(400, 0, 21196),
        command_long(176, 1, 19),
        command_long(176, 209, 4, 3),
        command_long(20),
        command_long(21),
    ],
)
def test_a_command_reaches_the_autopilot_as_it_was(sent: Message) -> None:
    assert for_autopilot(command(sent)) == sent


def test_a_waypoint_reaches_the_autopilot_as_it_was() -> None:
    sent = command_int(192, 1.5, 1, 30, math.radians(90), -378_123_456, 1_449_631_234, -12.5)
    got = for_autopilot(command(sent)).fields
    assert {**got, "param4": sent.fields["param4"]} == {**sent.fields, "frame": 3}
    assert got["param4"] == pytest.approx(sent.fields["param4"])


def test_what_a_waypoint_leaves_open_stays_open() -> None:
    found = command(command_int(192, -1, 0, NAN, NAN, 10, 20, 5, frame=0))
    assert set(found.value) == {"latitude", "longitude", "altitude", "frame", "change_mode"}
    fields = for_autopilot(found).fields
    assert (fields["param1"], fields["param2"], fields["param3"]) == (-1, 0, 0)
    assert math.isnan(fields["param4"])


def test_a_guided_mission_item_is_a_waypoint_and_a_mission_is_not() -> None:
    fields: dict[str, Any] = {
        "target_system": VEHICLE, "target_component": 1, "seq": 0, "frame": 6, "command": 16,
        "current": 2, "autocontinue": 1, "param1": 0, "param2": 0, "param3": 0, "param4": 0,
        "x": 10_000_000, "y": 20_000_000, "z": 5.0, "mission_type": 0,
    }  # fmt: skip
    found = command(Message("MISSION_ITEM_INT", fields))
    assert (found.service, found.value["latitude"]) == ("waypoint", 1.0)
    assert found.acknowledgement(Answer("accepted")).name == "MISSION_ACK"
    assert read_command(of_ground(Message("MISSION_ITEM_INT", {**fields, "current": 0}))) is None
    floats = {**fields, "x": 1.0, "y": 2.0}
    assert command(Message("MISSION_ITEM", floats)).value == found.value


def test_set_mode_is_the_command_of_the_same_purpose() -> None:
    fields = {"target_system": VEHICLE, "base_mode": 1, "custom_mode": 19}
    found = command(Message("SET_MODE", fields))
    assert for_autopilot(found) == command_long(176, 1, 19)
    assert found.acknowledgement(Answer("denied")).fields["command"] == 11


def test_px4_gets_main_and_sub_mode_whoever_asks() -> None:
    wanted = command_long(176, 209, 4, 3)
    fields = {"target_system": VEHICLE, "base_mode": 209, "custom_mode": 0x03040000}
    assert for_autopilot(command(Message("SET_MODE", fields)), PX4) == wanted
    assert for_autopilot(command(wanted), PX4) == wanted


def test_ardupilot_arms_by_force_with_its_own_number() -> None:
    assert for_autopilot(command(command_long(400, 1, 21196))).fields["param2"] == 2989
    assert for_autopilot(command(command_long(400, 1, 21196)), PX4).fields["param2"] == 21196


@pytest.mark.parametrize(
    ("sent", "result"),
    [
        (command_long(185, 1), "unsupported"),
        (command_long(511, 235, 1e6), "unsupported"),
        (command_long(400, 2), "denied"),
        (command_long(400, NAN), "denied"),
        (command_long(400, 1, 5), "denied"),
        (command_long(176, 1, -1), "denied"),
        (command_long(176, NAN), "denied"),
        (command_long(192, -1, 1, 0, NAN, NAN, NAN, 5), "denied"),
        (command_int(192, -1, 1, 0, NAN, 910_000_000, 0, 5), "denied"),
        (command_int(192, -1, 1, 0, NAN, 10, 10, 5, frame=1), "unsupported_mav_frame"),
    ],
)
def test_what_cannot_cross_is_refused_on_shore(sent: Message, result: str) -> None:
    assert refusal(sent) == result


def test_commands_for_other_components_are_not_answered() -> None:
    camera = {**command_long(400, 1).fields, "target_component": 100}
    assert read_command(of_ground(Message("COMMAND_LONG", camera))) is None


def test_only_the_autopilots_acceptance_is_one() -> None:
    accepted = {name for name in RESULTS if Answer(name).code == 0}
    in_missions = {name for name in RESULTS if Answer(name).mission_code == 0}
    assert accepted == in_missions == {"accepted"}
    codes = [code for code in range(256) if answer_of_code(code).result == "accepted"]
    assert codes == [0]


def test_without_an_answer_it_may_have_been_done_or_was_certainly_not() -> None:
    assert Answer("no_answer").code == 4
    assert Answer("no_autopilot").code == Answer("superseded").code == 1


_NUMBER = st.floats(width=32) | st.sampled_from([0.0, 1.0, 2989.0, 21196.0])


@given(
    form=st.sampled_from(["COMMAND_LONG", "COMMAND_INT", "MISSION_ITEM", "MISSION_ITEM_INT"]),
    number=st.sampled_from([16, 20, 21, 176, 192, 400]) | st.integers(0, 65535),
    parameters=st.lists(_NUMBER, min_size=7, max_size=7),
    place=st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(-(2**31), 2**31 - 1)),
    frame=st.integers(0, 255),
    current=st.integers(0, 3),
)
def test_no_message_of_a_ground_station_raises(
    form: str,
    number: int,
    parameters: list[float],
    place: tuple[int, int],
    frame: int,
    current: int,
) -> None:
    fields: dict[str, Any] = {f"param{at}": each for at, each in enumerate(parameters, start=1)}
    x, y = place if form.endswith("_INT") else parameters[4:6]
    fields |= {"x": x, "y": y, "z": parameters[6], "frame": frame, "current": current}
    fields |= {"command": number, "confirmation": 0, "target_system": 1, "target_component": 1}
    found = read_command(Received(message=Message(form, fields), system=255, component=0))
    if isinstance(found, GroundCommand):
        PacketCodec().pack(for_autopilot(found), system=255, component=190)
