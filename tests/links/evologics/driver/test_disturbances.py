"""Lost connections, restarted modems and garbage at every step; seeded faults over a long time."""

import random

import pytest

from tests.links.evologics.driver.bench import IGNORED, Bench, ScriptedModem
from zacoustic.core.linktypes import LinkState, TransmitOutcome
from zacoustic_evologics.at.framing import Framing, Interpreter
from zacoustic_evologics.at.messages import RawData
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.driver.states import State

PLACES = [
    pytest.param(Interpreter.NET, Framing.LINES, id="NET"),
    pytest.param(Interpreter.AT, Framing.PACKETS, id="data mode"),
]
CONFIG = EvologicsConfig(mtu=1024)


def life(bench: Bench, at_step: int = -1, fault: str = "") -> int:
    """Start, send three frames, and let something happen at one of the steps; returns how many."""
    steps = 0
    bench.connect()
    todo = [(b"plain", 255, False), (b"acknowledged", 2, True), (bytes(100), 2, True)]
    while todo or bench.dialogue.state is not State.READY:
        if bench.dialogue.state is State.READY and len(bench.reports) == 3 - len(todo):
            content, to, acknowledge = todo.pop(0)
            bench.transmit(content, to, acknowledge=acknowledge)
        if steps == at_step:
            disturb(bench, fault)
        assert bench.step(), bench.changes
        steps += 1
        assert steps < 2000
    bench.run(70.0)
    return steps


def disturb(bench: Bench, fault: str) -> None:
    match fault:
        case "cut" if bench.is_connected:
            bench.cut()
            bench.after(0.2, bench.connect)
        case "restart":
            bench.modem.restart()
            bench.modem.tells_end = False
            bench.after(2.0, lambda: setattr(bench.modem, "tells_end", True))
        case "garbage":
            bench.to_dialogue(bytes(range(256)) + b"\r\n\x00\xff" * 8)
        case "half a line":
            bench.to_dialogue(b"RECVIM,64,2,1,ack,2048")
        case "half a packet":
            bench.to_dialogue(b"+++AT:500:RECVIM")
        case "half a packet and end":
            bench.to_dialogue(b"+++AT:2000:RECVIM\r\n")
        case "nonsense":
            bench.to_dialogue(b"OK\r\n17\r\nERROR\r\nINITIATION LISTEN\r\n")
        case _:
            pass


@pytest.mark.parametrize(("interpreter", "framing"), PLACES)
@pytest.mark.parametrize(
    "fault",
    ["cut", "restart", "garbage", "half a line", "half a packet", "half a packet and end"],
)
def test_a_fault_at_any_step_costs_one_report_at_most_and_passes(
    fault: str, interpreter: Interpreter, framing: Framing
) -> None:
    steps = life(Bench(ScriptedModem(interpreter, framing), CONFIG))
    for at_step in range(steps):
        bench = Bench(ScriptedModem(interpreter, framing), CONFIG)
        life(bench, at_step, fault)
        assert [each.transmission_id for each in bench.reports] == [1, 2, 3], at_step
        assert bench.dialogue.state is State.READY
        assert bench.dialogue.poll_timeout() is None
        given = [each.payload for each in bench.modem.sent]
        assert len(given) == len(set(given)), f"step {at_step}: sent twice"
        aborted = [each for each in bench.reports if each.outcome is TransmitOutcome.ABORTED]
        assert len(aborted) <= 1, at_step
        if fault.startswith(("garbage", "half")) and framing is Framing.LINES:
            assert bench.modem.settings["AL"] == 1
        assert bench.send(b"last", 2, acknowledge=True).outcome is TransmitOutcome.DELIVERED
        assert not any(isinstance(each, RawData) for each in bench.modem.heard)


@pytest.mark.parametrize(("interpreter", "framing"), PLACES)
def test_a_lost_answer_at_any_command_costs_one_report_at_most(
    interpreter: Interpreter, framing: Framing
) -> None:
    plain = Bench(ScriptedModem(interpreter, framing), CONFIG)
    life(plain)
    names = plain.modem.names()
    for name in dict.fromkeys(names):
        for at in range(names.count(name)):
            for lost in (None, IGNORED):
                modem = ScriptedModem(interpreter, framing)
                modem.answers[name] = [*[""] * at, lost]
                bench = Bench(modem, CONFIG)
                life(bench)
                assert [each.transmission_id for each in bench.reports] == [1, 2, 3], name
                given = [each.payload for each in modem.sent]
                assert len(given) == len(set(given)), f"{name}: sent twice"
                assert bench.send(b"last", 2, acknowledge=True).outcome.value == "delivered"


@pytest.mark.parametrize(("interpreter", "framing"), PLACES)
def test_modem_that_lost_its_power_while_idle_is_found_out_with_the_next_frame(
    interpreter: Interpreter, framing: Framing
) -> None:
    bench = Bench(ScriptedModem(interpreter, framing))
    bench.make_ready()
    bench.modem.restart()
    first = bench.send(b"first", 2)
    assert first.outcome is TransmitOutcome.ABORTED
    assert "restarted" in first.detail
    bench.until(lambda: bench.dialogue.state is State.READY)
    assert bench.send(b"second", 2).outcome is TransmitOutcome.SENT


