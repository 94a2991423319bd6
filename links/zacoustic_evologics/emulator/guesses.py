"""A family of guesses at what a modem does with burst data, drawn by seed.

No source describes it, so a driver that is good with one guess may be bad with the modem. Each seed
gives other bit rates for an SNR, other trains, connections that stay or close, back-offs, buffers,
and another fate of an instant message while a train is under way. A driver should be good over all
of them.
"""

import random
from typing import Final

import msgspec

from zacoustic_evologics.emulator.hardware.chassis import Behaviour

_RATES_BPS: Final = (31_200, 13_900, 9200, 6900, 4000, 2400)
"""Bit rates that captures, data sheets and other models of the modem have."""


class BurstGuess(msgspec.Struct, frozen=True, kw_only=True):
    """One guess: how all modems of a fleet behave, and how they are set."""

    behaviour: Behaviour
    """Choices where sources disagree."""
    settings: dict[str, int]
    """Settings that differ from the factory's, by name."""


def burst_guess(seed: int) -> BurstGuess:
    """Return the guess of a seed; the same for the same seed."""
    rng = random.Random(f"zacoustic/evologics/burst/{seed}")
    fast, slow = sorted(rng.sample(_RATES_BPS, 2), reverse=True)
    behaviour = Behaviour(
        burst_rates_bps=((rng.uniform(20.0, 35.0), fast), (-1000.0, slow)),
        train_s=rng.choice((0.75, 1.5, 2.0, 4.0, 7.5)),
        hold_s=rng.choice((0.0, 0.0, 5.0, 120.0)),
        backoff_share=rng.choice((0.3, 1.0, 3.0)),
        im_in_train=rng.choice(("taken", "queued", "refused")),
        second_im=rng.choice(("busy", "cancel")),
        while_receiving=rng.choice(("busy", "wait")),
    )
    settings = {
        "L": 0,
        "ZC": rng.choice((1, 3, 10, 32)),
        "ZL": rng.choice((8096, 16_384, 65_536)),
        "RC": rng.choice((2, 3, 5)),
    }
    return BurstGuess(behaviour=behaviour, settings=settings)
