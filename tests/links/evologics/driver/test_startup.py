"""Finding a modem wherever it may be, and making it what is configured."""

import pytest

from tests.links.evologics.driver.bench import IGNORED, Bench, ScriptedModem
from zacoustic.core.linktypes import LinkState
from zacoustic_evologics.at.commands import Set
from zacoustic_evologics.at.framing import SERIAL_LINE_END, TCP_LINE_END, Framing, Interpreter
from zacoustic_evologics.at.messages import RawData
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.driver.startup.probe import FILLER
from zacoustic_evologics.driver.states import State

PLACES = [
    pytest.param(Interpreter.NET, Framing.LINES, id="NET"),
    pytest.param(Interpreter.AT, Framing.PACKETS, id="data mode"),
    pytest.param(Interpreter.AT, Framing.LINES, id="command mode"),
]
LINE_ENDS = [
    pytest.param(False, TCP_LINE_END, id="tcp"),
    pytest.param(True, SERIAL_LINE_END, id="serial"),
    pytest.param(False, SERIAL_LINE_END, id="tcp with the other line end"),
    pytest.param(True, TCP_LINE_END, id="serial with the other line end"),
]


@pytest.mark.parametrize(("interpreter", "framing"), PLACES)
@pytest.mark.parametrize(("is_serial", "line_end"), LINE_ENDS)
def test_modem_is_found_in_every_mode_with_either_line_end(
    interpreter: Interpreter, framing: Framing, is_serial: bool, line_end: bytes
) -> None:
    modem = ScriptedModem(interpreter, framing, line_end=line_end)
    bench = Bench(modem, is_serial=is_serial)
    bench.make_ready()
    assert bench.changes[-1][0] is LinkState.UP
    assert bench.send(b"found").detail.startswith("SENDEND")
    if interpreter is Interpreter.AT:
        assert modem.decoder.framing is Framing.PACKETS
    assert not any(isinstance(each, RawData) for each in modem.heard)


@pytest.mark.parametrize(("interpreter", "framing"), PLACES)
@pytest.mark.parametrize(
    "typed",
    [b"A", b"AT", b"AT?S", b"AT*SENDIM,5,2,ack", b"AT*SENDIM,5,2,ack,", b"AT*SENDIM,64,2,noack,abc",
     b"AT*SEND,1024,2,abc", b"AT!AL", b"rubbish", b"\x00\xff"],
)  # fmt: skip
def test_half_typed_input_does_no_harm(
    interpreter: Interpreter, framing: Framing, typed: bytes
) -> None:
    modem = ScriptedModem(interpreter, framing)
    before = b"+++" if framing is Framing.PACKETS else b""
    modem.feed(before + typed)
    bench = Bench(modem)
    bench.make_ready()
    assert modem.sent == [], "what was half typed has been sent"
    assert bench.now < 12e9
    assert modem.settings["AL"] == 1


def test_filler_is_used_once_for_a_modem_that_is_not_there() -> None:
    modem = ScriptedModem()
    modem.feed = lambda raw: None  # type: ignore[method-assign]
    bench = Bench(modem)
    bench.connect()
    bench.run(60)
    written = b"".join(bench.written)
    assert written.count(FILLER) == 1
    assert len(bench.resets) > 5
    assert bench.changes[-1][0] is LinkState.OPENING


def test_filler_in_data_mode_is_cleared_from_the_buffer() -> None:
    modem = ScriptedModem(Interpreter.AT, Framing.PACKETS)
    bench = Bench(modem)
    feed = modem.feed
    modem.feed = lambda raw: None  # type: ignore[method-assign]
    bench.connect()
    bench.run(2.6)  # two questions were not heard; the filler is
    modem.feed = feed  # type: ignore[method-assign]
    bench.until(lambda: bench.dialogue.state is State.READY)
    assert "Z" in modem.names()


@pytest.mark.parametrize("state", ["INITIATION NOISE", "INITIATION DEAF", "PHY"])
@pytest.mark.parametrize(("interpreter", "framing"), PLACES)
def test_modem_that_does_not_listen_is_made_to(
    state: str, interpreter: Interpreter, framing: Framing
) -> None:
    modem = ScriptedModem(interpreter, framing)
    modem.state = state
    bench = Bench(modem)
    bench.make_ready()
    assert modem.state == "INITIATION LISTEN"


