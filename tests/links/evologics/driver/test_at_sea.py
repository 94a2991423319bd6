"""Drivers on emulated modems, in virtual time."""

import random
from collections.abc import Callable

import pytest

from tests.links.evologics.driver.sea import Sea, outcomes
from zacoustic.core.clock import NS_PER_S, ns_to_seconds, seconds_to_ns
from zacoustic.core.linktypes import LinkState, TransmitOutcome
from zacoustic_evologics.airtime import GAP_S
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.emulator import (
    Behaviour,
    EmulatedFleet,
    FaultKind,
    FaultPlan,
    ScriptedFault,
    scenario_of,
)

SENT, DELIVERED, NOT_DELIVERED, ABORTED = (
    TransmitOutcome.SENT,
    TransmitOutcome.DELIVERED,
    TransmitOutcome.NOT_DELIVERED,
    TransmitOutcome.ABORTED,
)
FAULTS_S = 60.0
PORTS = [(Interpreter.NET, False), (Interpreter.AT, True)]


@pytest.mark.parametrize("interpreter", Interpreter)
@pytest.mark.parametrize("is_serial", [False, True])
def test_two_drivers_exchange_frames_with_one_report_each(
    interpreter: Interpreter, is_serial: bool
) -> None:
    sea = Sea(
        scenario_of(2, spacing_m=1500.0),
        interpreter=interpreter,
        is_serial=is_serial,
        config=EvologicsConfig(mtu=1024),
    )
    sea.make_ready()
    expected: dict[int, list[bytes]] = {1: [], 2: []}
    for source, to in ((1, 2), (2, 1)):
        for content, destination, acknowledge, outcome in (
            (b"all", 255, False, SENT),
            (bytes(64), to, False, SENT),
            (b"a,b\r\n+++AT", to, True, DELIVERED),
            (bytes(range(256)) * 2, to, True, DELIVERED),
        ):
            report = sea.send(source, content, destination, acknowledge=acknowledge)
            assert report.outcome is outcome, report
            expected[to].append(content)
            sea.run(3.0)
    sea.run(120.0)
    for node in sea.nodes.values():
        assert [each.frame_bytes for each in node.frames] == expected[node.address]
        assert len(node.reports) == 4
        assert node.dialogue.poll_timeout() is None
        assert node.carrier[-1] is False
        told = node.dialogue.diagnostics()
        assert told[f"peer_{3 - node.address}_range_m"] == pytest.approx(1500.0, rel=0.01)
        assert told["stray_replies"] == told["missed_replies"] == 0


def test_full_message_with_acknowledgement_takes_the_published_time() -> None:
    sea = Sea(scenario_of(2, spacing_m=1500.0))
    sea.make_ready()
    report = sea.send(1, bytes(64), 2, acknowledge=True)
    assert ns_to_seconds(report.finished_at - report.started_at) == pytest.approx(3.1, abs=0.05)


def test_instant_messages_go_as_fast_as_the_published_timing_permits() -> None:
    sea = Sea(scenario_of(2, spacing_m=300.0))
    sea.make_ready()
    began_at, count = sea.now, 100
    for number in range(count):
        assert sea.send(1, bytes([number]) * 64, 2).outcome is SENT
        sea.run(GAP_S)
    sea.run(1.0)
    assert len(sea[2].frames) == count
    lasted_s = ns_to_seconds(sea.now - began_at) - 1.0
    assert count * 64 * 8 / lasted_s > 0.95 * 539


def test_absent_modem_does_not_acknowledge() -> None:
    sea = Sea(scenario_of(2, spacing_m=1500.0))
    sea.make_ready()
    report = sea.send(1, b"anybody?", 9, acknowledge=True)
    assert (report.outcome, report.detail) == (NOT_DELIVERED, "FAILEDIM,9")


def test_both_at_once_collide_and_are_both_reported() -> None:
    sea = Sea(scenario_of(2, spacing_m=1500.0))
    sea.make_ready()
    for source, to in ((1, 2), (2, 1)):
        sea.transmit(source, bytes(64), to, acknowledge=True)
    sea.run(30.0)
    assert [len(node.reports) for node in sea.nodes.values()] == [1, 1]
    for node in sea.nodes.values():
        assert sea.send(node.address, b"then", 3 - node.address, acknowledge=True).outcome in (
            DELIVERED,
            NOT_DELIVERED,
        )
        sea.run(3.0)


