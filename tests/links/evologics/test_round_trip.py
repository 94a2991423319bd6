"""What is written is what is read: every record, both framings, every limit of every field."""

from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.links.evologics.cutting import at_random, decoded, one_by_one
from tests.links.evologics.strategies import (
    ALL_LAYOUTS,
    COMMANDS,
    LINE_COMMANDS,
    NOTIFICATIONS,
    PACKET_REPLIES,
    PAYLOAD_COMMANDS,
    PLAIN_REPLIES,
    REPLY_NAMES,
    beyond,
    limits,
    payloads,
    records,
)
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
from zacoustic_evologics.at.layouts import Layout
from zacoustic_evologics.at.messages import RawData, Reply

LINE_ENDS = st.sampled_from([TCP_LINE_END, SERIAL_LINE_END, b"\r\n"])
FRAMINGS = st.sampled_from(Framing)
QUIET_DATA = payloads(200, 1).filter(lambda content: b"+++AT" not in content)
MODE_SWITCHES = (Action.COMMAND_MODE, Action.DATA_MODE)


def layout_id(layout: Layout) -> str:
    return f"{layout.token}-{len(layout.columns)}"


def an_example(layout: Layout) -> Any:
    """Give a record with the first limit in every field."""
    made = {
        name: (limits(field)[0],) * several[0] if several else limits(field)[0]
        for name, field, *several in layout.columns
    }
    return layout.record(**made, **({} if layout.payload_limit is None else {"payload": b"a,b"}))


@pytest.mark.parametrize("layout", ALL_LAYOUTS, ids=layout_id)
@given(content=st.data(), framing=FRAMINGS)
def test_record_is_read_as_it_was_written(
    layout: Layout, content: st.DataObject, framing: Framing
) -> None:
    record = content.draw(records(layout))
    assert AtDecoder(framing).feed(encode_message(record, framing)) == [record]


@pytest.mark.parametrize("framing", Framing)
@pytest.mark.parametrize("layout", ALL_LAYOUTS, ids=layout_id)
def test_record_is_read_as_it_was_written_at_every_limit(layout: Layout, framing: Framing) -> None:
    example = an_example(layout)
    for name, field, *several in layout.columns:
        for value in limits(field):
            change = {name: (value,) * several[0] if several else value}
            record = msgspec.structs.replace(example, **change)
            assert AtDecoder(framing).feed(encode_message(record, framing)) == [record]


@pytest.mark.parametrize("layout", ALL_LAYOUTS, ids=layout_id)
def test_record_beyond_a_limit_cannot_be_written(layout: Layout) -> None:
    example = an_example(layout)
    for name, field, *several in layout.columns:
        for value in beyond(field):
            change = {name: (value,) * several[0] if several else value}
            record = msgspec.structs.replace(example, **change)
            with pytest.raises(ValueError, match=r"\S"):
                encode_message(record)


@pytest.mark.parametrize("layout", [each for each in ALL_LAYOUTS if each.payload_limit is not None])
def test_longest_payload_can_be_written_and_no_longer_one(layout: Layout) -> None:
    assert layout.payload_limit is not None
    longest = msgspec.structs.replace(an_example(layout), payload=b"\n" * layout.payload_limit)
    for framing in Framing:
        assert AtDecoder(framing).feed(encode_message(longest, framing)) == [longest]
        longer = msgspec.structs.replace(longest, payload=longest.payload + b"\n")
        with pytest.raises(ValueError, match=str(layout.payload_limit)):
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
