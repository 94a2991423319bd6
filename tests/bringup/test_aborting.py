"""When the mission is aborted, and how often: with the instants as arguments."""

import importlib
from collections.abc import Callable
from typing import Any

import pytest


class Mission:
    """Counts what it is asked; answers at once if it has an answer."""

    def __init__(self, clock: list[float]) -> None:
        self.asked = 0
        self.answer: tuple[bool, str] | None = None
        self.clock = clock
        self.answered: Callable[[bool, str, float], None]

    def ask(self) -> None:
        self.asked += 1
        if self.answer is not None:
            self.answered(*self.answer, self.clock[0])


@pytest.fixture
def mission() -> Mission:
    return Mission([0.0])


@pytest.fixture
def aborting(mission: Mission) -> Any:
    made = importlib.import_module("zacoustic_bringup.aborting").Aborting(mission.ask, timeout_s=10)
    mission.answered = made.answered
    return made


def test_the_first_call_asks_and_a_later_one_is_told(mission: Mission, aborting: Any) -> None:
    assert aborting.lost(0) == (False, "asked; no answer yet")
    assert aborting.lost(1) == (False, "asked; no answer yet")
    assert mission.asked == 1
    aborting.answered(True, "surfacing", 2)
    assert aborting.lost(3) == (True, "surfacing")
    assert aborting.lost(4)[0] is False  # another loss
    assert mission.asked == 2


def test_it_asks_again_after_a_refusal_and_after_silence(mission: Mission, aborting: Any) -> None:
    aborting.lost(0)
    aborting.answered(False, "no air", 1)
    assert aborting.lost(2) == (False, "no air; asked again")
    assert aborting.lost(11) == (False, "asked; no answer yet")
    assert aborting.lost(12) == (False, "no answer in 10 s; asked again")
    assert mission.asked == 3
    aborting.answered(True, "late", 40)
    assert aborting.lost(41) == (True, "late")


def test_an_answer_at_once_is_told_at_once(mission: Mission, aborting: Any) -> None:
    mission.answer = (False, "nobody subscribes")
    assert aborting.lost(0) == (False, "nobody subscribes")
    mission.answer = (True, "published")
    assert aborting.lost(1) == (True, "published")


def test_an_answer_that_nobody_fetched_does_not_count_for_the_next_loss(
    mission: Mission, aborting: Any
) -> None:
    aborting.lost(0)
    aborting.answered(True, "surfacing", 1)  # contact is back before the gateway calls again
    assert aborting.lost(100)[0] is False
    assert mission.asked == 2


def watch_of(aborting: Any) -> Any:
    return importlib.import_module("zacoustic_bringup.aborting").GatewayWatch(aborting, 120, 0)


def test_a_gateway_that_is_gone_is_a_loss_once(mission: Mission, aborting: Any) -> None:
    watch = watch_of(aborting)
    said = [watch.look(at < 50, at) for at in range(169)]
    assert not any(said)
    assert mission.asked == 0
    assert "gone for 120 s: not aborted yet" in watch.look(False, 169)
    aborting.answered(True, "surfacing", 170)
    assert "aborted: surfacing" in watch.look(False, 171)
    assert not any(watch.look(False, at) for at in range(172, 2000))
    assert mission.asked == 1
    assert watch.look(True, 2000) == ""  # armed again
    assert not watch.look(False, 2119)
    assert watch.look(False, 2120)
    assert mission.asked == 2


def test_a_gateway_that_never_came_is_one_that_is_gone(mission: Mission, aborting: Any) -> None:
    watch = watch_of(aborting)
    assert not watch.look(False, 119)
    assert watch.look(False, 120)
    assert mission.asked == 1


def test_a_gateway_that_is_there_is_none(mission: Mission, aborting: Any) -> None:
    watch = watch_of(aborting)
    assert not any(watch.look(at % 100 == 0, at) for at in range(5000))
    assert mission.asked == 0
