"""What is written is what is read: every record, both framings, every limit of every field."""

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.links.evologics.cutting import at_random, decoded, one_by_one
from tests.links.evologics.strategies import (
    ALL_ROWS,
    COMMANDS,
    LINE_COMMANDS,
    NOTIFICATIONS,
    PACKET_REPLIES,
    PAYLOAD_COMMANDS,
    PLAIN_REPLIES,
    REPLY_NAMES,
    names,
    payloads,
    rows,
)
from tests.links.fieldvalues import an_example, beyond, limits, records
from zacoustic.link.forms import Form
from zacoustic_evologics import (
    SERIAL_LINE_END,
    TCP_LINE_END,
    AtDecoder,
    CommandDecoder,
    Framing,
    Interpreter,
    encode_command,
    encode_message,
)
from zacoustic_evologics.at.commands import Act, Action, Escape
from zacoustic_evologics.at.messages import RawData, Reply
from zacoustic_evologics.at.table import ANSWERS, Row
from zacoustic_evologics.at.table import COMMANDS as ROW_OF_COMMAND

COMMAND_ROWS = tuple(ROW_OF_COMMAND.values())
LINE_ENDS = st.sampled_from([TCP_LINE_END, SERIAL_LINE_END, b"\r\n"])
FRAMINGS = st.sampled_from(Framing)
QUIET_DATA = payloads(200, 1).filter(lambda content: b"+++AT" not in content)
MODE_SWITCHES = (Action.COMMAND_MODE, Action.DATA_MODE)


EVERY_ROW = pytest.mark.parametrize("row", ALL_ROWS, ids=names(ALL_ROWS))
EVERY_COMMAND = pytest.mark.parametrize("row", COMMAND_ROWS, ids=names(COMMAND_ROWS))
EVERY_ANSWER = pytest.mark.parametrize("form", ANSWERS.values(), ids=lambda form: form.record)


def example(row: Row) -> Any:
    return an_example(row, **({} if row.payload is None else {"payload": b"a,b"}))


@EVERY_ROW
@given(content=st.data(), framing=FRAMINGS)
def test_record_is_read_as_it_was_written(
    row: Row, content: st.DataObject, framing: Framing
) -> None:
    record = content.draw(rows(row))
    assert AtDecoder(framing).feed(encode_message(record, framing)) == [record]


@EVERY_COMMAND
@given(content=st.data(), framing=FRAMINGS, line_end=LINE_ENDS)
def test_command_of_each_row_is_read_as_it_was_written(
    row: Row, content: st.DataObject, framing: Framing, line_end: bytes
) -> None:
    command = content.draw(rows(row))
    decoder = CommandDecoder(Interpreter.AT, framing)
    assert decoder.feed(encode_command(command, framing, line_end)) == [command]


@EVERY_ANSWER
@given(content=st.data())
def test_answer_of_each_form_is_read_as_it_was_written(
    form: Form[Any], content: st.DataObject
) -> None:
    reply = content.draw(records(form))
    assert form.read(form.write(reply)) == reply


@pytest.mark.parametrize("framing", Framing)
@EVERY_ROW
def test_record_is_read_as_it_was_written_at_every_limit(row: Row, framing: Framing) -> None:
    for name, field in row.fields.items():
        for value in [] if name == "payload" else limits(field):
            record = msgspec.structs.replace(example(row), **{name: value})
            assert AtDecoder(framing).feed(encode_message(record, framing)) == [record]


@EVERY_ROW
def test_record_beyond_a_limit_cannot_be_written(row: Row) -> None:
    for name, field in row.fields.items():
        for value in [] if name == "payload" else beyond(field):
            record = msgspec.structs.replace(example(row), **{name: value})
            with pytest.raises(ValueError, match=r"\S"):
                encode_message(record)


@EVERY_COMMAND
def test_command_beyond_a_limit_cannot_be_written(row: Row) -> None:
    for name, field in row.fields.items():
        for value in [] if name == "payload" else beyond(field):
            command = msgspec.structs.replace(example(row), **{name: value})
            with pytest.raises((ValueError, TypeError), match=r"\S"):
                encode_command(command)


