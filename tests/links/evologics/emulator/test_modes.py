"""Interpreters, modes, options of ports, queries and settings."""

import pytest

from tests.links.evologics.emulator.sea import Sea
from zacoustic_evologics import Framing, Interpreter, ReplyCollector, decode_reply
from zacoustic_evologics.at.commands import Act, Action, Query
from zacoustic_evologics.at.messages import Reply
from zacoustic_evologics.at.notifications import (
    DropCount,
    ExternalClock,
    PhyOff,
    PhyOn,
    RecvIm,
    RemoteAddress,
    SendEnd,
)
from zacoustic_evologics.at.replies import (
    LinkStatus,
    MultipathReply,
    NetStatus,
    PositionReply,
    SettingsReply,
)
from zacoustic_evologics.emulator import Behaviour, PortBytes


def test_net_interpreter_is_recognised_as_drivers_do() -> None:
    host = Sea().host(1)
    assert host.say(b"+++AT?MODE\n") == ["ERROR WRONG FORMAT"]
    assert host.say(b"AT?MODE\n") == ["NET"]
    assert host.say(b"ATO\n") == ["ERROR UNKNOWN COMMAND"]


def test_data_mode_wraps_replies_and_notifications() -> None:
    sea = Sea(interpreter=Interpreter.AT)
    near, far = sea.host(1), sea.host(2)
    assert near.say(b"+++AT?MODE\n") == ["+++AT?MODE:2:AT"]
    assert near.say(b"+++ATI0\n") == ["+++ATI:3:1.9"]
    assert near.say(b"+++AT!L3\n") == ["+++AT!L:2:OK"]
    assert near.say(b"+++ATZ1\n") == ["+++ATZ:2:OK"]
    assert near.say(b"+++AT*SENDIM,4,2,ack,test!\n") == ["+++AT*SENDIM:18:ERROR WRONG FORMAT"]
    refused = ["+++AT*SENDIM:18:ERROR WRONG FORMAT"]
    assert near.say(b"+++AT*SENDIM,p0,4,2,ack,test\n") == refused  # not without ZF
    assert near.say(b"+++AT@ZF1\n") == ["+++AT@ZF:2:OK"]
    assert near.say(b"+++AT*SENDIM,p0,4,2,ack,test\n") == ["+++AT*SENDIM:2:OK"]
    sea.run()
    assert near.lines() == ["+++AT:13:DELIVEREDIM,2"]
    assert len(far.all_of(RecvIm)) == 1
    assert sea.unrecognised() == []


def test_several_lines_are_one_packet_or_end_with_an_empty_line() -> None:
    sea = Sea(interpreter=Interpreter.AT, settings={"ZX": 1})
    near, _ = sea.host(1), sea.host(2)
    near.say(b"+++AT*SENDIM,1,2,ack,x\n")
    sea.run()
    near.raw.clear()
    near.say(b"+++AT?P\n")
    text = near.messages[-1]
    assert isinstance(text, Reply)
    assert len(text.text) == 96
    near.say(b"+++ATC\n")
    near.decoder.framing = Framing.LINES
    before = len(near.messages)
    near.say(b"AT?P\n")
    collector = ReplyCollector(Query("P"), Interpreter.AT)
    texts = [collector.add(m) for m in near.messages[before:] if isinstance(m, Reply)]
    assert texts[:-1] == [None] * 8
    assert texts[-1] == text.text


def test_mode_is_changed_by_commands_and_by_the_guarded_escape() -> None:
    sea = Sea(interpreter=Interpreter.AT)
    host = sea.host(1)
    assert host.say(b"+++AT?AL\n+++ATC\nAT?AL\nATO\n+++AT?AL\n") == [
        "+++AT?AL:1:1", "OK", "1", "+++AT?AL:1:1",
    ]  # fmt: skip
    sea.wait(1.5)
    assert host.say(b"+++") == []
    sea.wait(1.5)
    assert host.lines() == ["OK"]
    assert host.say(b"AT?MODE\n") == ["AT"]


