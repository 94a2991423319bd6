"""Commands between engines that are driven by hand: who is executed, what follows, what is said."""

from itertools import pairwise
from typing import Any

import pytest

from tests.core.rig import Rig, link
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import (
    CallFailed,
    CallFailure,
    ResponseReceived,
    SampleReceived,
    SilenceChanged,
    StreamOverridden,
)
from zacoustic.core.linktypes import LinkCapabilities, LinkState
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.commands import (
    COMMANDS_STREAM_ID,
    CommandKind,
    CommandState,
    RemoteCommand,
)
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import LocalError, PayloadTooLargeError

S = NS_PER_S
NAV, COMMANDS, ARM, OTHER = 1, 2, 20, 3
SILENCE = RemoteCommand(kind=CommandKind.SILENCE, for_s=1800.0)
RESUME = RemoteCommand(kind=CommandKind.RESUME)


def table(name: str = "nav", **settings: Any) -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=NAV, name=name, qos=Qos(depth=3), publishers=(2,)),
            TopicSpec(
                stream_id=COMMANDS,
                name="log",
                subscribers=(1,),
                qos=Qos(reliability=Reliability.RELIABLE, depth=6),
            ),
            TopicSpec(stream_id=OTHER, name="other", publishers=(1,)),
            ServiceSpec(stream_id=ARM, name="arm", server=2),
        ],
        **({"nodes": {1: "shore", 2: "auv1"}} | settings),
    )


def pair(
    rules: TransmitRules | None = None,
    *,
    tables: dict[int, StreamTable] | None = None,
    capabilities: LinkCapabilities | None = None,
) -> Rig:
    """Two nodes that have confirmed each other."""
    rig = Rig(
        tables or {1: table(), 2: table()},
        rules=dict.fromkeys((1, 2), rules or TransmitRules()),
        capabilities=capabilities,
    )
    for _ in range(3):
        rig.publish(2, NAV, b"x")
        rig.run(30)
    return rig


def command(rig: Rig, wanted: RemoteCommand, *, run_s: float = 5.0, timeout_s: float = 60.0) -> int:
    call_id = rig[1].engine.commands.send(2, wanted, rig.now, timeout_s=timeout_s)
    rig.run(run_s)
    return call_id


def state(rig: Rig, call_id: int) -> CommandState:
    """Return what node 1 was answered."""
    (found,) = [each for each in rig[1].got(ResponseReceived) if each.call_id == call_id]
    return CommandState.from_wire(found.value, found.age_s or 0.0)


def refusal(rig: Rig, call_id: int) -> str:
    (found,) = [each for each in rig[1].got(CallFailed) if each.call_id == call_id]
    return f"{found.failure.name}: {found.text}"


def sent_by(rig: Rig, address: int) -> int:
    return sum(source == address for source, _ in rig.frames)


def test_silence_is_executed_at_once_and_answered_by_the_last_frame() -> None:
    rig = pair()
    rig.publish(2, NAV, b"waits")
    rig[2].engine.handle_link_state(LinkState.DOWN, rig.now)  # so that it still waits
    call_id = rig[1].engine.commands.send(2, SILENCE, rig.now)
    rig.exchange()
    rig[2].engine.handle_link_state(LinkState.UP, rig.now, rig.capabilities)
    before = sent_by(rig, 2)
    rig.run(1700)
    assert sent_by(rig, 2) == before + 1
    word = [transmission for source, transmission in rig.frames if source == 2][-1]
    assert b"waits" not in word.frame_bytes
    found = state(rig, call_id)
    assert (found.silent, found.commanded) == (True, True)
    assert found.left_s == pytest.approx(1800, abs=0.2)
    rig.run(200)
    assert any(each.value == b"waits" for each in rig[1].got(SampleReceived))


def test_answer_of_a_node_that_was_silent_already_waits() -> None:
    rig = pair()
    rig[2].engine.silence.begin(rig.now, duration_s=100)
    before = sent_by(rig, 2)
    call_id = command(
        rig, RemoteCommand(kind=CommandKind.SILENCE, for_s=60.0), run_s=55, timeout_s=600
    )
    assert sent_by(rig, 2) == before
    assert not rig[1].got(ResponseReceived)
    rig.run(30)
    assert not state(rig, call_id).silent  # it was replaced by the shorter one, which is over


