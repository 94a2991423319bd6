"""The distribution of numbers in a few figures, for a table."""

import msgspec


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """The distribution of numbers."""

    count: int
    """Number of values."""
    mean: float
    """Their mean."""
    p50: float
    """Their median."""
    p95: float
    """95th percentile."""
    least: float
    """The smallest."""
    greatest: float
    """The largest."""


def spread_of(numbers: list[float]) -> Spread | None:
    """Return the distribution of numbers; None: there are none."""
    if not numbers:
        return None
    ordered = sorted(numbers)
    last = len(ordered) - 1
    return Spread(
        count=len(ordered),
        mean=sum(ordered) / len(ordered),
        p50=ordered[min(last, len(ordered) * 50 // 100)],
        p95=ordered[min(last, len(ordered) * 95 // 100)],
        least=ordered[0],
        greatest=ordered[-1],
    )