def test_escape_without_silence_around_it_is_data() -> None:
    sea = Sea(interpreter=Interpreter.AT)
    near, far = sea.host(1), sea.host(2)
    near.say(b"+++AT!AR2\n")
    near.say(b"some +++")
    sea.run()
    assert bytes(far.raw) == b"some +++"
    assert near.say(b"+++AT?MODE\n") == ["+++AT?MODE:2:AT"]
    sea.wait(2.0)
    near.say(b"+++")
    sea.wait(0.5)
    near.say(b"AT?MODE\n")
    sea.run()
    assert near.say(b"+++AT?MODE\n") == ["+++AT?MODE:2:AT"]


def test_raw_data_without_remote_address_is_dropped_and_counted() -> None:
    sea = Sea(interpreter=Interpreter.AT)
    host = sea.host(1)
    host.say(b"x" * 64)
    assert host.all_of(DropCount) == [DropCount(64)]
    assert host.say(b"+++AT?ZD\n") == ["+++AT?ZD:2:64"]
    assert host.say(b"+++AT@ZD\n") == ["+++AT@ZD:2:OK"]
    assert host.say(b"+++AT?ZD\n") == ["+++AT?ZD:1:0"]


def test_every_setting_is_read_and_written_within_its_limits() -> None:
    host = Sea().host(1)
    for name, value, bad in [
        ("L", 0, 4), ("LC", 1, 2), ("G", 1, 2), ("C", 2, 4), ("AM", 62, 63), ("AL", 9, 63),
        ("AR", 2, 255), ("RC", 1, 256), ("RT", 2000, 499), ("RI", 0, 256), ("RP", 1, 2),
        ("CA", 1480, 1200), ("ZC", 32, 256), ("ZP", 500, 49), ("ZI", 0, 3601), ("ZH", 1, 3601),
        ("DA", 0, 3601), ("DT", 0, 3601), ("KO", 0, 256), ("ZS", 1, 8), ("ZS", 0, 8),
    ]:  # fmt: skip
        assert host.say(f"AT!{name}{value}\n".encode()) == ["OK"], name
        assert host.say(f"AT?{name}\n".encode()) == [str(value)]
        assert host.say(f"AT!{name}{bad}\n".encode()) == ["ERROR OUT OF RANGE"], name
        assert host.say(f"AT?{name}\n".encode()) == [str(value)]
    for name in ("ZF", "ZX", "ZU", "ZA", "ZB"):
        assert host.say(f"AT@{name}1\n".encode())[0] == "OK"
        assert host.say(f"AT?{name}\n".encode()) == ["1"]
        assert host.say(f"AT@{name}2\n".encode()) == ["ERROR OUT OF RANGE"]
        assert host.say(f"AT@{name}0\n".encode()) == ["OK"]
    assert host.say(b"AT@ZL8192\n") == ["OK"]
    assert host.say(b"AT?ZL\n") == ["8192"]


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (b"AT\n", "OK"),
        (b"AT?T\n", "0"),
        (b"AT?PC\n", "1"),
        (b"AT?PID\n", "0"),
        (b"AT?DI\n", "EMPTY"),
        (b"AT?BV\n", "24.1000"),
        (b"AT?V\n", "0.0000"),
        (b"AT?UP\n", "ERROR OUT OF CONTEXT"),
        (b"AT?Q\n", "ERROR UNKNOWN COMMAND"),
        (b"AT!XY1\n", "ERROR UNKNOWN COMMAND"),
        (b"AT@XY1\n", "ERROR WRONG FORMAT"),
        (b"ATQ\n", "ERROR UNKNOWN COMMAND"),
        (b"AT%SYNC,1,10\n", "ERROR UNKNOWN COMMAND"),
        (b"ATI0\n", "1.9"),
        (b"ATI9\n", "ERROR OUT OF RANGE"),
        (b"ATN\n", "INITIATION NOISE"),
        (b"ATS\n", "INITIATION DEAF"),
        (b"ATA\n", "INITIATION LISTEN"),
        (b"ATZ9\n", "ERROR OUT OF RANGE"),
        (b"ATD\n", "ERROR OUT OF CONTEXT"),
        (b"ATH0\n", "OK"),
        (b"AT&W\n", "OK"),
        (b"AT@CTRL\n", "OK"),
        (b"hello\n", "ERROR WRONG FORMAT"),
    ],
)
def test_commands_have_exactly_one_reply(command: bytes, answer: str) -> None:
    assert Sea().host(1).say(command) == [answer]


