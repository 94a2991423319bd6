"""Confidence intervals of a mean: Student's t, exact, without tables.

Figures of one cell differ by their seeds, which are independent; their mean over n seeds lies
within ± t · s / √n with the wanted confidence, s being the sample's standard deviation and t the
quantile of Student's distribution with n − 1 degrees of freedom. For few seeds of a figure that is
far from normal, such as a share near 1, the true confidence is somewhat less.
"""

import functools
import math
import statistics
from collections.abc import Sequence

import msgspec

_STEPS = 200  # of a bisection: enough for all bits of a float


class Interval(msgspec.Struct, frozen=True, kw_only=True):
    """A mean with its confidence interval."""

    count: int
    """Number of seeds."""
    mean: float
    """Mean over the seeds."""
    low: float | None
    """Lower end; None: one seed gives no interval."""
    high: float | None
    """Upper end."""


def interval_of(numbers: Sequence[float], confidence: float) -> Interval | None:
    """Return the interval of the mean; None if there is no number.

    Args:
        numbers: A figure, once for each seed.
        confidence: Confidence, between 0 and 1.
    """
    if not numbers:
        return None
    mean = statistics.fmean(numbers)
    if len(numbers) == 1:
        return Interval(count=1, mean=mean, low=None, high=None)
    spread = statistics.stdev(numbers) / math.sqrt(len(numbers))
    half = student_t(confidence, len(numbers) - 1) * spread
    return Interval(count=len(numbers), mean=mean, low=mean - half, high=mean + half)


@functools.cache
def student_t(confidence: float, degrees: int) -> float:
    """Return the two-sided quantile of Student's distribution.

    Args:
        confidence: Probability between −t and t, above 0, below 1.
        degrees: Degrees of freedom, ≥ 1.
    """
    low, high = 0.0, math.pi / 2
    for _ in range(_STEPS):
        middle = (low + high) / 2
        if _probability(middle, degrees) < confidence:
            low = middle
        else:
            high = middle
    return math.tan(low) * math.sqrt(degrees)


def _probability(angle: float, degrees: int) -> float:
    """Return the probability of |t| < √degrees · tan(angle), a finite sum for whole degrees."""
    sine, square = math.sin(angle), math.cos(angle) ** 2
    is_odd = degrees % 2
    term = sine * math.cos(angle) if is_odd else sine
    total = 0.0
    for step in range((degrees - 1 if is_odd else degrees) // 2):
        total += term
        below = 2 * step + 3 if is_odd else 2 * step + 2
        term *= square * (below - 1) / below
    return 2 / math.pi * (angle + total) if is_odd else total
