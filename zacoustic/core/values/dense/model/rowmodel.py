"""One sample's row of integers, coded against the row of its reference.

Symbols (flags, enums) come first: each stays unchanged with a probability that follows how often it
did. Then come the numbers, in ascending order of their number of values, so that speed, pitch and
heading are known when the position is coded, which has the most values.

A number has two predictions: it stays (*hold*), and what least squares compute from everything
known by then. The latter counts in full while it is the nearer one half of the time, and less if it
seldom is, as for a sensor that mostly stands still. Its mean error lately is the scale of the
number's curve, times a width that depends on the situation: how surprising the sample has been so
far, and how far the number is expected to move. In a turn everything is less certain. Scales and
widths are logarithms: an error moves them a step up or down, from a list by the size of the error
in scales, without a division. A number that did not change at all has a share of its own, which
follows how often that happens: for switches, and for sensors that report the same value again.

The quantities of `leastsquares`, in this order:

1. one, times the steps: for steady drift, as by a current;
2. of the reference, the level of every field that has values on both sides of zero and is not a
   position: a pitch or a rate of turn says how other fields will change;
3. the way of every other number in the steps to this sample, at the reference's velocity;
4. the number of each column minus that of the reference, in coding order; before the first position
   of a type with a heading, the output of `course`.
"""

from typing import Final

from zacoustic.core.values.dense.coder.arithmetic import Coder
from zacoustic.core.values.dense.coder.curve import (
    GRADE_SHIFT,
    LARGEST_SIZE,
    MOST_HOLD,
    MOST_LOG_SCALE,
    NARROWER,
    POINT_BITS,
    SCALE_BITS,
    SCALES,
    WIDTH_BITS,
    logarithm,
)
from zacoustic.core.values.dense.model.adaptation import (
    RESTING,
    SITUATIONS,
    Adaptation,
    Manner,
    StreamState,
    nearest,
    new_adaptation,
    step_class,
)
from zacoustic.core.values.dense.model.course import course_of
from zacoustic.core.values.dense.model.layout import Column, Row
from zacoustic.core.values.dense.model.leastsquares import Explained, Shape

# A field with more values than this is a position (or the like): its level says nothing.
_LEVEL_SIZE: Final = 1 << 13

_SCALE_RATE: Final = 8  # scales follow the last eight samples
_WIDTH_RATE: Final = 32  # the widths, the last 32
_NEARER_SHIFT: Final = 5  # the choice of predictions, and how often a number stays, as well
_HOLD_SHIFT: Final = 5
_LEAST_HOLD: Final = 200
_ONE: Final = 64 << POINT_BITS
_WHOLE: Final = 1 << 16

