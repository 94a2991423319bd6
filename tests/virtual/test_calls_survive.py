"""Calls survive the sea and the death of either end: each runs once at most, and ends once."""

from collections.abc import Callable

import pytest

from tests.virtual.callload import carry_calls
from tests.virtual.callscenario import CallScenario
from zacoustic.core.peers.peer import Peer
from zacoustic.core.transport.calls.answering import Answering
from zacoustic.core.wire.calls import CallKey, CallKind

BLOCKS = range(10)


@pytest.mark.parametrize("number", BLOCKS)
def test_all_holds_in_any_scenario(count: Callable[[int], int], number: int) -> None:
    for seed in range(number, count(2000), len(BLOCKS)):
        violations = CallScenario(seed).run()
        assert not violations, f"{len(violations)} complaints, {violations[0]}"


def test_scenarios_are_as_bad_as_they_promise() -> None:
    scenarios = [CallScenario(seed) for seed in range(100)]
    faults = [drawn.network.scenario.faults for drawn in scenarios]
    links = [link for drawn in scenarios for link in drawn.network.scenario.links]
    assert max(link.loss.frame for link in links if link.loss) > 0.55
    assert max(len(spec.at_s) for each in faults for spec in each.crashes) == 10
    assert max(each.to_s - each.from_s for fault in faults for each in fault.blackouts) > 1500
    assert {len(drawn.network.addresses) for drawn in scenarios} == {2, 3, 4}


def test_scenarios_tell_of_every_outcome() -> None:
    outcomes: set[str] = set()
    for seed in (0, 3, 11):
        drawn = CallScenario(seed)
        drawn.run()
        outcomes |= set(drawn.outcomes)
    assert outcomes == {"response", "HANDLER", "TIMED_OUT", "UNKNOWN", "refused"}


def test_a_thousand_calls_at_30_percent_loss_and_2_s_delay(count: Callable[[int], int]) -> None:
    for seed in range(count(20)):
        load = carry_calls(seed, calls=1000, loss=0.3, delay_s=2.0)
        assert max(load.executed.values()) == 1, f"seed {seed}"
        assert len(load.answered) >= 999, f"seed {seed}: {load.failed}"
        assert len(load.answered) + len(load.failed) == 1000


# What the scenarios are there to find: they do when it is left out.


def _answers_of_any_life(monkeypatch: pytest.MonkeyPatch) -> None:
    always = property(lambda self: True, lambda self, value: None)
    monkeypatch.setattr(Peer, "knows_us", always, raising=False)
    monkeypatch.setattr(
        "zacoustic.core.transport.calls.services.decode_name",
        lambda content, epoch: CallKind(content[0] >> 6) if content else None,
    )


def _forgotten_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    confirmed = Answering.confirmed

    def forget(self: Answering, key: CallKey, now: int) -> None:
        confirmed(self, key, now)
        served = self._calls.get(key)
        if served is not None:
            self._calls.forget(served, now)

    monkeypatch.setattr(Answering, "confirmed", forget)


def _nothing_recovered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Answering, "recover", lambda self, stored: None)


@pytest.mark.parametrize(
    ("break_it", "expected", "first"),
    [
        (_answers_of_any_life, "is answered with", 116),
        (_forgotten_at_once, "is executed again", 4),
        (_nothing_recovered, "is executed again", 16),
    ],
)
def test_scenarios_find_what_is_wrong(
    monkeypatch: pytest.MonkeyPatch,
    break_it: Callable[[pytest.MonkeyPatch], None],
    expected: str,
    first: int,
) -> None:
    break_it(monkeypatch)
    for seed in range(first, first + 100):
        if any(expected in line for line in CallScenario(seed).run()):
            return
    raise AssertionError(f'no scenario reports that something "{expected}"')
