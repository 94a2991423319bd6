"""What a host says is read as a modem would: line ends, lengths, data mode, silence."""

import random
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.links.evologics.cutting import at_random, decoded, one_by_one
from tests.links.evologics.strategies import NASTY_PIECES
from zacoustic_evologics import CommandDecoder, Framing, Interpreter
from zacoustic_evologics.at.command_decoder import (
    COMMAND_LINE_LIMIT_BYTES,
    HELD_COMMAND_LIMIT_BYTES,
)
from zacoustic_evologics.at.commands import (
    Act,
    Action,
    Command,
    Escape,
    ExtensionCommand,
    Help,
    InvalidCommand,
    Mistake,
    Query,
    SendBurst,
    SendIm,
    SendIms,
    SendPbm,
    SendProbe,
    Set,
    SetOption,
)
from zacoustic_evologics.at.messages import RawData
from zacoustic_evologics.at.notifications import ImFlag


def data_mode() -> CommandDecoder:
    return CommandDecoder(Interpreter.AT, Framing.PACKETS)


@pytest.mark.parametrize(
    ("text", "command"),
    [
        (b"AT", Act(Action.ATTENTION)),
        (b"AT?MODE", Query("MODE")),
        (b"AT!AL3", Set("AL", 3)),
        (b"AT!LC1", Set("LC", 1)),
        (b"AT!AM15", Set("AM", 15)),
        (b"AT@ZX1", SetOption("ZX", 1)),
        (b"AT@CTRL", SetOption("CTRL")),
        (b"ATI", Act(Action.INFORMATION)),
        (b"ATI0", Act(Action.INFORMATION, 0)),
        (b"ATZ4", Act(Action.RESET, 4)),
        (b"ATD", Act(Action.CONNECT)),
        (b"ATD12", Act(Action.CONNECT, 12)),
        (b"AT&V", Act(Action.SHOW_SETTINGS)),
        (b"AT&W", Act(Action.STORE_SETTINGS)),
        (b"ATA", Act(Action.LISTEN)),
        (b"AT?S$", Help("?S")),
        (b"AT*SENDIM$", Help("*SENDIM")),
        (b"AT%SYNC,3,10", ExtensionCommand("SYNC", "3,10")),
        (b"AT%RESET", ExtensionCommand("RESET")),
        (b"AT*SENDPROBE,1,0,", SendProbe(bit=1, follow=0)),
        (b"AT*SENDPROBE,1,0,7", SendProbe(bit=1, follow=0, start_us=7)),
        (b"AT*SEND,5,3,a\r\nbc", SendBurst(payload=b"a\r\nbc", destination=3)),
        (b"AT*SENDPBM,3,4,abc", SendPbm(payload=b"abc", destination=4)),
        (b"AT*SENDIMS,p0,4,3,,ping", SendIms(payload=b"ping", destination=3, pid=0)),
        (b"AT*SENDIMS,4,3,9,ping", SendIms(payload=b"ping", destination=3, start_us=9)),
        (
            b"AT*SENDIM,p0,4,3,ack,test",
            SendIm(payload=b"test", destination=3, flag=ImFlag.ACK, pid=0),
        ),
        (
            b"AT*SENDIM,5,255,noack,a,b,c",
            SendIm(payload=b"a,b,c", destination=255, flag=ImFlag.NOACK),
        ),
        # Values out of range are read, so that they can be refused by their meaning.
        (b"AT!L4", Set("L", 4)),
        (b"AT?NOSUCH", Query("NOSUCH")),
        (b"AT*SENDIM,0,999,ack,", SendIm(payload=b"", destination=999, flag=ImFlag.ACK)),
        (
            b"AT*SENDIM,65,3,ack," + bytes(65),
            SendIm(payload=bytes(65), destination=3, flag=ImFlag.ACK),
        ),
    ],
)
@pytest.mark.parametrize("line_end", [b"\n", b"\r", b"\r\n"])
@pytest.mark.parametrize("framing", Framing)
def test_command_is_read(text: bytes, command: Command, line_end: bytes, framing: Framing) -> None:
    stream = (text if framing is Framing.LINES else b"+++" + text) + line_end
    for pieces in ([stream * 2], one_by_one(stream * 2)):
        assert decoded(CommandDecoder(Interpreter.AT, framing), pieces) == [command] * 2


