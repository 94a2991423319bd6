"""One sample's row of integers, coded against the row of its reference.

Symbols (flags, enums) come first: each stays as it was with a probability that follows how often it
did. Then the numbers, in the order of their number of values, so that a speed, a pitch and a
heading are known when the position is coded, which has the most values.

Two predictions are made of a number: it stays (*hold*), and what least squares make of everything
known by then. They are mixed by how far each was off lately, to the fourth power: a choice that is
not abrupt. How far the mix was off lately is the scale of the curve on which the number lies, times
a width that depends on the situation: how surprising the sample has been so far, and how far the
number is expected to go. In a turn everything is less certain. A number that did not change at all
has a share of its own, which follows how often that happens: for switches, and for sensors that
report the same value again.

The quantities of `leastsquares`, in this order:

1. one, times the steps: for what drifts steadily, as a current does;
2. of the reference, the level of every field that has values on both sides of zero and is not a
   position: a pitch or a rate of turn says where things are going;
3. the way that every other number makes in the steps to this sample, at the reference's velocity;
4. the number of each column less that of the reference, in coding order; before the first position
   of a type that has a heading, what `course` says.
"""

from typing import Final

from zacoustic.core.dense.adaptation import (
    RESTING,
    SITUATIONS,
    WIDTH_BITS,
    Adaptation,
    Manner,
    StreamState,
    nearest,
    new_adaptation,
    step_class,
)
from zacoustic.core.dense.arithmetic import Coder
from zacoustic.core.dense.course import course_of
from zacoustic.core.dense.curve import LARGEST_SIZE, MOST_HOLD, POINT_BITS, SCALE_BITS
from zacoustic.core.dense.layout import Column, Row
from zacoustic.core.dense.leastsquares import Explained, Shape

# A field with more values than this is a position (or the like), and its level says nothing.
_LEVEL_SIZE: Final = 1 << 13

_SCALE_SHIFT: Final = 3  # scales follow the last eight samples
_MISS_SHIFT: Final = 5  # the choice of predictions, and the widths, the last 32
_HOLD_SHIFT: Final = 5  # how often a number stays, the last 32 as well
_MISS_LIMIT: Final = 4  # a miss counts as at most that many scales
_MISS_SPARED: Final = 2 << SCALE_BITS  # and two steps
_MISS_BITS: Final = SCALE_BITS - POINT_BITS
_LEAST_SCALE: Final = 1 << SCALE_BITS - 4
_LEAST_HOLD: Final = 200
# The share that the curve itself has for staying: of a Laplace distribution 1/(2·scale), 2**-16.
_PEAK: Final = 1 << 15 + SCALE_BITS
_SURE: Final = 60000
_NARROW: Final = _PEAK // _SURE
_LEAST_WIDTH: Final = 1 << WIDTH_BITS - 2
_MOST_WIDTH: Final = 1 << WIDTH_BITS + 4
_ONE: Final = 64 << POINT_BITS
# A sample of which a field is further off than this counts less, by the square; in 1/256 scales.
_TRUSTED_MISS: Final = 800
_LEAST_TRUST: Final = 1 << 6

