"""Annex C.4 to C.6: number columns against those before. Written from docs/wire.md alone."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache

from tests.independent import curves
from tests.independent.arithmetic import Coder
from tests.independent.columns import Columns, Row
from tests.independent.errors import ReadError

SITUATIONS = 16
MOST_HOLD = 65206
_LEVELS = 8192
_WIDE = 1 << 22
_STRIDE = 1 << 20
_WINDOW = 1 << 40
_MOST_WAY = 1 << 28
_LANE = 96
_BROKEN = 1 << 32
_SPEEDS = ("speed", "velocity", "surge", "sog")
_CLASSES = (0, 1, 2, 3, 4, 4, 5, 5, 5, 6, 6, 6, 6, 6, 6, 6, 7)


@dataclass(frozen=True)
class Manner:
    """How a column behaves."""

    log_scale: int
    nearer: int = 32768
    hold: int = 1024


@dataclass(frozen=True)
class Adaptation:
    """What was learnt at one distance."""

    weights: tuple[int, ...]
    energies: tuple[int, ...]
    manners: tuple[Manner, ...]
    widths: tuple[int, ...]


@dataclass(frozen=True)
class State:
    """The state of a sample."""

    row: Row
    velocity: list[int] | None
    adaptations: Mapping[int, Adaptation]
    steadiness: tuple[int, ...]
    kept: tuple[tuple[object, ...], ...] = ()


def class_of(steps: int, before: State) -> int:
    return 0 if before.velocity is None else _CLASSES[min(steps, 16)]


@dataclass
class Course:
    """Heading, speed and positions (C.6)."""

    heading: int
    size: int
    speed: tuple[int, int] | None
    positions: list[int]

    def quantities(self, old: Row, new: Row, trends: list[int], steps: int) -> list[int]:
        north = east = turn = 0
        for row in (old, new):
            speed = 100
            if self.speed is not None:
                column, zero = self.speed
                speed = (row[column] or zero) - zero
            heading = row[self.heading]
            if heading is not None:
                cosine, sine = directions()[heading * 4096 // self.size]
                north += speed * cosine
                east += speed * sine
                turn = heading - turn
        half = self.size // 2
        is_turn = abs((turn + half) % self.size - half) * 12 >= self.size
        ways = [0 if is_turn else trends[n] for n in self.positions]
        return [(north * steps) >> 11, (east * steps) >> 11, *ways]


@cache
def directions() -> list[tuple[int, int]]:
    """Return cosine and sine of 4096 directions."""
    c, s = 1 << 80, 0
    a, b = 1208924397255013589970078, 1854468253976911810989
    sines = []
    for _ in range(4096):
        sines.append((s + (1 << 65)) >> 66)
        c, s = (c * a - s * b) >> 80, (s * a + c * b) >> 80
    return [(sines[(place + 1024) % 4096], sine) for place, sine in enumerate(sines)]


def course_of(columns: Columns) -> Course | None:
    order, all_columns = columns.numbers, columns.columns
    headings = [n for n in order if all_columns[n].wraps and all_columns[n].size >= 64]
    if not headings:
        return None
    speed = None
    for n in order:
        zero = all_columns[n].zero
        if all_columns[n].name.lower() in _SPEEDS and zero is not None:
            speed = (n, zero)
            break
    others = (headings[0], None if speed is None else speed[0])
    positions = [n for n in order if all_columns[n].size >= 32768 and n not in others]
    if len(positions) < 2:
        return None
    if any(n is not None and order.index(n) > order.index(positions[0]) for n in others):
        return None
    return Course(headings[0], all_columns[headings[0]].size, speed, positions)


@cache
def step(miss: int, rate: int) -> int:
    whole = 32 * rate
    return curves.log(((whole + 2 * (miss - 16) + 1) << 20) // whole, 20)


@dataclass
class _Squares:
    """Least squares over the quantities of one sample (C.5)."""

    count: int
    before: Adaptation
    quantities: list[int] = field(default_factory=list)
    innovations: list[int] = field(default_factory=list)
    stages: list[int] = field(default_factory=list)
    is_broken: bool = False
    prediction: int = 0
    _stage: int = 0

    def place(self, k: int) -> int:
        return _LANE * (self.count - 1 - k)

    def take(self, quantity: int) -> int:
        """Take the next quantity; return the prediction of the one after it."""
        place = self.place(len(self.quantities))
        innovation = quantity - self.prediction
        weight = self.before.weights[len(self.quantities)]
        self._stage = (self._stage + innovation * weight) % (1 << place)
        self.quantities.append(quantity)
        self.innovations.append(innovation)
        self.stages.append(self._stage)
        found = self._stage >> (max(place - _LANE, 0) + 16)
        if found >= _BROKEN:
            found -= 1 << 80
        if found <= -_BROKEN:
            self.is_broken = True
            found = 0
        self.prediction = found
        return found

    def moved(self, worst: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return weights and energies after the sample."""
        trust = 65536 if worst <= 40 else max(65536 * 1600 // worst**2, 64)
        places = [self.place(k) for k in range(self.count)]
        whole = sum(q << p for q, p in zip(self.quantities, places, strict=True)) << 16
        weights, energies = [], []
        for i, (weight, energy) in enumerate(
            zip(self.before.weights, self.before.energies, strict=True)
        ):
            kept = energy - (energy >> 7)
            innovation = self.innovations[i]
            if innovation**2 < energy >> 7:
                energies.append(kept + innovation**2)
                weights.append(weight)
                continue
            more = kept + (trust * innovation**2 >> 16)
            gain = (trust * innovation << 18) // more
            left = whole % (1 << places[i]) - self.stages[i]
            half, ones = halves(places[i + 1 :]), sum(1 << p for p in places[i + 1 :])
            mask = ones * ((1 << 62) - 1)
            weights.append(weight + (((gain * left + half) >> 34) & mask) - (half >> 34))
            energies.append(more)
            trust = trust * kept // more
        return tuple(weights), tuple(energies)


def halves(places: list[int]) -> int:
    return sum(1 << (place + 95) for place in places)


class Rows:
    """Codes number columns against those of the sample before."""

    def __init__(self, columns: Columns) -> None:
        self.columns = columns
        self._course = course_of(columns)
        positions = [] if self._course is None else self._course.positions
        every = columns.columns
        self._levels = [
            n for n in columns.numbers if every[n].zero is not None and every[n].size <= _LEVELS
        ]
        self._trends = [n for n in columns.numbers if n not in self._levels and n not in positions]
        self.large = [n for n in columns.numbers if every[n].size > _WIDE and not every[n].wraps]
        self.count = 1 + len(self._levels) + len(self._trends) + len(columns.numbers)
        if self._course is not None:
            self.count += 2 + len(positions)

    def new(self) -> Adaptation:
        scales = [min(16, 1 + each.size // 64) << 12 for each in self.columns.columns]
        return Adaptation(
            weights=(0,) * self.count,
            energies=(256,) * self.count,
            manners=tuple(Manner(curves.log_scale(scale)) for scale in scales),
            widths=(curves.WIDTH,) * (SITUATIONS * len(scales)),
        )

    def code(
        self, coder: Coder, row: Row, before: State, adaptation: Adaptation, steps: int
    ) -> tuple[list[int], Adaptation]:
        """Take the numbers of a row; return their velocity and what was learnt."""
        old = before.row
        velocity = [0] * len(row)
        trends = [each * steps for each in before.velocity or velocity]
        strides = dict.fromkeys(range(len(row)), 0)
        for n in self.large:
            if abs(stride := trends[n] >> 4) >= _STRIDE:
                strides[n], trends[n] = stride, 0
        squares = _Squares(self.count, adaptation)
        for each in self._known(old, trends, steps):
            squares.take(each)
        manners, widths = list(adaptation.manners), list(adaptation.widths)
        surprise = worst = 0
        for n in self.columns.numbers:
            if self._course is not None and n == self._course.positions[0]:
                for each in self._course.quantities(old, row, trends, steps):
                    squares.take(each)
            column, expected = self.columns.columns[n], squares.prediction
            if self.columns.is_missing(column.guard, row):
                squares.take(expected)
                continue
            former = old[n]
            if former is None:
                row[n] = coder.one_of(column.size, row[n] or 0)
                squares.take(expected)
                continue
            manner = manners[n]
            x = expected * min(max(((manner.nearer >> 8) - 80) * 256 // 48, 0), 256) >> 8
            far = abs(expected * curves.reciprocal((manner.log_scale >> 6) + 32))
            level = sum(surprise >= each for each in (19, 38, 63))
            situation = SITUATIONS * n + 4 * level + sum(far >= 1 << b for b in (23, 25, 26))
            width = widths[situation]
            grade = (manner.log_scale + width) >> 6
            if column.wraps or column.size > _WIDE:
                change = self._relative(coder, row, n, former + strides[n], x, grade, manner.hold)
                velocity[n] = 16 * (change + strides[n]) // steps
                way = min(max(16 * change, -_MOST_WAY), _MOST_WAY)
            else:
                center = 16 * former + x
                value = row[n] or 0
                row[n] = new = curves.number(
                    coder, column.size, center, grade, former, manner.hold, value
                )
                change = new - former
                velocity[n] = 16 * change // steps
                way = 16 * change
            squares.take(way)
            miss = abs(way - x) * curves.reciprocal(grade) >> 20
            worst = max(worst, miss)
            surprise = max(surprise, min(miss, 64))
            miss = min(miss, 64 + (curves.reciprocal(grade) >> 15))
            manners[n] = _learnt(manner, grade, miss, is_moved=change != 0)
            if (2 * way - expected) * expected > 0:
                nearer = manner.nearer + ((65536 - manner.nearer) >> 5)
            else:
                nearer = manner.nearer - (manner.nearer >> 5)
            manners[n] = replace(manners[n], nearer=nearer)
            width += step(miss, 32)
            if 0 <= width < 8192:
                widths[situation] = width
        if squares.is_broken:
            return velocity, self.new()
        weights, energies = squares.moved(worst)
        return velocity, Adaptation(weights, energies, tuple(manners), tuple(widths))

    def _known(self, old: Row, trends: list[int], steps: int) -> list[int]:
        levels = []
        for n in self._levels:
            level, zero = old[n], self.columns.columns[n].zero
            assert zero is not None
            levels.append(0 if level is None else 16 * (level - zero))
        return [1024 * steps, *levels, *(trends[n] for n in self._trends)]

    def _relative(
        self, coder: Coder, row: Row, n: int, start: int, x: int, grade: int, hold: int
    ) -> int:
        column = self.columns.columns[n]
        count = min(column.size, _WINDOW)
        half = count // 2
        offset = (row[n] or 0) - start + half
        if column.wraps or count == column.size:
            offset %= column.size
        center = 16 * half + x
        change = curves.number(coder, count, center, grade, half, hold, offset) - half
        row[n] = (start + change) % column.size
        return change


def _learnt(manner: Manner, grade: int, miss: int, *, is_moved: bool) -> Manner:
    hold, log_scale = manner.hold, manner.log_scale
    if is_moved:
        hold -= (hold - 200) >> 5
        log_scale += step(miss, 8)
    else:
        chance = min((1 << 27) // curves.scale_of(grade), 60000)
        parts = hold + ((65536 - hold) * chance >> 16)
        if not parts:
            raise ReadError("neither held nor by chance")
        cause = (hold << 16) // parts
        hold = min(hold + ((cause - hold) >> 5), MOST_HOLD)
        log_scale += step(miss, 8) * (65536 - cause) >> 16
    return replace(manner, hold=hold, log_scale=max(log_scale, 0))