@pytest.mark.parametrize(
    ("text", "name", "mistake"),
    [
        (b"AT*SENDIM,4,3,ack,test!", "*SENDIM", Mistake.WRONG_FORMAT),
        (b"AT*SENDIM,4,3,ack,test!!!", "*SENDIM", Mistake.WRONG_FORMAT),
        (b"AT*SENDIM,4,3,perhaps,test", "*SENDIM", Mistake.WRONG_FORMAT),
        (b"AT*SENDIM,x,3,ack,test", "*SENDIM", Mistake.WRONG_FORMAT),
        (b"AT*SENDIM,4", "*SENDIM", Mistake.WRONG_FORMAT),
        (b"AT*SENDIM", "*SENDIM", Mistake.WRONG_FORMAT),
        (b"AT*SENDIM,p,4,3,ack,test", "*SENDIM", Mistake.WRONG_FORMAT),
        (b"AT*SENDIMS,4,3,soon,ping", "*SENDIMS", Mistake.WRONG_FORMAT),
        (b"AT*SEND,99999,3,hello", "*SEND", Mistake.WRONG_FORMAT),
        (b"AT*SENDPROBE,1", "*SENDPROBE", Mistake.WRONG_FORMAT),
        (b"AT!L", "!L", Mistake.WRONG_FORMAT),
        (b"AT!L-1", "!L", Mistake.WRONG_FORMAT),
        (b"AT?AL3", "?AL", Mistake.WRONG_FORMAT),
        (b"AT?", "?", Mistake.WRONG_FORMAT),
        (b"ATA3", "A", Mistake.WRONG_FORMAT),
        (b"ATZ999", "Z", Mistake.WRONG_FORMAT),
        (b"ATQ", "Q", Mistake.UNKNOWN_COMMAND),
        (b"ATX4", "X", Mistake.UNKNOWN_COMMAND),
        (b"AT&X", "&X", Mistake.UNKNOWN_COMMAND),
        (b"at?s", "", Mistake.WRONG_FORMAT),
        (b"hello", "", Mistake.WRONG_FORMAT),
        (b"+++AT?MODE", "", Mistake.WRONG_FORMAT),
        (b"\x00\xff", "", Mistake.WRONG_FORMAT),
    ],
)
def test_mistake_is_one_mistake_and_the_next_command_is_read(
    text: bytes, name: str, mistake: Mistake
) -> None:
    stream = text + b"\nAT?S\n"
    expected = [InvalidCommand(text, mistake, name), Query("S")]
    assert CommandDecoder().feed(stream) == expected
    assert decoded(CommandDecoder(), one_by_one(stream)) == expected


def test_payload_shorter_than_announced_swallows_the_next_command() -> None:
    decoder = CommandDecoder()
    assert decoder.feed(b"AT*SENDIM,10,3,ack,test\n") == []
    assert decoder.feed(b"AT?S\n") == []
    assert decoder.feed(b"AT?S\n") == [
        InvalidCommand(b"AT*SENDIM,10,3,ack,test\nAT?S\nAT?S", Mistake.WRONG_FORMAT, "*SENDIM")
    ]
    assert decoder.feed(b"AT?S\n") == [Query("S")]


def test_command_typed_half_waits_for_its_other_half() -> None:
    decoder = CommandDecoder()
    assert decoder.feed(b"AT?") == []
    assert decoder.silence(guarded=True) == []
    assert decoder.held_bytes == 3
    assert decoder.feed(b"MODE\r") == [Query("MODE")]


def test_empty_lines_between_commands_are_nothing() -> None:
    assert CommandDecoder().feed(b"\r\n\n\nAT?S\r\r\n\nAT?T\n\r") == [Query("S"), Query("T")]


