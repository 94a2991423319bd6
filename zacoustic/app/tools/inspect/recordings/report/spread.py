"""The distribution of numbers in a few figures, for a table."""

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator

import msgspec

from zacoustic.app.tools.inspect.recordings.facts.facts import Number
from zacoustic.app.tools.inspect.recordings.facts.rows import Rows, in_order


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
    return _spread(sorted(numbers), len(numbers)) if numbers else None


def spreads_of(*rows: Rows[Number]) -> dict[tuple[int, int, int], Spread]:
    """Return the distribution of each quantity in rows: `what`, `source`, `node`."""
    counts = Counter(map(_owner, itertools.chain.from_iterable(rows)))
    ordered = in_order(Number, itertools.chain.from_iterable(rows))
    groups = itertools.groupby(ordered, _owner)
    return {key: _spread((row.number for row in each), counts[key]) for key, each in groups}


def _owner(row: Number) -> tuple[int, int, int]:
    return row.what, row.source, row.node


def _spread(ordered: Iterable[float], count: int) -> Spread:
    last = count - 1
    places = (min(last, count * 50 // 100), min(last, count * 95 // 100), 0, last)
    found: dict[int, float] = {}

    def noted() -> Iterator[float]:
        for place, number in enumerate(ordered):
            if place in places:
                found[place] = number
            yield number

    mean = sum(noted()) / count
    p50, p95, least, greatest = (found[place] for place in places)
    return Spread(count=count, mean=mean, p50=p50, p95=p95, least=least, greatest=greatest)
