"""What an answer means follows from the command that was sent."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.links.evologics.strategies import COMMANDS
from zacoustic_evologics import (
    AtDecoder,
    Framing,
    Interpreter,
    ReplyCollector,
    command_name,
    decode_reply,
    encode_message,
    reply_text,
)
from zacoustic_evologics.at.commands import Act, Action, Command, Help, Query, Set
from zacoustic_evologics.at.messages import Reply
from zacoustic_evologics.at.replies import (
    Accepted,
    CommandReply,
    DeliveryReply,
    DeliveryState,
    LinkStatus,
    Measurement,
    ModeReply,
    MultipathReply,
    NetStatus,
    Number,
    Path,
    PositionReply,
    RefusalKind,
    Refused,
    SettingsReply,
    ShownSetting,
    TextReply,
)

SHOW = Act(Action.SHOW_SETTINGS)
ANSWERS: list[tuple[Command, str, CommandReply]] = [
    (Query("MODE"), "NET", ModeReply(Interpreter.NET)),
    (Query("MODE"), "AT", ModeReply(Interpreter.AT)),
    (Query("AL"), "3", Number(3)),
    (Query("PC"), "[*]765", Number(765, starred=True)),
    (Query("T"), "825", Number(825)),
    (Query("CLOCK"), "4294967295", Number(4294967295)),
    (Query("V"), "-0.0351", Measurement(-0.0351)),
    (Query("BV"), "13.4000", Measurement(13.4)),
    (Query("E"), "-61.0000", Measurement(-61.0)),
    (Query("DI"), "DELIVERING", DeliveryReply(DeliveryState.DELIVERING)),
    (Query("DI"), "FAILED", DeliveryReply(DeliveryState.FAILED)),
    (Query("DI"), "EMPTY", DeliveryReply(DeliveryState.EMPTY)),
    (Query("S"), "INITIATION LISTEN 16384", LinkStatus("INITIATION LISTEN", (16384,))),
    (Query("S"), "INITIATION LISTEN", LinkStatus("INITIATION LISTEN")),
    (Act(Action.LISTEN), "INITIATION LISTEN", LinkStatus("INITIATION LISTEN")),
    (Act(Action.MEASURE_NOISE), "INITIATION NOISE", LinkStatus("INITIATION NOISE")),
    (Act(Action.INFORMATION, 0), "1.9", TextReply("1.9")),
    (Set("L", 3), "OK", Accepted()),
    (Set("L", 3), "[*]OK", Accepted(starred=True)),
    (Set("L", 4), "ERROR OUT OF RANGE", Refused(RefusalKind.ERROR, "OUT OF RANGE")),
    (Query("AL"), "BUSY", Refused(RefusalKind.BUSY)),
    (Query("S"), "BUSY BACKOFF STATE", Refused(RefusalKind.BUSY, "BACKOFF STATE")),
    (
        Query("UP"),
        "10446,3,-0.4233,-1.0020,-0.5901",
        PositionReply(measured_s=10446, address=3, x_m=-0.4233, y_m=-1.0020, z_m=-0.5901),
    ),
    (
        Query("P"),
        "10    10   \n100   240  \n",
        MultipathReply((Path(10, 10), Path(100, 240))),
    ),
    (
        SHOW,
        "Source Level: 3\r\n[*]Local Address: 2\r\nIM Rerty Count: 1\r\n",
        SettingsReply(
            (
                ShownSetting("Source Level", 3),
                ShownSetting("Local Address", 2, starred=True),
                ShownSetting("IM Rerty Count", 1),
            )
        ),
    ),
    (
        Query("S"),
        "Local Address: 1\nRemote Address: 3\nAcoustic Link Status: INITIATION LISTEN\n"
        "Pool Status: 0 packets 16384 bytes\nPromiscuous Mode: ON\n",
        NetStatus(
            local_address=1,
            remote_address=3,
            state="INITIATION LISTEN",
            pool="0 packets 16384 bytes",
            promiscuous=True,
        ),
    ),
]


@pytest.mark.parametrize(("command", "text", "meaning"), ANSWERS)
def test_answer_is_read_by_its_command_and_written_as_it_was(
    command: Command, text: str, meaning: CommandReply
) -> None:
    assert decode_reply(command, text) == meaning
    assert reply_text(meaning) == text


@pytest.mark.parametrize(("command", "text", "meaning"), ANSWERS)
@pytest.mark.parametrize("framing", Framing)
def test_answer_comes_through_both_framings_as_one_text(
    command: Command, text: str, meaning: CommandReply, framing: Framing
) -> None:
    interpreter = Interpreter.NET if "\n" in text else Interpreter.AT
    collector = ReplyCollector(command, interpreter)
    name = None if framing is Framing.LINES else command_name(command)
    received = AtDecoder(framing).feed(encode_message(Reply(text, name), framing))
    texts = [collector.add(each) for each in received if isinstance(each, Reply)]
    # Where lines are read, their ends are all the same.
    whole = text.replace("\r\n", "\n") if framing is Framing.LINES else text
    assert [each for each in texts if each is not None] == [whole]
    assert texts[-1] == whole


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (Query("MODE"), "ATT"),
        (Query("AL"), "three"),
        (Query("DI"), "PERHAPS"),
        (Query("DI"), ""),
        (Query("S"), "a: 1\nb: 2\n"),
        (Query("S"), "Local: x\nRemote: 1\nS: L\nP: 1\nM: ON\n"),
        (Query("P"), "10 ten\n"),
        (Query("P"), ""),
        (Query("UP"), "1,2,3"),
        (Query("UP"), "1,999,0.1,0.2,0.3"),
        (Query("BV"), "full"),
        (SHOW, "no colon\n"),
        (Query("CLOCK"), "9" * 30),
    ],
)
def test_answer_that_is_not_understood_is_kept_as_text(command: Command, text: str) -> None:
    assert decode_reply(command, text) == TextReply(text)


def test_settings_of_firmware_1_7_have_other_line_ends() -> None:
    received = AtDecoder().feed(b"Source Level: 3\r\nGain: 0\r\n\r\n")
    collector = ReplyCollector(SHOW, Interpreter.AT)
    texts = [collector.add(each) for each in received if isinstance(each, Reply)]
    assert texts == [None, None, "Source Level: 3\nGain: 0\n"]


def test_delivery_states_are_known_by_their_beginning() -> None:
    expected = DeliveryReply(DeliveryState.DELIVERED)
    assert decode_reply(Query("DI"), "DELIVEREDIM,3") == expected
    assert decode_reply(Query("DI"), "DELIVERING,3") == DeliveryReply(DeliveryState.DELIVERING)


def test_refusal_ends_an_answer_of_several_lines() -> None:
    assert ReplyCollector(SHOW, Interpreter.AT).add(Reply("ERROR NO CONTROL")) == "ERROR NO CONTROL"


def test_stray_empty_line_answers_nothing() -> None:
    for command in (Query("AL"), SHOW, Query("S")):
        assert ReplyCollector(command, Interpreter.NET).add(Reply("")) is None


def test_status_has_several_lines_from_one_interpreter_only() -> None:
    line = Reply("INITIATION LISTEN 16384")
    assert ReplyCollector(Query("S"), Interpreter.AT).add(line) == line.text
    assert ReplyCollector(Query("S"), Interpreter.NET).add(line) is None
    assert ReplyCollector(Help("?S"), Interpreter.NET).add(line) is None


@given(COMMANDS, st.text(st.characters(codec="latin-1"), max_size=80))
def test_no_answer_raises(command: Any, text: str) -> None:
    decode_reply(command, text)


def test_the_settings_are_as_long_as_they_were_captured() -> None:
    """347 bytes in firmware 1.7: each line has both of its ends, and an empty one follows."""
    values = {
        "Source Level": 3, "Source Level Control": 0, "Gain": 0, "Carrier Waveform ID": 1,
        "Local Address": 2, "Highest Address": 14, "Cluster Size": 10, "Packet Time": 750,
        "Retry Count": 3, "Retry Timeout": 1500, "Wake Up Active Time": 12, "Wake Up Period": 12,
        "Promiscuous Mode": 1, "Sound Speed": 1500, "IM Rerty Count": 1, "Pool Size": 16384,
        "Hold Timeout": 0, "Idle Timeout": 120,
    }  # fmt: skip
    reply = SettingsReply(tuple(ShownSetting(label, value) for label, value in values.items()))
    assert len(reply_text(reply) + "\r\n") == 347
    # Those who end their lines otherwise are read as well.
    assert decode_reply(SHOW, reply_text(reply).replace("\r\n", "\n")) == reply
