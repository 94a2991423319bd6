"""How numbers are spread: the few figures that a table of a report has of many."""

import msgspec


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """How numbers are spread."""

    count: int
    """How many."""
    mean: float
    """Their mean."""
    p50: float
    """Their median."""
    p95: float
    """95th percentile."""
    least: float
    """The least."""
    greatest: float
    """The greatest."""


def spread_of(numbers: list[float]) -> Spread | None:
    """Return how numbers are spread; None without any."""
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