def test_last_word_that_finds_no_frame_in_time_is_not_said() -> None:
    rig = pair()
    unit_s = 0.002
    rig[1].engine.commands.send(2, SILENCE, rig.now)
    rig[2].engine.publish(NAV, b"y", rig.now)
    under_way = rig[2].poll(rig.now)  # the modem takes for ever
    assert under_way is not None
    rig.exchange()
    assert rig[2].engine.silence.is_silent(rig.now)
    rig.run(17 * unit_s)
    rig[2].report(under_way)
    before = sent_by(rig, 2)
    rig.run(60)
    assert sent_by(rig, 2) == before


def test_resume_gets_through_and_is_answered_first_of_all() -> None:
    rig = pair()
    command(rig, SILENCE)
    rig.publish(2, NAV, b"waits")
    rig.run(60)
    rig.frames.clear()
    call_id = command(rig, RESUME)
    assert not state(rig, call_id).silent
    first = next(transmission for source, transmission in rig.frames if source == 2)
    assert COMMANDS_STREAM_ID in first.frame_bytes
    assert [each.is_silent for each in rig[2].got(SilenceChanged)] == [True, False]


@pytest.mark.parametrize("same_table", [True, False])
def test_resume_gets_through_to_a_node_that_was_restarted_in_its_silence(
    same_table: bool,
) -> None:
    tables = {1: table(), 2: table("nav" if same_table else "elsewhere")}
    rig = pair(tables=tables)
    call_id = command(rig, SILENCE)
    assert state(rig, call_id).silent
    rig.restart(2, tables[2], keeps=True)
    before = sent_by(rig, 2)
    rig.publish(2, NAV, b"z")
    rig.run(60)
    assert sent_by(rig, 2) == before
    assert not state(rig, command(rig, RESUME)).silent


def test_silence_begins_before_the_journal_has_it_and_is_answered_after() -> None:
    rig = pair()
    rig[2].commits = False
    call_id = command(rig, SILENCE)
    assert rig[2].engine.silence.is_silent(rig.now)
    assert not rig[1].got(ResponseReceived)
    rig[2].commits = True
    rig.run(1)
    assert state(rig, call_id).silent


def test_command_that_comes_again_after_a_restart_is_answered_and_not_executed_again() -> None:
    rig = pair()
    rig[1].engine.commands.send(2, SILENCE, rig.now)
    rig.exchange(lambda source, node, transmission: source == 1)  # the answer is lost
    rig[2].settle()
    rig.restart(2, table(), keeps=True)
    rig[2].engine.commands.execute(RESUME, rig.now, lambda found: None)
    rig.run(20)
    assert not rig[2].engine.silence.is_silent(rig.now)
    (found,) = rig[1].got(ResponseReceived)
    assert not CommandState.from_wire(found.value, 0).silent


def test_silence_ends_when_it_was_to_end_however_long_it_took() -> None:
    rig = pair()
    rig[1].engine.commands.send(2, RemoteCommand(kind=CommandKind.SILENCE, for_s=100.0), rig.now)
    commanded_at = rig.now
    rig.run(40, lambda source, node, transmission: False)
    rig.run(30)
    end = rig[2].engine.silence.until(rig.now)
    assert end is not None
    assert end - commanded_at == pytest.approx(100 * S, abs=2 * S)


def test_command_that_comes_when_its_time_is_over_is_refused() -> None:
    rig = pair()
    short = RemoteCommand(kind=CommandKind.SILENCE, for_s=10.0)
    call_id = rig[1].engine.commands.send(2, short, rig.now, timeout_s=600)
    rig.run(60, lambda source, node, transmission: False)
    rig.run(200)
    assert refusal(rig, call_id) == "HANDLER: it came when its time was over"
    assert not rig[2].engine.silence.is_silent(rig.now)


def test_commands_in_frames_without_introduction_are_dropped() -> None:
    rig = pair()
    bare = bytes((COMMANDS_STREAM_ID, 2, 0, 0)) + bytes.fromhex("0101190bb8f6f6f6f6")
    rig[2].hear(bare, rig.now, source=1, destination=2)
    assert not rig[2].engine.silence.is_silent(rig.now)
    assert rig[2].engine.stats.dropped["unconfirmed"] == 1