def test_modem_that_cannot_be_made_to_listen_is_not_used() -> None:
    modem = ScriptedModem()
    modem.state = "INITIATION DEAF"
    modem.answers["A"] = ["ERROR NOT ACCEPTED"] * 9
    bench = Bench(modem)
    bench.connect()
    bench.run(2.0)
    assert "does not listen: INITIATION DEAF" in bench.changes[-2][1]


@pytest.mark.parametrize("stale", [b"OK\r\n", b"RECVIM,5,2,1,ack", b"\xff\x00+++AT:", b"NET\r\n"])
def test_what_comes_right_after_connecting_is_dropped(stale: bytes) -> None:
    bench = Bench()
    bench.connect()
    bench.to_dialogue(stale)
    bench.until(lambda: bench.dialogue.state is State.READY)
    assert bench.dialogue.diagnostics()["settling_bytes"] == len(stale)


def test_nothing_is_set_that_is_not_configured_but_the_retries() -> None:
    modem = ScriptedModem()
    bench = Bench(modem)
    bench.make_ready()
    assert [each for each in modem.heard if isinstance(each, Set)] == [Set("RI", 0)]
    assert "&W" not in modem.names()


def test_a_modem_that_is_as_configured_is_not_touched() -> None:
    modem = ScriptedModem()
    modem.settings |= {"RI": 0, "L": 1, "G": 1, "AM": 30, "AL": 9}
    config = EvologicsConfig(source_level=1, gain=1, highest_address=30, set_address=True)
    bench = Bench(modem, config, node_address=9)
    bench.make_ready()
    assert not any(isinstance(each, Set) for each in modem.heard)
    assert "@CTRL" not in modem.names()


def test_all_that_is_configured_is_set_after_taking_control_and_told() -> None:
    modem = ScriptedModem()
    config = EvologicsConfig(
        set_address=True, highest_address=30, source_level=0, gain=1, retries=2, usbl=False,
        extended_notifications=False,
    )  # fmt: skip
    bench = Bench(modem, config, node_address=20)
    bench.make_ready()
    wanted = {"AL": 20, "AM": 30, "L": 0, "G": 1, "RI": 2}
    assert {name: modem.settings[name] for name in wanted} == wanted
    names = modem.names()
    assert names.index("@CTRL") < min(names.index(f"!{name}") for name in wanted)
    assert "@ZX" not in names
    assert "@ZU" not in names
    detail = bench.changes[-1][1]
    assert "address 20 of 30, source level 0 (0 dB), set AM 14 to 30, AL 1 to 20" in detail


def test_another_address_is_an_error_that_says_what_to_do() -> None:
    bench = Bench(node_address=7)
    bench.connect()
    bench.run(2.0)
    (error,) = bench.hopeless
    assert error.reason == "the modem has address 1, this node 7"
    assert error.hint == "set_address=true gives it 7"
    assert bench.dialogue.state is State.LOST


def test_hopeless_modem_is_looked_at_again_after_a_pause_and_can_be_mended() -> None:
    modem = ScriptedModem()
    bench = Bench(modem, node_address=7)
    bench.connect()
    bench.run(9.0)
    assert bench.resets == []
    modem.settings["AL"] = 7
    bench.until(lambda: bench.dialogue.state is State.READY, 5.0)


def test_highest_address_must_cover_the_node() -> None:
    modem = ScriptedModem()
    modem.settings |= {"AM": 6, "AL": 9}
    bench = Bench(modem, node_address=9)
    bench.connect()
    bench.run(2.0)
    assert "highest address of the network is 6, this node has 9" in bench.hopeless[0].reason


def test_refused_setting_is_an_error_with_the_words_of_the_modem() -> None:
    modem = ScriptedModem()
    modem.answers["!L"] = ["ERROR NO CONTROL"] * 2
    bench = Bench(modem, EvologicsConfig(source_level=1))
    bench.connect()
    bench.run(2.0)
    assert bench.hopeless[0].reason == "the modem refuses AT!L1: ERROR NO CONTROL"
    assert "AT@CTRL" in bench.hopeless[0].hint


