"""Variation of the level between fixed nodes: slow shadowing and a fast fade, drawn per frame.

*Shadowing*: waves, internal waves and drift of the nodes change the paths slowly. In dB it is
Gaussian, and its autocorrelation falls as exp(−Δt / τ). Sampled at frames with any spacing, that is
a first-order recursion (``x ← ρ x + √(1 − ρ²) z``, ρ = exp(−Δt / τ)).

*Fast fade*: one steady path and many scattered ones add up with random phases, which is Rician with
factor K, the steady power over the scattered. One gain holds for a frame (block fading); the next
frame, some delay and gap later, meets a new one.

Both forms were validated on four experiments by P. Qarabaqi and M. Stojanovic, IEEE J. Oceanic Eng.
38 (2013) 701.
"""

import functools
import math
import random
import statistics
from typing import Final

import msgspec

from zacoustic.channel.propagation.randomness import gaussian_pair

_NS_PER_S: Final = 1_000_000_000
_GRID: Final = 16  # quantiles along each of three axes: 4096 fades
_QUANTILES: Final = 128  # of those 4096, in equal shares


class Fading(msgspec.Struct, frozen=True, kw_only=True):
    """Statistics of the level around its mean."""

    k_factor: float
    """Power of the steady path over that of the scattered ones, a ratio, ≥ 0; 0 is Rayleigh."""
    shadowing_db: float
    """Standard deviation of the slow part, dB, ≥ 0."""
    shadowing_time_s: float
    """Time in which the slow part's autocorrelation falls to 1/e, s, > 0."""


class FadingProcess:
    """The fades of one sender's frames on their way to one node.

    Args:
        fading: Statistics.
        rng: Generator of this direction; each frame draws four numbers.
    """

    def __init__(self, fading: Fading, rng: random.Random) -> None:
        self._rng = rng
        self._sigma_db = fading.shadowing_db
        self._rate_per_ns = 1.0 / (fading.shadowing_time_s * _NS_PER_S)
        self._steady = math.sqrt(fading.k_factor / (fading.k_factor + 1.0))
        self._scatter = math.sqrt(0.5 / (fading.k_factor + 1.0))
        self._slow = 0.0
        self._slow_at: int | None = None

    def next_gain_db(self, now: int) -> float:
        """Return the gain of a frame over the mean, dB.

        Args:
            now: Instant of the frame's start, ns, not before that of the previous frame.
        """
        slow, in_phase = gaussian_pair(self._rng)
        quadrature, _ = gaussian_pair(self._rng)
        if self._slow_at is None:
            self._slow = slow
        else:
            memory = math.exp((self._slow_at - now) * self._rate_per_ns)
            self._slow = memory * self._slow + math.sqrt(1.0 - memory * memory) * slow
        self._slow_at = now
        real = self._steady + self._scatter * in_phase
        imaginary = self._scatter * quadrature
        power = real * real + imaginary * imaginary
        return self._sigma_db * self._slow + 10.0 * math.log10(power or 1e-30)


@functools.lru_cache(maxsize=16)
def fade_quantiles_db(fading: Fading) -> tuple[float, ...]:
    """Return equally likely gains over the mean, dB, rising: to average without drawing.

    Args:
        fading: Statistics; the shadowing time does not matter.

    Returns:
        128 values; averages over them are good to about 1 % of a probability between 0.02 and 0.98.
    """
    middles = [(index + 0.5) / _GRID for index in range(_GRID)]
    normal = statistics.NormalDist()
    slow_db = [fading.shadowing_db * normal.inv_cdf(middle) for middle in middles]
    steady = math.sqrt(fading.k_factor / (fading.k_factor + 1.0))
    gains_db = []
    for power_share in middles:
        scattered = math.sqrt(-math.log(1.0 - power_share) / (fading.k_factor + 1.0))
        for turn in middles:
            real = steady + scattered * math.cos(math.pi * turn)
            imaginary = scattered * math.sin(math.pi * turn)
            fast_db = 10.0 * math.log10(real * real + imaginary * imaginary)
            gains_db += [fast_db + shadow for shadow in slow_db]
    gains_db.sort()
    step = len(gains_db) // _QUANTILES
    return tuple(gains_db[step // 2 :: step])