def test_line_ends_of_all_kinds_are_taken() -> None:
    assert Sea().host(1).say(b"AT?AL\rAT?AL\r\n\r\nAT?AL\n") == ["1"] * 3


def test_replies_of_several_lines_are_understood() -> None:
    sea = Sea(settings={"ZU": 1})
    near, _ = sea.host(1), sea.host(2)
    near.say(b"AT*SENDIM,1,2,ack,x\n")
    sea.run()

    def asked(text: bytes, command: Query | Act) -> object:
        collector = ReplyCollector(command, Interpreter.NET)
        before = len(near.messages)
        near.say(text)
        replies = [m for m in near.messages[before:] if isinstance(m, Reply)]
        whole = [collector.add(reply) for reply in replies][-1]
        assert whole is not None
        return decode_reply(command, whole)

    status = asked(b"AT?S\n", Query("S"))
    assert isinstance(status, NetStatus)
    assert (status.local_address, status.state) == (1, "INITIATION LISTEN")
    shown = asked(b"AT&V\n", Act(Action.SHOW_SETTINGS))
    assert isinstance(shown, SettingsReply)
    assert len(shown.settings) == 18
    paths = asked(b"AT?P\n", Query("P"))
    assert isinstance(paths, MultipathReply)
    assert paths.paths[0].strength > 0
    position = asked(b"AT?UPX\n", Query("UPX"))
    assert isinstance(position, PositionReply)
    assert position.x_m == pytest.approx(1500, rel=1e-3)
    assert decode_reply(Query("S"), "INITIATION LISTEN 16384") == LinkStatus(
        "INITIATION LISTEN", (16384,)
    )
    near.say(b"AT?NOISE\nAT?S$\nAT?ZSL\n")
    assert sea.unrecognised() == []


def test_at_interpreter_shows_its_status_in_one_line() -> None:
    host = Sea(interpreter=Interpreter.AT).host(1)
    assert host.say(b"+++AT?S\n") == ["+++AT?S:23:INITIATION LISTEN 16384"]


def test_several_clients_have_options_and_protocol_ids_of_their_own() -> None:
    sea = Sea()
    main, other, peer = sea.host(1), sea.host(1), sea.host(2)
    main.say(b"AT@ZX1\n")
    other.say(b"AT!ZS3\n")
    assert other.say(b"AT!L2\n") == ["ERROR NO CONTROL"]
    assert other.say(b"AT*SENDIM,1,2,noack,x\n") == ["OK"]
    sea.run()
    assert len(main.all_of(SendEnd)) == 1
    assert other.all_of(SendEnd) == []
    assert peer.messages == []  # its protocol id is another one
    peer.say(b"AT@ZF1\n")
    other.say(b"AT*SENDIM,1,2,ack,x\n")
    sea.run()
    assert peer.first(RecvIm).pid == 3
    assert other.lines() == ["DELIVEREDIM,2"]
    assert "DELIVEREDIM,2" not in main.lines()


