"""Frames that go with what the modem sends by itself."""

import itertools
import random
from collections.abc import Callable

import pytest

from tests.links.evologics.driver.bench import Bench, ScriptedModem
from tests.links.evologics.driver.sea import Sea
from zacoustic.core.clock import ns_to_seconds, seconds_to_ns
from zacoustic.core.linktypes import TransmitOutcome, TransmitReport
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.at.notifications import (
    CanceledPbm,
    ImFlag,
    RecvIm,
    SendEnd,
    SendStart,
)
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.driver.dialogue import AtDialogue
from zacoustic_evologics.driver.states import State
from zacoustic_evologics.emulator import (
    EmulatedFleet,
    FaultKind,
    FaultPlan,
    ScriptedFault,
    scenario_of,
)

SENT, DELIVERED = TransmitOutcome.SENT, TransmitOutcome.DELIVERED
REJECTED, ABORTED = TransmitOutcome.REJECTED, TransmitOutcome.ABORTED
WAITING = EvologicsConfig(service="pbm", busy_s=5.0)


def sea_of_two(config: EvologicsConfig | None = None, *, is_serial: bool = False) -> Sea:
    """Two nodes 1500 m apart, the second with settings of its own.

    It knows already that its modem tells of its answers, if it does not only wait for them.
    """
    interpreter = Interpreter.AT if is_serial else Interpreter.NET
    config = config or EvologicsConfig()
    sea = Sea(
        scenario_of(2, spacing_m=1500.0),
        config=EvologicsConfig(mtu=1024),
        interpreter=interpreter,
        is_serial=is_serial,
    )
    sea[2].dialogue = AtDialogue(config, node_address=2, is_serial=is_serial)
    sea.cut(2)
    sea.make_ready()
    if config.service != "pbm":
        assert sea.send(1, b"hello", 2, acknowledge=True).outcome is DELIVERED
        sea.run(1.0)
    return sea


def answer(
    sea: Sea, content: bytes, *, after_s: float = 0.0, acknowledge: bool = False
) -> TransmitReport:
    """The first asks with acknowledgement, the second says something as soon as it has heard it."""
    heard = len(sea[2].frames)
    sea.transmit(1, b"what is it?", 2, acknowledge=True)
    sea.until(lambda: len(sea[2].frames) > heard)
    sea.run(after_s)
    return sea.send(2, content, 1, acknowledge=acknowledge)


@pytest.mark.parametrize("is_serial", [False, True])
def test_frame_to_who_is_owed_an_acknowledgement_goes_with_it(is_serial: bool) -> None:
    sea = sea_of_two(is_serial=is_serial)
    report = answer(sea, b"a,b\r\n+++AT")
    assert report.outcome is SENT
    assert report.detail.startswith("SENDEND,1,ack,")
    # 110 ms until the acknowledgement begins, and the 10 bytes sound 0.262 s.
    assert ns_to_seconds(report.finished_at - report.started_at) == pytest.approx(0.262, abs=0.01)
    sea.run(5.0)
    assert [each.frame_bytes for each in sea[1].frames] == [b"a,b\r\n+++AT"]
    assert sea[1].reports[-1].outcome is DELIVERED
    assert sea[2].dialogue.poll_timeout() is None


def test_piggyback_message_is_sooner_than_an_instant_message() -> None:
    lasted_s = []
    for service in ("auto", "im"):
        sea = sea_of_two(EvologicsConfig(service=service))
        asked_at = sea.now
        report = answer(sea, bytes(20))
        assert report.outcome is SENT
        lasted_s.append(ns_to_seconds(report.finished_at - asked_at))
    assert lasted_s[0] < lasted_s[1] - 0.2


def test_first_answer_goes_by_itself_since_it_is_not_known_what_the_modem_tells() -> None:
    sea = Sea(scenario_of(2, spacing_m=300.0))
    sea.make_ready()
    assert answer(sea, b"first").detail.startswith("SENDEND,1,im,")
    sea.run(1.0)
    assert answer(sea, b"second").detail.startswith("SENDEND,1,ack,")


@pytest.mark.parametrize(
    ("size", "acknowledge", "detail"),
    [(64, False, "SENDEND,1,ack,"), (20, True, "DELIVEREDIM,1"), (65, False, "DELIVERED,")],
)
def test_what_wants_more_than_a_piggyback_message_gives_goes_otherwise(
    size: int, acknowledge: bool, detail: str
) -> None:
    sea = sea_of_two(EvologicsConfig(mtu=1024))
    assert answer(sea, bytes(size), acknowledge=acknowledge).detail.startswith(detail)


def test_broadcast_and_frames_to_others_do_not_go_with_an_acknowledgement() -> None:
    sea = sea_of_two()
    for to in (255, 9):
        heard = len(sea[2].frames)
        sea.transmit(1, b"%d" % to, 2, acknowledge=True)
        sea.until(lambda heard=heard: len(sea[2].frames) > heard)  # type: ignore[misc]
        assert sea.send(2, b"not for 1", to).detail.startswith(f"SENDEND,{to},im,")
        sea.run(3.0)