def test_without_control_of_the_retries_there_are_no_acknowledgements() -> None:
    modem = ScriptedModem()
    modem.answers["!RI"] = ["ERROR NO CONTROL"] * 2
    bench = Bench(modem)
    bench.make_ready()
    assert not bench.dialogue.capabilities.acknowledges
    bench.send(b"plain", 2, acknowledge=True)
    assert modem.sent[-1].flag.value == "noack"  # type: ignore[union-attr]


def test_on_deck_the_source_level_is_that_for_air_and_stays_it() -> None:
    modem = ScriptedModem()
    modem.settings |= {"L": 0, "LC": 1}
    bench = Bench(modem, EvologicsConfig(deck=True))
    bench.make_ready()
    assert (modem.settings["L"], modem.settings["LC"]) == (3, 0)
    modem.settings["L"] = 1
    modem.write_line("SRCLEVEL,1")
    bench.run(1.0)
    assert modem.settings["L"] == 3
    assert bench.dialogue.diagnostics()["source_level"] == 3


def test_on_deck_a_modem_that_stays_loud_is_not_used() -> None:
    modem = ScriptedModem()
    modem.settings["L"] = 0
    modem.answers["?L"] = ["0"] * 9
    bench = Bench(modem, EvologicsConfig(deck=True))
    bench.connect()
    bench.run(2.0)
    assert "on deck, and the source level is 0" in bench.hopeless[0].reason


def test_starred_answers_are_answers() -> None:
    modem = ScriptedModem()
    modem.answers |= {"!AL": ["[*]OK"], "?AL": ["[*]1", "[*]5"], "!RI": ["[*]OK"], "@ZX": ["[*]OK"]}
    bench = Bench(modem, EvologicsConfig(set_address=True), node_address=5)
    bench.make_ready()
    assert bench.dialogue.capabilities.senses_carrier


def test_older_firmware_that_knows_less_is_good_enough() -> None:
    modem = ScriptedModem()
    unknown = "ERROR UNKNOWN COMMAND"
    names = ("@CTRL", "?CLOCK", "?BV", "?LC", "?G", "?CA", "@ZX", "@ZU", "I", "?DI", "?S")
    modem.answers |= {name: [unknown] * 3 for name in names}
    bench = Bench(modem)
    bench.make_ready()
    assert not bench.dialogue.capabilities.senses_carrier
    assert bench.send(b"old", 2).outcome.value == "sent"


@pytest.mark.parametrize("lost", [None, IGNORED])
def test_each_lost_answer_at_start_is_asked_for_again(lost: str | None) -> None:
    plain = Bench()
    plain.make_ready()
    for name in dict.fromkeys(plain.modem.names()):
        modem = ScriptedModem()
        modem.answers[name] = [lost]
        bench = Bench(modem)
        bench.make_ready()
        assert bench.now < plain.now + 5e9, name
        assert bench.send(b"after all", 2, acknowledge=True).outcome.value == "delivered"
        assert modem.settings["RI"] == 0


def test_message_of_before_is_waited_for_and_then_dropped() -> None:
    for lands, names in ((True, 0), (False, 1)):
        modem = ScriptedModem()
        modem.delivery = "DELIVERING"
        if lands:
            modem.answers["?DI"] = ["DELIVERING", "DELIVERING", "DELIVERED"]
        bench = Bench(modem)
        bench.make_ready()
        assert modem.names().count("Z") == names


@pytest.mark.parametrize("is_serial", [True, False])
def test_a_silent_serial_port_names_its_baud_rate_and_who_tries_others(is_serial: bool) -> None:
    modem = ScriptedModem()
    modem.feed = lambda raw: None  # type: ignore[method-assign]
    bench = Bench(modem, EvologicsConfig(baudrate=9600), is_serial=is_serial)
    bench.connect()
    bench.run(60.0)
    details = [detail for _, detail in bench.changes]
    named = [each for each in details if "at 9600 baud; zacoustic config doctor" in each]
    assert bool(named) is is_serial
    assert any("the modem does not answer" in each for each in details)
