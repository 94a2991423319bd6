"""One sample's row of integers, coded against the row of its reference.

Symbols (flags, enums) come first: each stays as it was with a probability that follows how often it
did. Then the numbers, in the order of their number of values, so that a speed, a pitch and a
heading are known when the position is coded, which has the most values.

Two predictions are made of a number: it stays (*hold*), and what least squares make of everything
known by then. The latter counts in full while it is the nearer one half of the time, and less where
it seldom is, as of a sensor that mostly stands still. How far that was off lately is the scale of
the curve on which the number lies, times a width that depends on the situation: how surprising the
sample has been so far, and how far the number is expected to go. In a turn everything is less
certain. Scales and widths are logarithms: what is learnt of a miss is a step up or down, out of a
list by how many scales the miss has, and nothing is divided. A number that did not change at all
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

# A field with more values than this is a position (or the like), and its level says nothing.
_LEVEL_SIZE: Final = 1 << 13

_SCALE_RATE: Final = 8  # scales follow the last eight samples
_WIDTH_RATE: Final = 32  # the widths, the last 32
_NEARER_SHIFT: Final = 5  # the choice of predictions, and how often a number stays, as well
_HOLD_SHIFT: Final = 5
_LEAST_HOLD: Final = 200
_ONE: Final = 64 << POINT_BITS
_WHOLE: Final = 1 << 16

# How far off a number is counts in 1/16 scales, up to four scales and two steps.
_SCALE: Final = 16
_MISS_LIMIT: Final = 4 * _SCALE
_PER_SCALE_BITS: Final = 20
_SPARED_BITS: Final = _PER_SCALE_BITS - POINT_BITS - 1
# By grade: a way of 1/16 steps in 1/16 scales, 2**-20.
_PER_SCALE: Final = [(1 << _PER_SCALE_BITS + SCALE_BITS) // scale for scale in SCALES]
_MOST_MISS: Final = _MISS_LIMIT + (_PER_SCALE[0] >> _SPARED_BITS)
# From where on a sample is a surprise, a greater and a great one, and is trusted less.
_SURPRISES: Final = 19, 38, 63
_TRUSTED_MISS: Final = 40
_LEAST_TRUST: Final = 1 << 6
# By how far the worst number was off: where its situations begin.
_LEVELS: Final = [
    4 * sum(miss >= surprise for surprise in _SURPRISES) for miss in range(_MISS_LIMIT + 1)
]
# By logarithm of a scale: the same, where the width is not known yet.
_PER_LOG_SCALE: Final = _PER_SCALE[NARROWER >> GRADE_SHIFT :]
# By the bits of such a way: whether it is far, in four classes that begin at 1/8, 1/2 and 1 scale.
_FARS: Final = [
    sum(bits > _PER_SCALE_BITS + begin for begin in (3, 5, 6))
    for bits in range(3 * _PER_SCALE_BITS + 20)
]
# By grade: the share that the curve itself has for staying: of a Laplace distribution 1/(2·scale).
_CHANCES: Final = [min((1 << 15 + SCALE_BITS) // scale, 60000) for scale in SCALES]
# By how often the linear prediction is the nearer one, 2**-8: how much it counts, 2**-8.
_COUNTS: Final = [min(max((often - 80) * 256 // 48, 0), 256) for often in range(257)]


def _steps(rate: int) -> list[int]:
    """By how far a number was off: what a mean over so many samples changes, as a logarithm."""
    whole = 2 * _SCALE * rate
    return [
        logarithm((whole + 2 * (miss - _SCALE) + 1 << 20) // whole, 20)
        for miss in range(_MOST_MISS + 1)
    ]


_SCALE_STEPS: Final = _steps(_SCALE_RATE)
_WIDTH_STEPS: Final = _steps(_WIDTH_RATE)

# A number of more values than this is seen from its reference, as far as so many values around.
_WIDE: Final = LARGEST_SIZE
_WINDOW: Final = 1 << 40
# A stride of so many steps is not left to least squares: the number is seen from where it leads.
_STRIDE: Final = _WIDE >> 2
_MOST_MOVED: Final = 1 << 28  # least squares learn of no greater way, 1/16 of a step

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
            # where it is wide; else from the least value.
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
        """The fitted values, by `step_class`."""

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

    def strides(self, row: Row, old_row: Row, steps: int) -> list[int] | None:
        """Return the velocity of a row that is not coded against another one; None: not known.

        It is that of the numbers which are too far from each other to be, and 0 for all others.
        """
        found: list[int] | None = None
        for n in self._large:
            new, old = row[n], old_row[n]
            if new is not None and old is not None and abs(new - old) >= _STRIDE * steps:
                found = found or [0] * len(row)
                found[n] = (new - old << POINT_BITS) // steps
        return found

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

            # Learn. A wild value must not make the curve wide for long.
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
                # Did it stay by chance, as the curve has it? Otherwise the curve has nothing to
                # learn: it is about how far the number goes when it does not stay.
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
    log_scale, nearer = (
        own + new - old for own, new, old in zip(manner[:2], end[:2], start[:2], strict=True)
    )
    return min(max(log_scale, 0), MOST_LOG_SCALE), min(max(nearer, 0), _WHOLE), manner[2]