def test_configured_piggyback_waits_for_the_other_side() -> None:
    sea = sea_of_two(WAITING)
    sea.transmit(2, b"when you ask", 1)
    sea.run(3.0)
    assert sea[2].reports == []
    sea.transmit(1, b"now", 2, acknowledge=True)
    sea.run(4.0)
    (report,) = sea[2].reports
    assert report.outcome is SENT
    assert [each.frame_bytes for each in sea[1].frames] == [b"when you ask"]
    # A connection for burst data is an occasion, too.
    sea.transmit(2, b"and this", 1)
    sea.run(1.0)
    sea.transmit(1, bytes(200), 2)
    sea.run(10.0)
    assert [each.outcome for each in sea[2].reports] == [SENT, SENT]
    assert sea[1].frames[-1].frame_bytes == b"and this"


def test_configured_piggyback_without_an_occasion_is_rejected_and_does_not_stay_behind() -> None:
    sea = sea_of_two(WAITING)
    assert not sea[2].dialogue.capabilities.acknowledges
    report = sea.send(2, b"nobody asks", 1, acknowledge=True)
    assert (report.outcome, report.detail) == (REJECTED, "CANCELEDPBM,1")
    assert ns_to_seconds(report.finished_at - report.started_at) == pytest.approx(5.0, abs=0.1)
    sea.transmit(1, b"too late", 2, acknowledge=True)
    sea.run(5.0)
    assert sea[1].frames == []
    assert sea[1].reports[-1].outcome is DELIVERED


def test_configured_piggyback_leaves_broadcast_to_instant_messages() -> None:
    sea = sea_of_two(WAITING)
    assert sea.send(2, b"all", 255).detail.startswith("SENDEND,255,im,")


def test_lost_connection_leaves_no_piggyback_behind() -> None:
    sea = sea_of_two(WAITING)
    sea.transmit(2, b"waits", 1)
    sea.run(1.0)
    sea.cut(2)
    assert [each.outcome for each in sea[2].reports] == [ABORTED]
    sea.make_ready()
    assert sea.send(1, b"anything?", 2, acknowledge=True).outcome is DELIVERED
    sea.run(3.0)
    assert sea[1].frames == []


def test_modem_that_restarts_has_not_sent_it() -> None:
    plan = FaultPlan(script=(ScriptedFault(kind=FaultKind.RESET, at_s=10.0, modem=2),))
    fleet = EmulatedFleet(scenario_of(2), faults=plan)
    sea = Sea(fleet.scenario, fleet=fleet, config=WAITING)
    sea.make_ready()
    sea.run(9.0)
    sea.transmit(2, b"waits", 1)
    sea.run(20.0)
    assert [each.outcome for each in sea[2].reports] == [ABORTED]
    assert sea[2].is_ready


SPARING = [
    kind
    for kind in FaultKind
    if kind not in (FaultKind.HALF_LINE, FaultKind.WRONG_LENGTH, FaultKind.CORRUPT)
]
FAULTS_S = 60.0


@pytest.mark.parametrize("service", ["auto", "pbm"])
def test_answers_arrive_at_most_once_whatever_goes_wrong(
    service: str, count: Callable[[int], int]
) -> None:
    config = EvologicsConfig(service=service, busy_s=4.0)  # type: ignore[arg-type]
    for seed in range(count(1000)):
        rng = random.Random(seed)
        rates: dict[FaultKind, float] = {kind: rng.choice([0.0, 0.05, 0.2]) for kind in SPARING}
        rates |= dict.fromkeys((FaultKind.RESET, FaultKind.DROP_CONNECTION), 0.005)
        if rng.random() < 0.5:  # a repetition behind other sounds is a message like any other
            rates[FaultKind.DUPLICATE] = 0.0
        else:
            rates[FaultKind.LATE] = 0.0
        plan = FaultPlan(seed=seed, until_s=FAULTS_S, rates=rates)
        fleet = EmulatedFleet(scenario_of(2, spacing_m=500.0, seed=seed), faults=plan)
        sea = Sea(fleet.scenario, fleet=fleet)
        sea[2].dialogue = AtDialogue(config, node_address=2, is_serial=False)
        sea.cut(2)
        exchange(sea, rng)
        sea.run(100.0)
        for node in sea.nodes.values():
            told = f"seed {seed}, node {node.address}"
            heard = [each.frame_bytes for each in node.frames]
            assert len(heard) == len(set(heard)), told
            ids = [each.transmission_id for each in node.reports]
            assert sorted(ids) == list(range(1, node.transmissions + 1)), told
            assert node.is_ready, told
            assert node.dialogue.poll_timeout() is None, told


def exchange(sea: Sea, rng: random.Random) -> None:
    """The first asks for a minute, the second answers what it hears, most of it at once."""
    numbers = itertools.count(1)
    while sea.now < seconds_to_ns(FAULTS_S):
        heard = len(sea[2].frames)
        if sea[1].is_ready:
            sea.transmit(1, b"question %d" % next(numbers), 2, acknowledge=True)
        for _ in range(100):
            sea.run(0.02)
            if len(sea[2].frames) > heard:
                break
        sea.run(rng.choice([0.0, 0.0, 0.05, 0.1]))
        if sea[2].is_ready:
            sea.transmit(2, b"answer %d" % next(numbers) + bytes(rng.randrange(40)), 1)
        sea.run(rng.uniform(0.1, 4.0))


