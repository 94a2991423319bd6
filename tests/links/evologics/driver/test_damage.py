"""What is damaged on the port, or forgotten by the modem, is not believed. Found by voyages."""

import pytest

from tests.links.evologics.driver.bench import Bench, ScriptedModem
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.linktypes import TransmitOutcome
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.driver.sending.times import BUSY_PAUSE_S
from zacoustic_evologics.driver.states import State


def ready(config: EvologicsConfig | None = None, *, node_address: int = 1) -> Bench:
    modem = ScriptedModem()
    modem.settings["AL"] = node_address
    bench = Bench(modem, config, node_address=node_address)
    bench.make_ready()
    return bench


@pytest.mark.parametrize("words", ["ERROR EFAuDT", "ERROR OKSENDSTART,2,im,1,0", "ERROR"])
def test_damaged_words_are_no_refusal_of_a_frame_that_the_modem_has(words: str) -> None:
    bench = ready()
    transmission_id = bench.transmit(b"once", 2)
    bench.to_dialogue(words.encode() + b"\r\n")
    bench.until(lambda: bench.reports_of(transmission_id))
    assert bench.reports[0].outcome is TransmitOutcome.SENT
    assert len(bench.modem.sent) == 1


@pytest.mark.parametrize("name", ["AL", "AM", "RI", "L", "G"])
@pytest.mark.parametrize("misread", ["0", "2"])
def test_number_that_was_read_wrong_once_is_read_again(name: str, misread: str) -> None:
    modem = ScriptedModem()
    modem.answers["?" + name] = [misread]
    bench = Bench(modem, EvologicsConfig(gain=0))
    bench.connect()
    bench.until(lambda: bench.dialogue.state is State.READY, 5.0)
    assert modem.settings["RI"] == 0
    assert modem.settings["G"] == 0
    assert bench.dialogue.diagnostics()["highest_address"] == 14
    assert bench.hopeless == []


@pytest.mark.parametrize("is_told", [False, True])
def test_modem_that_may_have_restarted_is_told_again_how_often_it_may_repeat(is_told: bool) -> None:
    bench = ready(EvologicsConfig(extended_notifications=is_told))
    assert bench.modem.settings["RI"] == 0
    bench.run(5.0)
    bench.modem.restart()
    assert bench.modem.settings["RI"] == 1
    bench.transmit(b"first", 2, acknowledge=True)
    bench.until(lambda: bench.modem.sent)
    assert bench.modem.settings["RI"] == 0


def test_modem_that_was_heard_just_now_is_not_told_again() -> None:
    bench = ready()
    bench.run(5.0)
    for _ in range(3):
        bench.send(b"first", 2, acknowledge=True)
    assert bench.modem.names().count("!RI") == 2  # at the start, and after the silence
    assert bench.send(b"to all").outcome is TransmitOutcome.SENT
    assert bench.modem.names().count("!RI") == 2


def test_nodes_that_were_refused_at_once_do_not_ask_again_at_once() -> None:
    asked_at: list[int] = []
    for node_address in (1, 2, 3):
        bench = ready(node_address=node_address)
        began_at = bench.now
        bench.modem.answers["*SENDIM"] = ["BUSY BACKOFF STATE"]
        bench.transmit(b"again", 4)
        bench.until(lambda: "?S" in bench.modem.names()[-1:])  # noqa: B023
        asked_at.append(bench.now - began_at)
    least_s, most_s = BUSY_PAUSE_S
    assert seconds_to_ns(least_s) < min(asked_at) <= max(asked_at) < seconds_to_ns(most_s + 0.1)
    assert len({at // seconds_to_ns(0.05) for at in asked_at}) == 3