@pytest.mark.parametrize(
    ("allowed", "nodes", "is_executed"),
    [
        (None, {1: "shore", 2: "auv1"}, True),
        (None, {}, False),
        (frozenset(), {1: "shore", 2: "auv1"}, False),
        (frozenset({3}), {1: "shore", 2: "auv1"}, False),
        (frozenset({1}), {}, True),
    ],
)
def test_only_some_are_executed(
    allowed: frozenset[int] | None, nodes: dict[int, str], is_executed: bool
) -> None:
    tables = {each: table(nodes=nodes) for each in (1, 2)}
    tables = {
        each: StreamTable(
            [stream.spec for stream in made if stream.stream_id != COMMANDS],
            nodes=nodes,
        )
        for each, made in tables.items()
    }
    rig = pair(TransmitRules(commands_from=allowed), tables=tables)
    call_id = command(rig, RemoteCommand(kind=CommandKind.SILENCE))
    assert rig[2].engine.silence.is_silent(rig.now) is is_executed
    if not is_executed:
        assert refusal(rig, call_id) == "HANDLER: node 2 accepts no commands from node 1"


def test_question_is_answered_and_changes_nothing() -> None:
    rig = pair()
    found = state(rig, command(rig, RemoteCommand()))
    assert found == CommandState(silent=False, commanded=False)
    found = state(rig, command(rig, RemoteCommand(stream_id=NAV)))
    assert (found.on, found.min_interval_s, found.priority) == (True, 0.0, Priority.DATA)


def test_topic_is_switched_off_and_on() -> None:
    rig = pair()
    found = state(
        rig, command(rig, RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=NAV, on=False))
    )
    assert found.on is False
    (overridden,) = rig[2].got(StreamOverridden)
    assert (overridden.stream_id, overridden.on, overridden.commanded_by) == (NAV, False, 1)
    rig[1].events.clear()
    rig.publish(2, NAV, b"1")
    rig.publish(2, NAV, b"2")
    rig.run(100)
    assert not rig[1].got(SampleReceived)
    assert rig[2].engine.pending(NAV) == 2
    assert rig[2].engine.table.digest == table().digest
    command(rig, RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=NAV, on=True))
    assert [each.value for each in rig[1].got(SampleReceived)] == [b"1", b"2"]


def test_topic_that_is_off_arms_no_timer_for_ever() -> None:
    rig = pair()
    rig[2].engine.commands.execute(
        RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=NAV, on=False),
        rig.now,
        lambda found: None,
    )
    rig[2].settle()
    rig.publish(2, NAV, b"1")
    assert rig[2].engine.poll_timeout() is None


def test_reliable_topic_is_switched_off_and_still_acknowledges_others() -> None:
    rig = pair()
    command(rig, RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=COMMANDS, on=False))
    for number in range(3):
        rig.publish(2, COMMANDS, b"%d" % number)
        rig.publish(2, COMMANDS, bytes(200))  # an object
    rig.run(300)
    assert not [each for each in rig[1].got(SampleReceived) if each.stream_id == COMMANDS]
    assert rig[2].engine.delivering(COMMANDS) == 6
    command(rig, RemoteCommand(kind=CommandKind.RESET, stream_id=COMMANDS))
    rig.run(300)
    assert rig[2].engine.delivering(COMMANDS) == 0
    received = [each.value for each in rig[1].got(SampleReceived) if each.stream_id == COMMANDS]
    assert received == [b"0", bytes(200), b"1", bytes(200), b"2", bytes(200)]


def test_rate_holds_from_the_last_sample_on() -> None:
    rig = pair()
    rig.publish(2, NAV, b"1")
    rig.exchange()
    command(
        rig, RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=NAV, min_interval_s=20.0), run_s=1
    )
    rig[1].events.clear()
    times = []
    for _ in range(100):
        rig.publish(2, NAV, b"n")
        rig.run(1)
        times += [rig.now for _ in rig[1].got(SampleReceived)]
        rig[1].events.clear()
    assert len(times) == 5
    assert all(20 * S <= later - sooner <= 21 * S for sooner, later in pairwise(times))
    found = state(rig, command(rig, RemoteCommand(kind=CommandKind.RESET, stream_id=NAV)))
    assert found.min_interval_s == 0


def test_priority_is_that_which_was_commanded() -> None:
    rig = pair()
    command(
        rig, RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=NAV, priority=Priority.REAL_TIME)
    )
    rig.publish(2, COMMANDS, b"first")
    rig.publish(2, NAV, b"second")
    frame = rig[2].poll(rig.now)
    assert frame is not None
    assert frame.frame_bytes.startswith(bytes((NAV,)) + b"second")