def owing(modem: ScriptedModem | None = None, config: EvologicsConfig | None = None) -> Bench:
    """A dialogue whose modem is about to acknowledge something to 2, as it has told before."""
    bench = Bench(modem, config)
    bench.make_ready()
    for number in range(2):
        bench.modem.say(
            RecvIm(
                payload=b"%d" % number, source=2, destination=1, flag=ImFlag.ACK,
                duration_us=200_000, rssi_db=-40, integrity=120, velocity_m_s=0.0,
            )
        )  # fmt: skip
        if not number:
            bench.modem.say(SendStart(destination=2, kind="ack", duration_us=1000, delay_us=0))
            bench.run(1.0)
    return bench


def say_answer(bench: Bench) -> None:
    """The modem tells of its acknowledgement."""
    modem = bench.modem
    modem.say(SendStart(destination=2, kind="ack", duration_us=300_000, delay_us=0))
    clock_us = modem.clock_us
    end = SendEnd(destination=2, kind="ack", clock_us=clock_us, duration_us=300_000)
    bench.after(0.3, lambda: modem.say(end))


def test_sound_and_silence_behind_the_order_to_forget_prove_that_it_has_left() -> None:
    bench = owing()
    bench.transmit(b"with it", 2)
    bench.run(0.05)
    say_answer(bench)
    bench.run(1.0)
    (report,) = bench.reports
    assert report.outcome is SENT
    assert report.detail.startswith("SENDEND,2,ack,")
    assert bench.modem.names()[-3:] == ["*SENDPBM", "Z", "?ZX"]


def test_silence_behind_an_order_whose_answer_is_lost_proves_nothing() -> None:
    """The modem may have said with the answer that the message had not left."""
    bench = owing()
    bench.transmit(b"with it", 2)
    bench.run(0.05)
    bench.modem.answers["Z"] = [None]
    say_answer(bench)
    bench.run(9.0)
    (report,) = bench.reports
    assert (report.outcome, report.detail) == (ABORTED, "ATZ3: OK")


def test_modem_that_says_nothing_proves_nothing() -> None:
    bench = owing()
    bench.transmit(b"with what?", 2)
    bench.run(5.0)
    (report,) = bench.reports
    assert (report.outcome, report.detail) == (ABORTED, "ATZ3: OK")
    assert bench.dialogue.state is State.READY


def test_word_of_an_earlier_one_is_not_taken_for_that_of_one_that_has_left() -> None:
    bench = owing()
    bench.transmit(b"with it", 2)
    bench.run(0.05)
    say_answer(bench)
    bench.run(0.1)
    bench.modem.say(CanceledPbm(2))
    bench.run(3.0)
    (report,) = bench.reports
    assert (report.outcome, report.detail) == (ABORTED, "CANCELEDPBM,2")
    assert len(bench.modem.sent) == 0


@pytest.mark.parametrize("refusal", ["ERROR UNKNOWN COMMAND", "BUSY BACKOFF STATE"])
def test_refused_piggyback_message_goes_as_instant_message_at_once(refusal: str) -> None:
    bench = owing()
    bench.modem.answers["*SENDPBM"] = [refusal]
    bench.transmit(b"then so", 2)
    bench.run(2.0)
    (report,) = bench.reports
    assert (report.outcome, len(bench.modem.sent)) == (SENT, 1)


def test_unanswered_piggyback_message_is_never_given_again() -> None:
    bench = owing()
    bench.modem.answers["*SENDPBM"] = [None]
    bench.transmit(b"once", 2)
    bench.run(10.0)
    (report,) = bench.reports
    assert report.outcome is ABORTED
    assert report.detail.startswith("no answer; then ATZ3: ")
    assert bench.modem.names().count("*SENDPBM") == 1
    assert len(bench.modem.sent) == 0


def test_what_comes_too_late_is_taken_back_and_goes_by_itself() -> None:
    bench = owing()
    bench.transmit(b"late", 2)
    say_answer(bench)  # before the modem says that it takes the message
    bench.until(lambda: bench.modem.names()[-1] == "Z")
    bench.run(0.006)
    bench.modem.say(CanceledPbm(2))
    bench.run(2.0)
    (report,) = bench.reports
    assert report.outcome is SENT
    assert report.detail.startswith("SENDEND,2,im,")
    assert len(bench.modem.sent) == 1


def test_what_may_be_left_of_one_is_dropped_before_the_next() -> None:
    bench = Bench(config=EvologicsConfig(service="pbm", busy_s=0.5))
    bench.make_ready()
    bench.modem.answers["Z"] = [None] * 20
    assert bench.send(b"waits", 2).outcome is ABORTED
    del bench.modem.answers["Z"]
    bench.transmit(b"next", 2)
    bench.run(0.05)
    assert bench.modem.names()[-2:] == ["Z", "*SENDPBM"]
