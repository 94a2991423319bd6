"""What a modem would refuse is not written; the answer to every command has its name."""

import pytest
from hypothesis import given

from tests.links.evologics.strategies import COMMANDS
from zacoustic_evologics import (
    SERIAL_LINE_END,
    SETTINGS,
    Framing,
    command_name,
    encode_command,
    encode_message,
)
from zacoustic_evologics.at.commands import (
    Act,
    Action,
    Command,
    Escape,
    ExtensionCommand,
    Help,
    Query,
    SendBurst,
    SendIm,
    SendIms,
    SendPbm,
    SendProbe,
    Set,
    SetOption,
)
from zacoustic_evologics.at.framing import PAYLOAD_LIMIT_BYTES, encode_packet
from zacoustic_evologics.at.messages import RawData, Reply
from zacoustic_evologics.at.notifications import Extension, ImFlag, RecvIm


@pytest.mark.parametrize(
    "command",
    [
        SendIm(payload=b"", destination=2),
        SendIm(payload=bytes(65), destination=2),
        SendIm(payload=b"x", destination=0),
        SendIm(payload=b"x", destination=256),
        SendIm(payload=b"x", destination=-1),
        SendIm(payload=b"x", destination=255, flag=ImFlag.ACK),
        SendIm(payload=b"x", destination=2, pid=8),
        SendIm(payload=b"x", destination=2, pid=-1),
        SendIms(payload=bytes(65), destination=2),
        SendIms(payload=b"x", destination=2, start_us=2**32),
        SendIms(payload=b"x", destination=2, start_us=-1),
        SendIms(payload=b"x", destination=0),
        SendPbm(payload=b"x", destination=255),
        SendPbm(payload=bytes(65), destination=2),
        SendBurst(payload=b"x", destination=255),
        SendBurst(payload=bytes(1025), destination=2),
        SendBurst(payload=b"", destination=2),
        SendProbe(bit=2**63, follow=0),
        Query("al"),
        Query(""),
        Query("AL3"),
        Query("S\nAT?T"),
        Set("L", 4),
        Set("L", -1),
        Set("AL", 0),
        Set("AL", 255),
        Set("AM", 15),
        Set("RT", 499),
        Set("NOSUCH", -1),
        SetOption("ZX", 2),
        SetOption("ZL", 8095),
        Act(Action.LISTEN, 3),
        Act(Action.RESET, 256),
        Act(Action.CONNECT, -1),
        Help("a b"),
        Help(""),
        ExtensionCommand("SYNC", "3\n"),
        Escape(),
    ],
)
def test_command_that_would_be_refused_is_not_written(command: Command) -> None:
    with pytest.raises(ValueError, match=r"\S"):
        encode_command(command)


@pytest.mark.parametrize("name", sorted(SETTINGS))
def test_setting_is_written_at_its_limits_and_not_beyond(name: str) -> None:
    setting = SETTINGS[name]
    make = Set if setting.prefix == "!" else SetOption
    for value in (setting.low, setting.high, setting.default):
        expected = f"AT{setting.prefix}{name}{value}\n".encode()
        assert encode_command(make(name, value)) == expected
    for value in (setting.low - 1, setting.high + 1):
        with pytest.raises(ValueError, match=name):
            encode_command(make(name, value))


def test_setting_that_is_not_in_the_table_is_written_unchecked() -> None:
    assert encode_command(Set("QQ", 77)) == b"AT!QQ77\n"


def test_line_end_and_prefix_are_those_of_the_port_and_mode() -> None:
    command = SendIm(payload=b"a\nb", destination=2, flag=ImFlag.ACK)
    assert encode_command(command) == b"AT*SENDIM,3,2,ack,a\nb\n"
    assert (
        encode_command(command, Framing.PACKETS, SERIAL_LINE_END) == b"+++AT*SENDIM,3,2,ack,a\nb\r"
    )


@pytest.mark.parametrize(
    ("command", "name"),
    [
        (SendIm(payload=b"x", destination=2), "*SENDIM"),
        (SendIms(payload=b"x", destination=2), "*SENDIMS"),
        (SendPbm(payload=b"x", destination=2), "*SENDPBM"),
        (SendBurst(payload=b"x", destination=2), "*SEND"),
        (SendProbe(bit=0, follow=0), "*SENDPROBE"),
        (Query("MODE"), "?MODE"),
        (Set("L", 3), "!L"),
        (SetOption("ZX", 1), "@ZX"),
        (Act(Action.INFORMATION, 0), "I"),
        (Act(Action.RESET, 1), "Z"),
        (Act(Action.ATTENTION), ""),
        (ExtensionCommand("SYNC", "3,10"), "%SYNC"),
    ],
)
def test_answer_is_named_by_the_command_without_parameters(command: Command, name: str) -> None:
    assert command_name(command) == name


@given(COMMANDS)
def test_name_of_every_command_fits_the_header_of_its_answer(command: Command) -> None:
    assert encode_packet(command_name(command), b"OK").endswith(b":2:OK\r\n")


@pytest.mark.parametrize(
    ("message", "framing"),
    [
        (RawData(b"x"), Framing.LINES),
        (Reply("OK"), Framing.PACKETS),
        (Reply("OK", "!L"), Framing.LINES),
        (Reply("OK", "a:b"), Framing.PACKETS),
        (Reply("a\nb"), Framing.LINES),
        (Reply("ä"), Framing.LINES),
        (Extension("", "x"), Framing.LINES),
        (Extension("a,b"), Framing.LINES),
        (Extension("a", "b\r\nc"), Framing.LINES),
    ],
)
def test_message_that_could_not_be_read_is_not_written(
    message: RawData | Reply | Extension, framing: Framing
) -> None:
    with pytest.raises(ValueError, match=r"\S"):
        encode_message(message, framing)


@pytest.mark.parametrize(
    ("duration_us", "bit_rate_bps", "propagation_us"),
    [(None, None, None), (1, 2, 3), (1, 2, None), (None, 2, None), (None, None, 3)],
)
def test_fields_of_two_firmwares_are_not_mixed(
    duration_us: int | None, bit_rate_bps: int | None, propagation_us: int | None
) -> None:
    record = RecvIm(
        payload=b"x", source=2, destination=1, flag=ImFlag.ACK, rssi_db=-40, integrity=120,
        velocity_m_s=0.0, duration_us=duration_us, bit_rate_bps=bit_rate_bps,
        propagation_us=propagation_us,
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"\S"):
        encode_message(record)


def test_float_always_has_its_decimal_point() -> None:
    record = RecvIm(
        payload=b"x", source=2, destination=1, flag=ImFlag.ACK, rssi_db=-40, integrity=120,
        velocity_m_s=0, duration_us=1,
    )  # fmt: skip
    assert encode_message(record) == b"RECVIM,1,2,1,ack,1,-40,120,0.0000,x\r\n"


def test_packet_is_not_longer_than_its_reader_waits_for() -> None:
    with pytest.raises(ValueError, match="allowed"):
        encode_packet("", bytes(2 * PAYLOAD_LIMIT_BYTES))