_WHOLE: Final = 1 << 16
# By how many 1/256 of the other's miss that of the better prediction is: the share of the worse,
# and that of the better.
_WORSE: Final = [(part**4 << 16) // ((1 << 32) + part**4) for part in range(257)]
_BETTER: Final = [_WHOLE - share for share in _WORSE]

_LEAST_STEADY: Final = 1 << 8
_MOST_STEADY: Final = (1 << 16) - (1 << 8)
START_STEADY: Final = (1 << 16) - (1 << 12)
"""How often a symbol of which nothing is known stays as it was, 2**-16."""


class TooFarError(Exception):
    """A number of more values than a curve has is too far from its reference for this way."""


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
        self._plan = [
            # Seen from the reference where the field goes round, so that both ways are near, and
            # where it has more values than a curve can have; else from the least value.
            (n, columns[n].size, columns[n].wraps or columns[n].size > LARGEST_SIZE,
             columns[n].guard)
            for n in self.numbers
        ]  # fmt: skip
        self._levels = [
            (n, zero)
            for n in self.numbers
            if (zero := columns[n].zero) is not None and columns[n].size <= _LEVEL_SIZE
        ]
        with_level = {n for n, _ in self._levels}
        self._course = course_of(columns, self.numbers)
        positions = self._course.positions if self._course is not None else []
        self._ways = [n for n in self.numbers if n not in with_level and n not in positions]
        self._course_before = positions[0] if positions else None
        known = 1 + len(self._levels) + len(self._ways)
        on_course = 2 + len(positions) if self._course is not None else 0
        self.shape = Shape(known + len(self.numbers) + on_course)
        self.priors: dict[int, Adaptation] = {}
        """What a fit says, by `step_class`."""

    def start(self) -> Adaptation:
        """Make the adaptation of who knows nothing."""
        return new_adaptation(self.sizes, self.shape.quantities)

    def code(self, coder: Coder, row: Row, reference: StreamState, steps: int) -> StreamState:
        """Write or read a row.

        Args:
            coder: Where.
            row: The row; a reader's is filled in.
            reference: The sample to code against.
            steps: How many samples (or periods) lie between, ≥ 1.

        Returns:
            The state of the sample, still with the rest of the reference.

        Raises:
            TooFarError: The row cannot be written against this reference.
        """
        steadiness = self._code_symbols(coder, row, reference)
        place = step_class(steps, moving=reference.velocity is not None)
        before = self._adaptation(reference.adaptations, place)
        velocity, learnt = self._code_numbers(coder, row, reference, before, steps)
        return StreamState(
            row=row if None not in row else _completed(row, reference.row),
            velocity=velocity,
            rest=reference.rest,
            adaptations={**reference.adaptations, place: learnt},
            steadiness=steadiness,
        )

    def code_plainly(self, coder: Coder, row: Row) -> None:
        """Write or read a row with every value as likely as any other."""
        for n in (*self.symbols, *self.numbers):
            guard = self.columns[n].guard
            if guard is None or row[guard[0]] == guard[1]:
                row[n] = coder.uniform(self.sizes[n], row[n] or 0)

    def _adaptation(self, adaptations: dict[int, Adaptation], place: int) -> Adaptation:
        """What is known of samples at a distance: learnt, carried over, fitted, or nothing.

        Acknowledged frames lie at one distance from each other, and only what is acknowledged is
        learnt from; the frames between them are nearer to their reference. What this mission has
        taught of one distance, less what the fit said of it, is true of the others too: all of it
        next door, half of it further away.
        """
        found, prior = adaptations.get(place), self.priors.get(place)
        if found is None:
            return nearest(adaptations, place) or self.start()
        if prior is None or found is not prior or place == RESTING:
            return found
        learnt = {
            other: each
            for other, each in adaptations.items()
            if other != RESTING and each is not self.priors.get(other, each)
        }
        if not learnt:
            return found
        other = min(learnt, key=lambda known: (abs(known - place), known))
        start, end = self.priors[other], learnt[other]
        return Adaptation(
            weights=self.shape.carried_over(
                prior.weights, end.weights, start.weights, in_full=abs(other - place) == 1
            ),
            energies=prior.energies,
            manners=list(map(_in_proportion, prior.manners, end.manners, start.manners)),
            widths=end.widths,
        )

    def _code_symbols(self, coder: Coder, row: Row, reference: StreamState) -> list[int]:
        steadiness = reference.steadiness[:]
        for n in self.symbols:
            guard = self.columns[n].guard
            if guard is not None and row[guard[0]] != guard[1]:
                continue
            size, old, new = self.sizes[n], reference.row[n], row[n] or 0
            if old is None:
                row[n] = coder.uniform(size, new)
                continue
            if size == 1:
                row[n] = 0
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
        """Write or read the numbers; gives their velocity, and what was learnt.

        One long function: it runs at both ends for every field of every sample, and in Python a
        call costs as much as five multiplications.
        """
        old_row, old_velocity = reference.row, reference.velocity
        velocity = [0] * len(row)
        trends = old_velocity or velocity
        if steps != 1:
            trends = [way * steps for way in trends]
        manners, widths = before.manners[:], before.widths[:]
        explained = Explained(self.shape, before.weights, before.energies)
        linear = explained.add(self._known(old_row, trends, steps))
        course_before = self._course_before
        surprise = greatest = 0
        for n, size, is_relative, guard in self._plan:
            if n == course_before and self._course is not None:
                linear = explained.add(self._course.ways(row, old_row, trends, steps))
            old = old_row[n]
            if guard is not None and row[guard[0]] != guard[1]:
                linear = explained.follow(linear)
                continue
            if old is None:
                row[n] = coder.uniform(size, row[n] or 0)
                linear = explained.follow(linear)
                continue

            base, hold_miss, linear_miss, hold = manners[n]
            if linear_miss < hold_miss:
                expected = linear * _BETTER[(linear_miss << 8) // hold_miss] >> 16
            else:
                expected = linear * _WORSE[(hold_miss << 8) // linear_miss] >> 16

            far = ((linear if linear > 0 else -linear) << 16) // base
            situation = SITUATIONS * n
            if far >= 128:
                situation += 1 if far < 400 else 2 if far < 1000 else 3
            if surprise >= 300:
                situation += 4 if surprise < 600 else 8 if surprise < 1000 else 12
            width = widths[situation]
            scale = base * width >> WIDTH_BITS
            if scale < _LEAST_SCALE:
                scale = _LEAST_SCALE
            if is_relative:
                span = size if size < LARGEST_SIZE else LARGEST_SIZE
                half = span >> 1
                offset = (row[n] or 0) - old + half
                if self.columns[n].wraps:
                    offset %= size
                if not coder.is_reader and not 0 <= offset < span:
                    raise TooFarError
                center = (half << POINT_BITS) + expected
                change = coder.near(span, center, scale, half, hold, offset) - half
                row[n] = (old + change) % size
            else:
                center = (old << POINT_BITS) + expected
                row[n] = new = coder.near(size, center, scale, old, hold, row[n] or 0)
                change = new - old
            moved = change << POINT_BITS
            velocity[n] = moved // steps
            following = explained.follow(moved)

            # Learn. A wild value must not make the curve wide for long.
            miss = moved - expected
            miss = (miss if miss > 0 else -miss) << _MISS_BITS
            ratio = (miss << 8) // scale
            limit = _MISS_LIMIT * scale + _MISS_SPARED
            if miss > limit:
                if ratio > greatest:
                    greatest = ratio
                miss = limit
                ratio = (miss << 8) // scale
            if ratio > surprise:
                surprise = ratio
            if change:
                if hold > _LEAST_HOLD:
                    hold -= hold >> _HOLD_SHIFT
                base += (miss << WIDTH_BITS) // width - base >> _SCALE_SHIFT
            else:
                # Did it stay by chance, as the curve has it? Otherwise the curve has nothing to
                # learn: it is about how far the number goes when it does not stay.
                chance = _PEAK // scale if scale > _NARROW else _SURE
                cause = (hold << 16) // (hold + ((_WHOLE - hold) * chance >> 16))
                hold += cause - hold >> _HOLD_SHIFT
                if hold > MOST_HOLD:
                    hold = MOST_HOLD
                base += ((miss << WIDTH_BITS) // width - base) * (
                    _WHOLE - cause
                ) >> 16 + _SCALE_SHIFT
            width += (ratio * width >> 8) - width >> _MISS_SHIFT
            if _LEAST_WIDTH < width < _MOST_WIDTH:
                widths[situation] = width
            off = (moved if moved > 0 else -moved) << _MISS_BITS
            hold_miss += (off if off < limit else limit) - hold_miss >> _MISS_SHIFT
            off = moved - linear
            off = (off if off > 0 else -off) << _MISS_BITS
            linear_miss += (off if off < limit else limit) - linear_miss >> _MISS_SHIFT
            manners[n] = (
                base if base > _LEAST_SCALE else _LEAST_SCALE,
                hold_miss if hold_miss > _LEAST_SCALE else _LEAST_SCALE,
                linear_miss if linear_miss > _LEAST_SCALE else _LEAST_SCALE,
                hold,
            )
            linear = following

        if explained.is_broken:
            return velocity, self.start()
        trust = 1 << 16
        greatest = max(greatest, surprise)
        if greatest > _TRUSTED_MISS:
            trust = max(trust * _TRUSTED_MISS**2 // greatest**2, _LEAST_TRUST)
        weights, energies = explained.moved(trust)
        return velocity, Adaptation(weights, energies, manners, widths)

    def _known(self, old_row: Row, trends: list[int], steps: int) -> list[int]:
        """The quantities that are known before the sample."""
        levels = [
            0 if (old := old_row[n]) is None else old - zero << POINT_BITS
            for n, zero in self._levels
        ]
        return [_ONE * steps, *levels, *[trends[n] for n in self._ways]]


def _completed(row: Row, old_row: Row) -> Row:
    """A row with the last that was known of what is not there."""
    return [old if new is None else new for new, old in zip(row, old_row, strict=True)]


def _in_proportion(manner: Manner, end: Manner, start: Manner) -> Manner:
    """A manner whose misses change as others did from start to end."""
    scale, hold_miss, linear_miss = (
        max(miss * new // old, _LEAST_SCALE)
        for miss, new, old in zip(manner[:3], end[:3], start[:3], strict=True)
    )
    return scale, hold_miss, linear_miss, manner[3]