def test_modem_that_comes_back_in_another_mode_is_found_there() -> None:
    for before, after in (("data", "net"), ("net", "data")):
        places = {
            "net": (Interpreter.NET, Framing.LINES),
            "data": (Interpreter.AT, Framing.PACKETS),
        }
        bench = Bench(ScriptedModem(*places[before]))
        bench.make_ready()
        other = ScriptedModem(*places[after])
        bench.replace(other)
        assert bench.send(b"to nobody", 2).outcome is TransmitOutcome.ABORTED
        bench.until(lambda: bench.dialogue.state is State.READY)  # noqa: B023
        assert bench.dialogue.diagnostics()["interpreter"] == places[after][0].value
        assert bench.send(b"to the modem", 2).outcome is TransmitOutcome.SENT


def test_modem_that_speaks_in_another_mode_while_idle_is_asked() -> None:
    bench = Bench(ScriptedModem(Interpreter.AT, Framing.PACKETS))
    bench.make_ready()
    other = ScriptedModem()
    bench.replace(other)
    other.write_line("RECVIM,5,2,1,noack,204800,-45,133,0.0458,hello")
    bench.until(lambda: bench.changes[-1][0] is LinkState.DOWN, 5.0)
    bench.until(lambda: bench.dialogue.state is State.READY, 5.0)
    other.write_line("RECVIM,5,2,1,noack,204800,-45,133,0.0458,again")
    assert bench.frames[-1].frame_bytes == b"again"


def test_modem_that_speaks_in_packets_while_lines_are_read_is_found_again() -> None:
    bench = Bench()
    bench.make_ready()
    other = ScriptedModem(Interpreter.AT, Framing.PACKETS)
    bench.replace(other)
    bench.to_dialogue(b"+++AT?AL:1:1\r\n")
    assert "data mode" in bench.changes[-1][1]
    bench.until(lambda: bench.dialogue.state is State.READY, 5.0)


def test_raw_data_of_others_costs_one_question_and_nothing_else() -> None:
    bench = Bench(ScriptedModem(Interpreter.AT, Framing.PACKETS))
    bench.make_ready()
    asked = len(bench.modem.heard)
    for _ in range(50):
        bench.to_dialogue(b"somebody's burst\r\n")
        bench.run(0.1)
    assert bench.modem.names()[asked:] == ["?ZX"]
    assert bench.dialogue.state is State.READY
    assert bench.dialogue.diagnostics()["raw_bytes"] == 50 * 18


def test_physical_layer_that_goes_off_takes_the_link_down_until_it_listens() -> None:
    bench = Bench()
    bench.make_ready()
    bench.modem.state = "PHY"
    bench.modem.write_line("PHYOFF")
    assert bench.changes[-1][0] is LinkState.DOWN
    bench.until(lambda: bench.dialogue.state is State.READY, 5.0)
    assert bench.modem.state == "INITIATION LISTEN"


@pytest.mark.parametrize(("interpreter", "framing"), PLACES)
@pytest.mark.parametrize("seed", range(30))
def test_seeded_faults_never_cost_more_than_they_must(
    seed: int, interpreter: Interpreter, framing: Framing
) -> None:
    """Minutes of BUSY storms, lost answers, cuts, restarts and garbage between what is said."""
    rng = random.Random(seed)
    bench = Bench(ScriptedModem(interpreter, framing), CONFIG)
    bench.connect()
    count = 0
    for _ in range(60):
        if bench.dialogue.state is State.READY:
            count += 1
            size = rng.choice([1, 20, 64, 100])
            payload = count.to_bytes(2, "big") + bytes(max(0, size - 2))
            bench.transmit(payload, rng.choice([2, 3]), acknowledge=rng.random() < 0.5)
        bench.run(rng.uniform(0.0, 3.0))
        name = rng.choice(["*SENDIM", "*SEND", "?DI", "?S", "?T", "?PC", "?MODE", "I"])
        match rng.randrange(8):
            case 0:
                bench.modem.answers[name] = ["BUSY BACKOFF STATE"] * rng.randrange(1, 4)
            case 1:
                bench.modem.answers[name] = [rng.choice([None, IGNORED])]
            case 2:
                disturb(bench, "cut")
            case 3:
                disturb(bench, "restart")
            case 4:
                disturb(bench, "garbage")
            case 5:
                disturb(bench, rng.choice(["half a line", "half a packet"]))
            case 6:
                bench.modem.delivers = rng.random() < 0.7
            case _:
                pass
    bench.modem.answers.clear()
    ended_at = bench.now
    bench.run(70.0)
    assert bench.dialogue.state is State.READY, f"seed {seed}"
    assert sorted(each.transmission_id for each in bench.reports) == list(range(1, count + 1))
    given = [each.payload for each in bench.modem.sent]
    accepted = {payload for payload in given if given.count(payload) == 1}
    for payload in set(given) - accepted:  # given again only after BUSY
        assert given.count(payload) <= 15, f"seed {seed}"
    up_at = [at for at, (state, _) in enumerate(bench.changes) if state is LinkState.UP]
    assert up_at
    assert bench.now > ended_at
    bench.modem.delivers = True
    assert bench.send(b"last", 2, acknowledge=True).outcome is TransmitOutcome.DELIVERED
