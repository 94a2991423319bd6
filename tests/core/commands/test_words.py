"""What an order says: what is allowed, and both ways over the wire."""

import pytest

from zacoustic.core.base.qos import Priority
from zacoustic.core.streams.commands import (
    COMMANDS_STREAM_ID,
    REQUEST_TYPE,
    RESPONSE_TYPE,
    CommandKind,
    CommandState,
    RemoteCommand,
    command_types,
)
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.payload import CborCodec

REQUESTS = CborCodec(command_types().by_name(REQUEST_TYPE))
RESPONSES = CborCodec(command_types().by_name(RESPONSE_TYPE))


@pytest.mark.parametrize(
    "command",
    [
        RemoteCommand(),
        RemoteCommand(stream_id=175),
        RemoteCommand(kind=CommandKind.SILENCE),
        RemoteCommand(kind=CommandKind.SILENCE, for_s=0.1),
        RemoteCommand(kind=CommandKind.SILENCE, for_s=366 * 86400.0),
        RemoteCommand(kind=CommandKind.RESUME),
        RemoteCommand(kind=CommandKind.RESET, stream_id=1),
        RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=1, on=False),
        RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=9, min_interval_s=86400.0),
        *(
            RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=9, on=True, priority=each)
            for each in Priority
        ),
    ],
)
def test_command_crosses_as_it_is(command: RemoteCommand) -> None:
    payload = REQUESTS.encode(command.to_wire(65535))
    assert RemoteCommand.from_wire(REQUESTS.decode(payload)) == (65535, command)
    assert len(payload) <= 14


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"for_s": 5.0}, "for_s is 5; allowed: with silence only"),
        ({"kind": CommandKind.SILENCE, "for_s": 0.0}, "for_s is 0; allowed: 0.1..31622400"),
        ({"kind": CommandKind.SILENCE, "for_s": float("nan")}, "for_s is nan; allowed: 0.1"),
        ({"kind": CommandKind.SILENCE, "for_s": 4e7}, "for_s is 4e.07; allowed: 0.1..31622400"),
        (
            {"kind": CommandKind.SILENCE, "stream_id": 1},
            "stream_id is 1; allowed: not with silence",
        ),
        ({"kind": CommandKind.RESUME, "stream_id": 1}, "stream_id is 1; allowed: not with resume"),
        (
            {"kind": CommandKind.OVERRIDE, "on": True},
            "stream_id is missing; allowed: a topic to tune",
        ),
        ({"kind": CommandKind.RESET}, "stream_id is missing; allowed: a topic to reset"),
        ({"stream_id": 176}, "stream_id is 176; allowed: 1..175"),
        ({"kind": CommandKind.OVERRIDE, "stream_id": 1}, "allowed: at least one"),
        ({"stream_id": 1, "on": True}, "allowed: with tune only"),
        (
            {"kind": CommandKind.OVERRIDE, "stream_id": 1, "min_interval_s": -1.0},
            "min_interval_s is -1; allowed: 0..86400",
        ),
    ],
)
def test_command_that_makes_no_sense_is_refused(fields: dict[str, object], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        RemoteCommand(**fields)  # type: ignore[arg-type]


def test_state_crosses_and_ages() -> None:
    state = CommandState(
        silent=True,
        commanded=True,
        left_s=120.0,
        on=False,
        min_interval_s=10.0,
        priority=Priority.BACKGROUND,
    )
    found = RESPONSES.decode(RESPONSES.encode(state.to_wire()))
    assert CommandState.from_wire(found, 0.0) == state
    assert CommandState.from_wire(found, 20.0).left_s == 100.0
    over = CommandState.from_wire(found, 200.0)
    assert (over.silent, over.commanded, over.left_s) == (False, False, None)
    assert over.on is False


def test_what_is_beyond_the_wire_is_cut() -> None:
    state = CommandState(silent=True, commanded=False, left_s=1e12, on=True, min_interval_s=1e9)
    found = CommandState.from_wire(RESPONSES.decode(RESPONSES.encode(state.to_wire())), 0.0)
    assert found.left_s == 366 * 86400.0
    assert found.min_interval_s == 86400.0


def test_commands_are_in_every_table_and_in_no_digest() -> None:
    table = StreamTable([TopicSpec(stream_id=1, name="a")])
    assert table.by_id(COMMANDS_STREAM_ID).is_built_in
    assert [stream.stream_id for stream in table] == [1]
    assert len(table) == 1
    assert table.find("orders", 1) is None
    before = table.digest
    own = table.declare(TopicSpec(stream_id=COMMANDS_STREAM_ID, name="orders"))
    assert table.by_id(COMMANDS_STREAM_ID) is own
    assert table.digest != before