def test_control_belongs_to_the_port_that_asked_for_it_until_it_goes() -> None:
    sea = Sea()
    one, two = sea.host(1), sea.host(1)
    assert two.say(b"AT!L2\n") == ["OK"]
    assert one.say(b"AT@CTRL\n") == ["OK"]
    assert two.say(b"AT!L1\n") == ["ERROR NO CONTROL"]
    assert one.say(b"AT!L1\n") == ["OK"]
    sea.fleet.close_port(one.port_id, now=sea.fleet.now)
    assert two.say(b"AT!L0\n") == ["OK"]
    strict = Sea(behaviour=Behaviour(strict_control=True)).host(1)
    assert strict.say(b"AT!L1\n") == ["ERROR NO CONTROL"]
    assert strict.say(b"AT@CTRL\nAT!L1\n") == ["OK", "OK"]


def test_reset_closes_the_port_forgets_what_was_not_stored_and_takes_four_seconds() -> None:
    sea = Sea()
    host, serial = sea.host(1), sea.host(1, is_serial=True)
    host.say(b"AT!RI7\nAT&W\nAT!RI5\n")
    assert host.say(b"ATZ0\n") == []
    assert host.is_closed
    assert not serial.is_closed
    assert serial.say(b"AT?AL\n") == []
    with pytest.raises(ConnectionRefusedError):
        sea.host(1)
    sea.run(3.99)
    assert not sea.fleet.is_up(1)
    sea.run(4.0)
    assert serial.say(b"AT?RI\n") == ["7"]
    assert sea.host(1).say(b"AT?RI\n") == ["7"]
    assert sea.host(1).say(b"AT&F\nAT?RI\nAT?AL\n") == ["OK", "1", "1"]


def test_reset_returns_a_serial_line_to_data_mode() -> None:
    sea = Sea(interpreter=Interpreter.AT)
    serial = sea.host(1, is_serial=True)
    serial.say(b"+++ATC\n")
    serial.say(b"ATZ0\n")
    sea.run()
    assert serial.say(b"+++AT?AL\n") == ["+++AT?AL:1:1"]


def test_modem_clock_ticks_in_microseconds_and_wraps_at_32_bits() -> None:
    sea = Sea()
    host = sea.host(1)
    before = int(host.say(b"AT?CLOCK\n")[0])
    sea.run(4294.967296 + 5.0)
    assert (int(host.say(b"AT?CLOCK\n")[0]) - before) % 2**32 == 5_000_000
    assert host.say(b"AT!UT1700000000\n") == ["OK"]
    sea.wait(10.5)
    assert host.say(b"AT?UT\n") == ["1700000010"]


def test_physical_mode_and_other_states_stop_what_they_stop() -> None:
    sea = Sea(settings={"ZX": 1})
    near, far = sea.host(1), sea.host(2)
    assert near.say(b"ATP\n") == ["OK", "PHYOFF"]
    assert near.say(b"AT*SENDIM,1,2,ack,x\n") == ["ERROR PHY OFF"]
    assert near.say(b"AT?S\n")[0].splitlines()[2] == "Acoustic Link Status: PHY"
    assert near.say(b"ATA\n") == ["INITIATION LISTEN", "PHYON"]
    assert near.all_of(PhyOff)
    assert near.all_of(PhyOn)
    assert far.say(b"ATS\n") == ["INITIATION DEAF"]
    near.say(b"AT*SENDIM,1,2,noack,x\n")
    sea.run()
    assert far.all_of(RecvIm) == []


def test_external_clock_is_told_every_second_where_it_was_asked_for() -> None:
    sea = Sea()
    host = sea.host(1)
    host.say(b"AT@ZA1\n")
    sea.run(5.5)
    assert len(host.all_of(ExternalClock)) == 5
    host.say(b"AT@ZA0\nAT!AR2\n")
    assert sea.fleet.poll_timeout() is None
    assert host.all_of(RemoteAddress) == []


def test_idle_fleet_has_no_timer_and_tells_nothing() -> None:
    sea = Sea(5)
    for address in range(1, 6):
        sea.host(address)
    assert sea.fleet.poll_timeout() is None
    assert [each for each in sea.outputs if isinstance(each[1], PortBytes)] == []
