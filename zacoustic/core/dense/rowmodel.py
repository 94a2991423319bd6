"""One sample's row of integers, coded against the row of its reference.

Symbols (flags, enums) come first: each stays as it was with a probability that follows how often it
did. Then the numbers, in the order of their number of values, so that a speed, a pitch and a
heading are known when the position is coded, which has the most values.

Three predictions are made of a number: it stays (*hold*), it goes on as it went (*trend*), and what
least squares make of everything known by then. They are mixed by how far each was off lately, to
the fourth power: a choice that is not abrupt. How far the mix was off lately is the scale of the
curve on which the number lies. A number that did not change at all has a share of its own, which
follows how often that happens: for switches, and for sensors that report the same value again.

The quantities of `leastsquares`, in this order:

1. of the reference, the level of every field that has values on both sides of zero and is not a
   position: a pitch or a rate of turn says where things are going;
2. the way that every other number makes in the steps to this sample, at the reference's velocity;
3. the number of each column less that of the reference, in coding order; before the first position,
   where the type has a heading and positions, the way north and east at the mean course and speed.

"""

from typing import Final

from zacoustic.core.dense.adaptation import (
    Adaptation,
    StreamState,
    nearest,
    new_adaptation,
    step_class,
)
from zacoustic.core.dense.arithmetic import Coder
from zacoustic.core.dense.curve import POINT_BITS, SCALE_BITS, Curve
from zacoustic.core.dense.layout import Column, Row
from zacoustic.core.dense.leastsquares import Explained
from zacoustic.core.dense.course import course_of

# A field with more values than this is a position (or the like), and its level says nothing.
_LEVEL_SIZE: Final = 1 << 13

_SCALE_SHIFT: Final = 3  # scales follow the last eight samples
_MISS_SHIFT: Final = 5  # the choice of predictions the last 32
_HOLD_SHIFT: Final = 5
_MISS_LIMIT: Final = 4  # a miss counts as at most that many scales and two steps
_LEAST_SCALE: Final = 1 << SCALE_BITS - 4
_LEAST_HOLD: Final = 200
_MOST_HOLD: Final = (1 << 16) - 1400
_MISS_BITS: Final = SCALE_BITS - POINT_BITS

_LEAST_STEADY: Final = 1 << 8
_MOST_STEADY: Final = (1 << 16) - (1 << 8)
START_STEADY: Final = (1 << 16) - (1 << 12)
"""How often a symbol of which nothing is known stays as it was, 2**-16."""