def test_override_outlives_a_restart_with_a_journal() -> None:
    rig = pair()
    command(
        rig, RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=NAV, on=False, min_interval_s=5.0)
    )
    for keeps in (True, False):
        rig.restart(2, table(), keeps=keeps)
        override = rig[2].engine.commands.overrides.of(NAV)
        assert (override.on, override.min_interval_s) == ((False, 5.0) if keeps else (True, None))
        rig[1].events.clear()
        rig.publish(2, NAV, b"1")
        rig.run(60)
        assert bool(rig[1].got(SampleReceived)) is not keeps


def test_override_of_a_topic_that_is_gone_is_forgotten() -> None:
    rig = pair()
    command(rig, RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=NAV, on=False))
    assert f"tune/{NAV}" in rig[2].journal
    rig.restart(2, StreamTable([TopicSpec(stream_id=9, name="x")]), keeps=True)
    assert f"tune/{NAV}" not in rig[2].journal


def test_reset_leaves_nothing_in_the_journal() -> None:
    rig = pair()
    command(rig, RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=NAV, on=False))
    command(rig, RemoteCommand(kind=CommandKind.RESET, stream_id=NAV))
    assert f"tune/{NAV}" not in rig[2].journal


@pytest.mark.parametrize(
    ("stream_id", "reason"),
    [
        (99, "node 2 has no stream 99"),
        (ARM, "stream 20 is no topic"),
        (COMMANDS_STREAM_ID, "stream 175 is no topic"),
        (OTHER, "node 2 does not publish stream 3"),
    ],
)
def test_topic_that_cannot_be_overridden_is_refused_with_the_reason(
    stream_id: int, reason: str
) -> None:
    rig = pair()
    for wanted in (
        RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=stream_id, on=False),
        RemoteCommand(kind=CommandKind.RESET, stream_id=stream_id),
        RemoteCommand(stream_id=stream_id),
    ):
        assert refusal(rig, command(rig, wanted)) == f"HANDLER: {reason}"
        with pytest.raises(LocalError, match=reason):
            rig[2].engine.commands.execute(wanted, rig.now, lambda found: None)


def test_commands_that_cannot_be_sent_are_refused_here() -> None:
    rig = pair()
    commands = rig[1].engine.commands
    for node in (0, 255):
        with pytest.raises(LocalError, match=f"node {node}; allowed: 1..254"):
            commands.send(node, SILENCE, rig.now)
    for timeout_s in (601, float("nan")):
        with pytest.raises(LocalError, match="allowed: at most 600"):
            commands.send(2, SILENCE, rig.now, timeout_s=timeout_s)
    with pytest.raises(LocalError, match="orders is served by this node"):
        commands.send(1, SILENCE, rig.now)
    with pytest.raises(LocalError, match="served by"):
        rig[1].engine.call(COMMANDS_STREAM_ID, SILENCE.to_wire(1), rig.now)
    rig[1].engine.declare(TopicSpec(stream_id=COMMANDS_STREAM_ID, name="mine"), rig.now)
    with pytest.raises(LocalError, match="stream 175 is mine, so no commands cross the channel"):
        commands.send(2, SILENCE, rig.now)


def test_table_with_a_stream_of_that_id_takes_no_commands() -> None:
    own = table()
    own.declare(TopicSpec(stream_id=COMMANDS_STREAM_ID, name="mine"))
    rig = pair(tables={1: table(), 2: own})
    call_id = command(rig, SILENCE, run_s=100)
    (failed,) = [each for each in rig[1].got(CallFailed) if each.call_id == call_id]
    assert failed.failure is CallFailure.TABLE_MISMATCH
    assert not rig[2].engine.silence.is_silent(rig.now)


def test_small_frames_carry_commands_or_say_that_they_cannot() -> None:
    rig = pair(capabilities=link(mtu_bytes=24))
    assert state(
        rig, command(rig, RemoteCommand(kind=CommandKind.SILENCE, for_s=1800.0), run_s=10)
    ).silent
    rig.restart(2, table(), keeps=True)
    assert not state(rig, command(rig, RESUME, run_s=20)).silent
    rig = pair(capabilities=link(mtu_bytes=12))
    with pytest.raises(PayloadTooLargeError, match="orders: the record is"):
        command(rig, SILENCE)
