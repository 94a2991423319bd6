"""Two ends whose tables differ never deliver a wrongly decoded sample, and what agrees goes on.

Whichever frames are lost or come twice, whichever side restarts, at any MTU, on links that lack
addresses, check or frames. A frame that comes twice does so within the settling time, four of the
longest frames; without a bound a sample of one byte's overhead cannot be told from one of a former
life.
"""

import random
from collections.abc import Callable

import pytest

from tests.virtual.fleet import Trial
from zacoustic.testing.virtual import Modem

MODEMS = (
    Modem(),
    Modem(addressed=False),
    Modem(checked=False),
    Modem(framed=False),
    Modem(addressed=False, checked=False, framed=False),
    Modem(senses_carrier=False),
)
BLOCKS = range(10)


def block(number: int, share: int) -> range:
    """Return the seeds of one of ten blocks of a scenario's seeds."""
    return range(number, share, len(BLOCKS))


def tell(trial: Trial, seed: int, settings: object) -> None:
    trial.run()
    drawn = f"seed {seed}, {settings}"
    assert not trial.wrong, f"{drawn}: {trial.wrong[0]}"
    assert not trial.missing(), f"{drawn}: {trial.missing()}"
    assert trial.delivered, drawn


@pytest.mark.parametrize("number", BLOCKS)
@pytest.mark.parametrize("repeat", [0.0, 0.4])
def test_nothing_is_misread_and_what_agrees_goes_on(
    count: Callable[[int], int], repeat: float, number: int
) -> None:
    for seed in block(number, count(400)):
        rng = random.Random(f"settings {seed}")
        nodes = rng.choice((2, 2, 2, 3, 4))
        mtu_bytes = rng.choice((8, 11, 16, 24, 32, 64))
        modem = rng.choice(MODEMS)
        # Many nodes that do not hear each other's carrier need longer to say what differs.
        calm_s = 1500.0 if nodes == 2 else 4000.0
        trial = Trial(
            seed, nodes=nodes, mtu_bytes=mtu_bytes, modem=modem, repeat=repeat, calm_s=calm_s
        )
        tell(trial, seed, (nodes, mtu_bytes, modem, repeat))


@pytest.mark.parametrize("number", BLOCKS)
def test_nothing_is_misread_in_a_storm_of_restarts(
    count: Callable[[int], int], number: int
) -> None:
    for seed in block(number, count(600)):
        rng = random.Random(f"storm {seed}")
        nodes = rng.choice((2, 2, 3))
        mtu_bytes, repeat = rng.choice((8, 16, 64)), rng.choice((0.0, 0.5, 0.9))
        trial = Trial(
            seed,
            nodes=nodes,
            mtu_bytes=mtu_bytes,
            repeat=repeat,
            fault_s=150,
            calm_s=0,
            change=rng.choice((0.1, 0.4)),
            most_restarts=8,
        )
        trial.run()
        assert not trial.wrong, f"seed {seed}: {trial.wrong[0]}"


@pytest.mark.parametrize("number", BLOCKS)
def test_nothing_is_misread_when_frames_are_damaged(
    count: Callable[[int], int], number: int
) -> None:
    for seed in block(number, count(200)):
        rng = random.Random(f"damage {seed}")
        modem = rng.choice(
            (Modem(checked=False), Modem(checked=False, framed=False, addressed=False))
        )
        # Three frames in ten stay damaged: questions and answers get lost, and their pauses double.
        trial = Trial(seed, modem=modem, corrupt=0.3, calm_s=6000.0)
        tell(trial, seed, modem)