class RowModel:
    """How the rows of a stream are coded.

    Args:
        columns: Of the stream's type.
    """

    def __init__(self, columns: list[Column]) -> None:
        self.columns = columns
        self.sizes = [column.size for column in columns]
        self.symbols = [n for n, column in enumerate(columns) if not column.is_ordered]
        self.numbers = sorted(
            (n for n, column in enumerate(columns) if column.is_ordered),
            key=lambda n: (columns[n].size, n),
        )
        self._levels = [
            (n, zero)
            for n in self.numbers
            if (zero := columns[n].zero) is not None and columns[n].size <= _LEVEL_SIZE
        ]
        with_level = {n for n, _ in self._levels}
        self._ways = [n for n in self.numbers if n not in with_level]
        self._course = course_of(columns, self.numbers)
        self._course_before = self._course.before if self._course is not None else None
        self.quantities = (
            len(self._levels) + len(self._ways) + len(self.numbers) + 2 * (self._course is not None)
        )

    def start(self) -> Adaptation:
        """Make the adaptation of who knows nothing."""
        return new_adaptation(self.sizes, self.quantities)

    def code(self, coder: Coder, row: Row, reference: StreamState, steps: int) -> StreamState:
        """Write or read a row.

        Args:
            coder: Where.
            row: The row; a reader's is filled in.
            reference: The sample to code against.
            steps: How many samples (or periods) lie between, ≥ 1.

        Returns:
            The state of the sample, still with the rest of the reference.
        """
        steadiness = self._code_symbols(coder, row, reference)
        place = step_class(steps, moving=reference.velocity is not None)
        before = nearest(reference.adaptations, place) or self.start()
        velocity, learnt = self._code_numbers(coder, row, reference, before, steps)
        return StreamState(
            row=[old if new is None else new for new, old in zip(row, reference.row, strict=True)],
            velocity=velocity,
            rest=reference.rest,
            adaptations={**reference.adaptations, place: learnt},
            steadiness=steadiness,
        )

    def code_plainly(self, coder: Coder, row: Row) -> None:
        """Write or read a row with every value as likely as any other."""
        for n in (*self.symbols, *self.numbers):
            if self._is_there(n, row):
                row[n] = coder.uniform(self.sizes[n], row[n] or 0)

    def _is_there(self, n: int, row: Row) -> bool:
        guard = self.columns[n].guard
        return guard is None or row[guard[0]] == guard[1]

    def _code_symbols(self, coder: Coder, row: Row, reference: StreamState) -> list[int]:
        steadiness = reference.steadiness
        if not self.symbols:
            return steadiness
        steadiness = list(steadiness)
        for n in self.symbols:
            if not self._is_there(n, row):
                continue
            size, old, new = self.sizes[n], reference.row[n], row[n] or 0
            if old is None:
                row[n] = coder.uniform(size, new)
                continue
            steady = steadiness[n]
            if coder.flag(steady, new == old):
                row[n] = old
                steadiness[n] = min(_MOST_STEADY, steady + ((1 << 16) - steady >> _HOLD_SHIFT))
                continue
            # One of the others: those behind the old one move up.
            other = coder.uniform(size - 1, new - (new > old))
            row[n] = other + (other >= old)
            steadiness[n] = max(_LEAST_STEADY, steady - (steady >> _HOLD_SHIFT))
        return steadiness

    def _code_numbers(
        self, coder: Coder, row: Row, reference: StreamState, before: Adaptation, steps: int
    ) -> tuple[list[int], Adaptation]:
        """Write or read the numbers; gives their velocity, and what was learnt."""
        old_row = reference.row
        old_velocity = reference.velocity
        velocity = [0] * len(row)
        trends = velocity if old_velocity is None else [way * steps for way in old_velocity]
        scales, misses, holds = list(before.scales), list(before.misses), list(before.holds)
        explained = Explained(before.weights, before.energies)
        self._add_known(explained, old_row, trends)
        for n in self.numbers:
            if n == self._course_before and self._course is not None:
                for way in self._course.ways(row, old_row, steps):
                    explained.add(way, explained.predict())
            linear = explained.predict()
            old = old_row[n]
            if old is None or not self._is_there(n, row):
                if old is None and self._is_there(n, row):
                    row[n] = coder.uniform(self.sizes[n], row[n] or 0)
                explained.add(linear, linear)
                continue
            trend = trends[n]
            hold_miss, trend_miss, linear_miss = misses[n]
            least = min(hold_miss, trend_miss, linear_miss)
            hold_part = ((least << 8) // hold_miss) ** 4
            trend_part = ((least << 8) // trend_miss) ** 4
            linear_part = ((least << 8) // linear_miss) ** 4
            expected = (trend * trend_part + linear * linear_part) // (
                hold_part + trend_part + linear_part
            )
            scale, hold = scales[n], holds[n]
            size = self.sizes[n]
            if self.columns[n].wraps:
                # Seen from the reference: it is in the middle, and both ways round are near.
                half = size >> 1
                curve = Curve(size, (half << POINT_BITS) + expected, scale, half, hold << 11)
                number = coder.number(curve, ((row[n] or 0) - old + half) % size)
                change = number - half
                row[n] = (old + change) % size
            else:
                curve = Curve(size, (old << POINT_BITS) + expected, scale, old, hold << 11)
                new = row[n] = coder.number(curve, row[n] or 0)
                change = new - old
            moved = change << POINT_BITS
            velocity[n] = moved // steps
            explained.add(moved, linear)
            # Learn. A wild value must not make the curve wide for long.
            limit = _MISS_LIMIT * scale + (2 << SCALE_BITS)
            miss = abs(moved - expected) << _MISS_BITS
            scale += (min(miss, limit) - scale) >> _SCALE_SHIFT
            scales[n] = max(scale, _LEAST_SCALE)
            misses[n] = (
                _followed(hold_miss, abs(moved) << _MISS_BITS, limit),
                _followed(trend_miss, abs(moved - trend) << _MISS_BITS, limit),
                _followed(linear_miss, abs(moved - linear) << _MISS_BITS, limit),
            )
            if change:
                holds[n] = max(_LEAST_HOLD, hold - (hold >> _HOLD_SHIFT))
            elif hold > 1 << 13 or scale > 1 << SCALE_BITS + 1:
                holds[n] = min(_MOST_HOLD, hold + ((1 << 16) - hold >> _HOLD_SHIFT))
        if explained.is_broken:
            return velocity, self.start()
        weights, energies = explained.moved()
        return velocity, Adaptation(weights, energies, scales, misses, holds)

    def _add_known(self, explained: Explained, old_row: Row, trends: list[int]) -> None:
        """The quantities that are known before the sample."""
        for n, zero in self._levels:
            old = old_row[n]
            level = 0 if old is None else old - zero << POINT_BITS
            explained.add(level, explained.predict())
        for n in self._ways:
            explained.add(trends[n], explained.predict())


def _followed(mean: int, miss: int, limit: int) -> int:
    """The mean miss of a prediction, with one more."""
    return max(mean + ((min(miss, limit) - mean) >> _MISS_SHIFT), _LEAST_SCALE)