@pytest.mark.parametrize("row", [each for each in ALL_ROWS if each.payload is not None])
def test_longest_payload_can_be_written_and_no_longer_one(row: Row) -> None:
    assert row.payload is not None
    longest = msgspec.structs.replace(example(row), payload=b"\n" * row.payload.longest)
    for framing in Framing:
        assert AtDecoder(framing).feed(encode_message(longest, framing)) == [longest]
        longer = msgspec.structs.replace(longest, payload=longest.payload + b"\n")
        with pytest.raises(ValueError, match=str(row.payload.longest)):
            encode_message(longer, framing)


@given(st.lists(NOTIFICATIONS | PLAIN_REPLIES.map(Reply), max_size=12), st.integers())
def test_lines_are_read_as_they_were_written_however_they_are_cut(
    messages: list[Any], seed: int
) -> None:
    stream = b"".join(encode_message(message) for message in messages)
    assert AtDecoder().feed(stream) == messages
    assert decoded(AtDecoder(), one_by_one(stream)) == messages
    assert decoded(AtDecoder(), at_random(stream, seed)) == messages


@given(
    st.lists(
        NOTIFICATIONS
        | st.builds(Reply, PACKET_REPLIES, REPLY_NAMES.filter(bool))
        | QUIET_DATA.map(RawData),
        max_size=12,
    ),
    st.integers(),
)
def test_packets_between_raw_data_are_read_however_they_are_cut(
    messages: list[Any], seed: int
) -> None:
    stream = b"".join(encode_message(message, Framing.PACKETS) for message in messages)
    stream += b"+++AT:0:\r\n"  # what may be the start of a packet is kept until something follows
    joined = decoded(_Given(messages), [b""])
    for pieces in ([stream], one_by_one(stream), at_random(stream, seed)):
        assert decoded(AtDecoder(Framing.PACKETS), pieces) == [*joined, Reply("", "")]


class _Given:
    """A decoder that only joins."""

    def __init__(self, messages: list[Any]) -> None:
        self.messages = messages

    def feed(self, received: bytes) -> list[Any]:
        return self.messages


@given(COMMANDS, LINE_ENDS, FRAMINGS)
def test_command_is_read_as_it_was_written(command: Any, line_end: bytes, framing: Framing) -> None:
    decoder = CommandDecoder(Interpreter.AT, framing)
    assert decoder.feed(encode_command(command, framing, line_end)) == [command]


@given(st.lists(COMMANDS, max_size=12), LINE_ENDS, st.integers())
def test_commands_are_read_however_they_are_cut(
    commands: list[Any], line_end: bytes, seed: int
) -> None:
    stream = b"".join(encode_command(command, line_end=line_end) for command in commands)
    assert CommandDecoder().feed(stream) == commands
    assert decoded(CommandDecoder(), one_by_one(stream)) == commands
    assert decoded(CommandDecoder(), at_random(stream, seed)) == commands


@given(
    st.lists(
        PAYLOAD_COMMANDS
        | LINE_COMMANDS.filter(lambda each: each not in [Act(mode) for mode in MODE_SWITCHES])
        | QUIET_DATA.filter(lambda content: content[:1] != b"\n").map(RawData),
        max_size=12,
    ),
    LINE_ENDS,
    st.integers(),
)
def test_commands_between_raw_data_are_read_however_they_are_cut(
    messages: list[Any], line_end: bytes, seed: int
) -> None:
    stream = b"".join(
        each.content
        if isinstance(each, RawData)
        else encode_command(each, Framing.PACKETS, line_end)
        for each in [*messages, Act(Action.ATTENTION)]
    )
    joined = decoded(_Given([*messages, Act(Action.ATTENTION)]), [b""])
    for pieces in ([stream], one_by_one(stream), at_random(stream, seed)):
        assert decoded(CommandDecoder(Interpreter.AT, Framing.PACKETS), pieces) == joined


def test_escape_is_three_bytes_without_line_end() -> None:
    assert encode_command(Escape(), Framing.PACKETS) == b"+++"
    with pytest.raises(ValueError, match="data mode"):
        encode_command(Escape(), Framing.LINES)