# The error of a number counts in 1/16 scales, up to four scales and two steps.
_SCALE: Final = 16
_MISS_LIMIT: Final = 4 * _SCALE
_PER_SCALE_BITS: Final = 20
_SPARED_BITS: Final = _PER_SCALE_BITS - POINT_BITS - 1
# By grade: a way of 1/16 steps in 1/16 scales, 2**-20.
_PER_SCALE: Final = [(1 << _PER_SCALE_BITS + SCALE_BITS) // scale for scale in SCALES]
_MOST_MISS: Final = _MISS_LIMIT + (_PER_SCALE[0] >> _SPARED_BITS)
# From these errors on a sample is a surprise, of three degrees, and is trusted less.
_SURPRISES: Final = 19, 38, 63
_TRUSTED_MISS: Final = 40
_LEAST_TRUST: Final = 1 << 6
# By the error of the worst number: the index of its first situation.
_LEVELS: Final = [
    4 * sum(miss >= surprise for surprise in _SURPRISES) for miss in range(_MISS_LIMIT + 1)
]
# By logarithm of a scale: the same, before the width is known.
_PER_LOG_SCALE: Final = _PER_SCALE[NARROWER >> GRADE_SHIFT :]
# By the bit length of such a way: how far it is, in four classes from 1/8, 1/2 and 1 scale.
_FARS: Final = [
    sum(bits > _PER_SCALE_BITS + begin for begin in (3, 5, 6))
    for bits in range(3 * _PER_SCALE_BITS + 20)
]
# By grade: the curve's own share for no change: 1/(2·scale) for a Laplace distribution.
_CHANCES: Final = [min((1 << 15 + SCALE_BITS) // scale, 60000) for scale in SCALES]
# By how often the linear prediction is the nearer one, 2**-8: its factor, 2**-8.
_COUNTS: Final = [min(max((often - 80) * 256 // 48, 0), 256) for often in range(257)]


def _steps(rate: int) -> list[int]:
    """Return by the error of a number how a mean of that many samples moves, a logarithm."""
    whole = 2 * _SCALE * rate
    return [
        logarithm((whole + 2 * (miss - _SCALE) + 1 << 20) // whole, 20)
        for miss in range(_MOST_MISS + 1)
    ]


_SCALE_STEPS: Final = _steps(_SCALE_RATE)
_WIDTH_STEPS: Final = _steps(_WIDTH_RATE)

# A number with more values than this is coded relative to its reference, within a window.
_WIDE: Final = LARGEST_SIZE
_WINDOW: Final = 1 << 40
# A stride of this many steps is not left to least squares: the number is coded relative to its end.
_STRIDE: Final = _WIDE >> 2
_MOST_MOVED: Final = 1 << 28  # least squares learn from no greater way, 1/16 of a step

_LEAST_STEADY: Final = 1 << 8
_MOST_STEADY: Final = (1 << 16) - (1 << 8)
START_STEADY: Final = (1 << 16) - (1 << 12)
"""How often an unknown symbol stays unchanged, 2**-16."""


class TooFarError(Exception):
    """A number with more values than a curve is too far from its reference for this method."""


class RowModel:
    """Codes the rows of a stream.

    Args:
        columns: The columns of the stream's type.
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
            # Relative to the reference if the field wraps, so that both directions are near, or if
            # it is wide; else relative to the least value.
            (
                n,
                columns[n].size,
                min(columns[n].size, _WINDOW) if columns[n].wraps or columns[n].size > _WIDE else 0,
                columns[n].guard,
            )
            for n in self.numbers
        ]
        self._large = [n for n in self.numbers if columns[n].size > _WIDE and not columns[n].wraps]
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
        """The fitted adaptations, by `step_class`."""

    def start(self) -> Adaptation:
        """Make the adaptation before anything is learnt."""
        return new_adaptation(self.sizes, self.shape.quantities)

    def code(self, coder: Coder, row: Row, reference: StreamState, steps: int) -> StreamState:
        """Write or read a row.

        Args:
            coder: The writer or reader.
            row: The row; a reader fills it in.
            reference: The sample to code against.
            steps: Samples (or periods) from the reference, ≥ 1.

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

    def strides(self, row: Row, old_row: Row, steps: int) -> list[int] | None:
        """Return the velocity of a row that is not coded against another one; None: unknown.

        It is that of the numbers which are too far apart for coding, and 0 for all others.
        """
        found: list[int] | None = None
        for n in self._large:
            new, old = row[n], old_row[n]
            if new is not None and old is not None and abs(new - old) >= _STRIDE * steps:
                found = found or [0] * len(row)
                found[n] = (new - old << POINT_BITS) // steps
        return found

    def code_plainly(self, coder: Coder, row: Row) -> None:
        """Write or read a row with all values equally likely."""
        for n in (*self.symbols, *self.numbers):
            guard = self.columns[n].guard
            if guard is None or row[guard[0]] == guard[1]:
                row[n] = coder.uniform(self.sizes[n], row[n] or 0)

    def _adaptation(self, adaptations: dict[int, Adaptation], place: int) -> Adaptation:
        """Return the adaptation for a distance: learnt, carried over, fitted, or new.

        Acknowledged frames lie at one distance from each other, and learning uses only acknowledged
        frames; the frames between them are nearer to their reference. What this mission has taught
        of one distance, relative to the fit, also holds for the others: all of it for the adjacent
        class, half of it further away.
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
            # One of the others: those after the old one move up by one.
            other = coder.uniform(size - 1, new - (new > old))
            row[n] = other + (other >= old)
            steadiness[n] = max(_LEAST_STEADY, steady - (steady >> _HOLD_SHIFT))
        return steadiness

    def _code_numbers(
        self, coder: Coder, row: Row, reference: StreamState, before: Adaptation, steps: int
    ) -> tuple[list[int], Adaptation]:
        """Write or read the numbers; return their velocity and the new adaptation.

        One long function: it runs at both ends for every field of every sample, and in Python a
        call costs as much as five multiplications.
        """
        old_row, old_velocity = reference.row, reference.velocity
        velocity = [0] * len(row)
        trends = old_velocity or velocity
        if steps != 1:
            trends = [way * steps for way in trends]
        strides: dict[int, int] = {}
        if old_velocity is not None:
            for n in self._large:
                stride = trends[n] >> POINT_BITS
                if not -_STRIDE < stride < _STRIDE:
                    strides[n] = stride
            if strides:
                trends = [0 if n in strides else way for n, way in enumerate(trends)]
        manners, widths = before.manners[:], before.widths[:]
        explained = Explained(self.shape, before.weights, before.energies)
        follow, near = explained.follow, coder.near
        linear = explained.add(self._known(old_row, trends, steps))
        course_before = self._course_before
        surprise = greatest = level = 0
        for n, size, span, guard in self._plan:
            if n == course_before and self._course is not None:
                linear = explained.add(self._course.ways(row, old_row, trends, steps))
            old = old_row[n]
            if guard is not None and row[guard[0]] != guard[1]:
                linear = follow(linear)
                continue
            if old is None:
                row[n] = coder.uniform(size, row[n] or 0)
                linear = follow(linear)
                continue

            log_scale, nearer, hold = manners[n]
            expected = linear * _COUNTS[nearer >> 8] >> 8
            far = linear * _PER_LOG_SCALE[log_scale >> GRADE_SHIFT]
            situation = SITUATIONS * n + level + _FARS[far.bit_length()]
            width = widths[situation]
            grade = log_scale + width >> GRADE_SHIFT
            if span:
                stride = strides.get(n, 0)
                half = span >> 1
                offset = (row[n] or 0) - old - stride + half
                if span == size or self.columns[n].wraps:
                    offset %= size
                if not coder.is_reader and not 0 <= offset < span:
                    raise TooFarError
                center = (half << POINT_BITS) + expected
                change = near(span, center, grade, half, hold, offset) - half
                row[n] = (old + stride + change) % size
            else:
                center = (old << POINT_BITS) + expected
                row[n] = new = near(size, center, grade, old, hold, row[n] or 0)
                change = new - old
            moved = change << POINT_BITS
            velocity[n] = moved // steps
            if span:
                velocity[n] = (stride + change << POINT_BITS) // steps
                if not -_MOST_MOVED < moved < _MOST_MOVED:
                    moved = _MOST_MOVED if moved > 0 else -_MOST_MOVED
            following = follow(moved)

            # Learn. A wild value must not widen the curve for long.
            miss = moved - expected
            miss = (miss if miss > 0 else -miss) * _PER_SCALE[grade] >> _PER_SCALE_BITS
            if miss > surprise:
                surprise = miss
                if miss > _MISS_LIMIT:
                    if miss > greatest:
                        greatest = miss
                    surprise = _MISS_LIMIT
                    limit = _MISS_LIMIT + (_PER_SCALE[grade] >> _SPARED_BITS)
                    if miss > limit:
                        miss = limit
                level = _LEVELS[surprise]
            if change:
                hold -= hold - _LEAST_HOLD >> _HOLD_SHIFT
                log_scale += _SCALE_STEPS[miss]
            else:
                # Did it stay by chance, as the curve predicts? Otherwise the curve has nothing to
                # learn: it models how far the number moves when it does not stay.
                cause = (hold << 16) // (hold + ((_WHOLE - hold) * _CHANCES[grade] >> 16))
                hold += cause - hold >> _HOLD_SHIFT
                if hold > MOST_HOLD:
                    hold = MOST_HOLD
                log_scale += _SCALE_STEPS[miss] * (_WHOLE - cause) >> 16
            width += _WIDTH_STEPS[miss]
            if not width >> WIDTH_BITS:
                widths[situation] = width
            if (moved + moved - linear) * linear > 0:
                nearer += _WHOLE - nearer >> _NEARER_SHIFT
            else:
                nearer -= nearer >> _NEARER_SHIFT
            manners[n] = log_scale if log_scale > 0 else 0, nearer, hold
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
        """Return the quantities that are known before the sample."""
        levels = [
            0 if (old := old_row[n]) is None else old - zero << POINT_BITS
            for n, zero in self._levels
        ]
        return [_ONE * steps, *levels, *[trends[n] for n in self._ways]]


def _completed(row: Row, old_row: Row) -> Row:
    """Return a row whose missing columns have their last known values."""
    return [old if new is None else new for new, old in zip(row, old_row, strict=True)]


def _in_proportion(manner: Manner, end: Manner, start: Manner) -> Manner:
    """Return a manner changed as others have changed from start to end."""
    log_scale, nearer = (
        own + new - old for own, new, old in zip(manner[:2], end[:2], start[:2], strict=True)
    )
    return min(max(log_scale, 0), MOST_LOG_SCALE), min(max(nearer, 0), _WHOLE), manner[2]