def test_line_feed_behind_a_carriage_return_is_not_raw_data() -> None:
    stream = b"+++AT?S\r\nraw\n"
    for pieces in ([stream], one_by_one(stream)):
        assert decoded(data_mode(), pieces) == [Query("S"), RawData(b"raw\n")]


def test_switch_of_mode_holds_for_the_very_next_byte() -> None:
    stream = b"raw+++ATC\nAT?S\nATO\nraw AT?S\n+++AT?T\n"
    expected = [
        RawData(b"raw"), Act(Action.COMMAND_MODE), Query("S"), Act(Action.DATA_MODE),
        RawData(b"raw AT?S\n"), Query("T"),
    ]  # fmt: skip
    assert data_mode().feed(stream) == expected
    assert decoded(data_mode(), one_by_one(stream)) == expected


def test_net_interpreter_has_no_data_mode() -> None:
    decoder = CommandDecoder(Interpreter.NET)
    assert decoder.feed(b"ATO\nAT?S\n") == [Act(Action.DATA_MODE), Query("S")]
    with pytest.raises(ValueError, match="NET"):
        CommandDecoder(Interpreter.NET, Framing.PACKETS)


def test_escape_needs_silence_on_both_sides() -> None:
    decoder = data_mode()
    assert decoder.feed(b"+++") == []
    assert decoder.silence(guarded=False) == [RawData(b"+++")]
    assert decoder.feed(b"+++") == []
    assert decoder.silence(guarded=True) == [Escape()]
    assert decoder.feed(b"AT?S\n") == [Query("S")]
    assert decoder.silence(guarded=True) == []


def test_silence_releases_what_becomes_no_command_and_keeps_what_has_begun() -> None:
    decoder = data_mode()
    assert decoder.feed(b"data++") == [RawData(b"data")]
    assert decoder.silence(guarded=False) == [RawData(b"++")]
    assert decoder.feed(b"+++AT?") == []
    assert decoder.silence(guarded=False) == []
    assert decoder.feed(b"S\n") == [Query("S")]


def test_line_without_end_is_one_mistake_however_long_it_is() -> None:
    decoder = CommandDecoder()
    found = decoder.feed(b"x" * 5000)
    found += decoder.feed(b"x" * 5000)
    assert found == [InvalidCommand(b"x" * COMMAND_LINE_LIMIT_BYTES, Mistake.WRONG_FORMAT)]
    assert decoder.held_bytes == 0
    assert decoder.feed(b"\r\nAT?S\n") == [Query("S")]


@given(st.lists(st.sampled_from(NASTY_PIECES) | st.binary(max_size=9), max_size=60), st.integers())
def test_any_bytes_give_the_same_commands_however_they_are_cut(
    pieces: list[bytes], seed: int
) -> None:
    stream = b"".join(pieces)
    for framing in Framing:
        expected = CommandDecoder(Interpreter.AT, framing).feed(stream)
        for cut in (one_by_one(stream), at_random(stream, seed)):
            assert decoded(CommandDecoder(Interpreter.AT, framing), cut) == expected


@pytest.mark.parametrize("framing", Framing)
def test_random_bytes_neither_raise_nor_fill_the_memory(
    framing: Framing, count: Callable[[int], int]
) -> None:
    rng = random.Random(6)
    starts = (*NASTY_PIECES, b"AT*SENDIM,64,3,ack,", b"+++AT*SEND,900,3,", b"AT!", b"AT*SEND,")
    decoder = CommandDecoder(Interpreter.AT, framing)
    left = count(1_000_000)
    while left > 0:
        piece = b"".join(
            rng.randbytes(rng.randrange(30)) if rng.randrange(2) else rng.choice(starts)
            for _ in range(rng.choice((1, 3, 50)))
        )
        decoder.feed(piece)
        assert decoder.held_bytes <= HELD_COMMAND_LIMIT_BYTES
        left -= max(len(piece), 1)
    decoder.feed(b"\n" * HELD_COMMAND_LIMIT_BYTES)
    decoder.feed(b"AT?S\n" if decoder.framing is Framing.LINES else b"+++AT?S\n")
    assert decoder.held_bytes == 0