@pytest.mark.parametrize("interpreter", Interpreter)
@pytest.mark.parametrize("is_serial", [False, True])
def test_modem_that_restarts_is_found_again(interpreter: Interpreter, is_serial: bool) -> None:
    plan = FaultPlan(script=(ScriptedFault(kind=FaultKind.RESET, at_s=10.0, modem=1),))
    fleet = EmulatedFleet(scenario_of(2, spacing_m=300.0), interpreter=interpreter, faults=plan)
    sea = Sea(fleet.scenario, fleet=fleet, is_serial=is_serial)
    sea.make_ready()
    sea.run(9.7)
    sea.transmit(1, bytes(64), 2)
    sea.until(lambda: sea[1].reports)
    assert sea[1].reports[0].outcome is ABORTED
    sea.until(lambda: sea[1].is_ready, 20.0)
    assert LinkState.DOWN in [state for _, state, _ in sea[1].changes]
    assert sea.send(1, b"back", 2, acknowledge=True).outcome is DELIVERED


DAMAGING = (FaultKind.HALF_LINE, FaultKind.WRONG_LENGTH, FaultKind.CORRUPT)
KINDS: list[FaultKind] = [kind for kind in FaultKind if kind not in (FaultKind.CORRUPT,)]


@pytest.mark.parametrize(("interpreter", "is_serial"), PORTS)
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.value)
def test_each_fault_alone_loses_no_report_and_invents_none(
    kind: FaultKind, interpreter: Interpreter, is_serial: bool
) -> None:
    for seed in range(4):
        rates = {kind: 0.02 if kind in (FaultKind.RESET, FaultKind.DROP_CONNECTION) else 0.25}
        voyage(seed, rates, interpreter=interpreter, is_serial=is_serial)


def test_all_faults_together_lose_no_report_and_invent_none(count: Callable[[int], int]) -> None:
    for seed in range(count(4000)):
        rng = random.Random(seed)
        rates: dict[FaultKind, float] = {kind: rng.choice([0.0, 0.02, 0.1]) for kind in KINDS}
        rates[FaultKind.RESET] = rates[FaultKind.DROP_CONNECTION] = 0.005
        interpreter, is_serial = PORTS[seed % 2]
        voyage(seed, rates, interpreter=interpreter, is_serial=is_serial)


def voyage(
    seed: int, rates: dict[FaultKind, float], *, interpreter: Interpreter, is_serial: bool
) -> None:
    """Two drivers send at random while things go wrong; then all must be well again."""
    rng = random.Random(seed)
    plan = FaultPlan(seed=seed, until_s=FAULTS_S, rates=rates)
    fleet = EmulatedFleet(
        scenario_of(2, spacing_m=500.0, seed=seed),
        interpreter=interpreter,
        faults=plan,
        behaviour=Behaviour(),
    )
    config = EvologicsConfig(mtu=1024)
    sea = Sea(fleet.scenario, fleet=fleet, config=config, is_serial=is_serial)
    sent: dict[int, dict[int, bytes]] = {1: {}, 2: {}}
    number = 0
    while sea.now < seconds_to_ns(FAULTS_S):
        for node in sea.nodes.values():
            if node.is_ready and rng.random() < 0.6:
                number += 1
                size = rng.choice([4, 20, 64, 64, 200])
                content = number.to_bytes(4, "big") + rng.randbytes(size - 4)
                transmission_id = sea.transmit(
                    node.address, content, 3 - node.address, acknowledge=rng.random() < 0.5
                )
                sent[node.address][transmission_id] = content
        sea.run(rng.uniform(0.1, 4.0))
    ended_at = sea.now
    told = f"seed {seed}: {rates}"
    sea.run(5.0 + Behaviour().restart_s)
    for node in sea.nodes.values():
        is_up = [state for _, state, _ in node.changes if state is not LinkState.OPENING][-1:]
        assert is_up == [LinkState.UP], f"{told}: {sea.voyage()}"
    sea.run(90.0)
    for node in sea.nodes.values():
        far = sea[3 - node.address]
        ids = sorted(each.transmission_id for each in node.reports)
        assert ids == sorted(sent[node.address]), f"{told}: {outcomes(node)}"
        heard = [each.frame_bytes for each in far.frames]
        # On a port without check, what is damaged inside of a record can look like another one.
        if not any(rates.get(kind) for kind in DAMAGING):
            assert set(heard) <= set(sent[node.address].values()), f"{told}: altered"
        # A repetition that comes behind other sounds is one like any other.
        if not (rates.get(FaultKind.DUPLICATE) and rates.get(FaultKind.LATE)):
            assert len(heard) == len(set(heard)), f"{told}: twice"
        assert node.is_ready, told
        assert node.dialogue.poll_timeout() is None, told
    assert ended_at < sea.now
    for source, to in ((1, 2), (2, 1)):
        report = sea.send(source, b"all is well", to, acknowledge=True)
        assert report.outcome is DELIVERED, f"{told}: {report}"
        sea.run(5.0)
    assert sea.now < 400 * NS_PER_S
