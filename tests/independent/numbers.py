"""Steps, ranges and floats of fields, for both codecs (section 7). Written from docs/wire.md alone.

A multiple beyond the range stands for the end of it. Ties go to the even one; of an integer field,
to the greater. The multiple of a float is computed in doubles.
"""

import math
import struct
from dataclasses import dataclass
from fractions import Fraction

from tests.independent.errors import ReadError
from tests.independent.table import INTEGERS, Field

_FREE = 1 << 50
"""The greatest multiple of a number without a range."""
_DOUBLE = 1 << 53
_SHORT = 10_000_000


def step_of(field: Field) -> Fraction:
    """Return the step as a fraction; as the double that it is, if it is none of small numbers."""
    if field.step is None:
        return Fraction(1)
    step = Fraction(repr(field.step))
    if step.denominator > _DOUBLE:
        short = Fraction(field.step).limit_denominator(_SHORT)
        step = short if float(short) == field.step else step
    return step if max(step.numerator, step.denominator) <= _DOUBLE else Fraction(field.step)


@dataclass(frozen=True)
class Grid:
    """The values that a number takes, by multiples of its step."""

    field: Field
    step: Fraction
    least: int
    greatest: int

    @property
    def count(self) -> int:
        return self.greatest - self.least + 1

    @property
    def is_free(self) -> bool:
        """Tell whether it has no range."""
        return self.field.range is None and self.field.type not in INTEGERS

    def holds(self, multiple: int) -> bool:
        return self.least <= multiple <= self.greatest

    def takes(self, value: float) -> bool:
        """Tell whether a value to be written lies in the range, before it is rounded."""
        if not math.isfinite(value):
            return False
        if self.field.wraps:
            return True
        return in_range(self.field, value) and self.holds(self.multiple(value))

    def value(self, multiple: int) -> float:
        """Return the number that a multiple of the step stands for."""
        number = multiple * self.step
        if self.field.type in INTEGERS:
            return self._integer(multiple, int(number))
        value = as_float(number, self.field)
        if self.field.range is None or not self.holds(multiple):
            return value
        low, high = self.field.range
        return min(max(value, low), high)

    def _integer(self, multiple: int, number: int) -> int:
        bounds = INTEGERS[self.field.type]
        if self.field.range is not None and self.holds(multiple):
            bounds = int(self.field.range[0]), int(self.field.range[1])
        least, greatest = (_nearest(self.field, self.step, bound) for bound in bounds)
        if not least <= multiple <= greatest:
            raise ReadError("outside of the type")
        return min(max(number, bounds[0]), bounds[1])

    def multiple(self, value: float) -> int:
        """Return the nearest multiple to the value; a field that wraps folds it."""
        nearest = _nearest(self.field, self.step, fold(self.field, value))
        if self.field.wraps:
            return (nearest - self.least) % self.count + self.least
        return nearest


def grid(field: Field) -> Grid | None:
    """Return the values of a number; None for a float without a step."""
    whole = field.type in INTEGERS
    if not whole and field.step is None:
        return None
    step = step_of(field)
    bounds: tuple[float, float] | None = field.range
    if bounds is None and whole:
        bounds = INTEGERS[field.type]
    if bounds is None:
        return Grid(field, step, -_FREE, _FREE)
    least, greatest = (_nearest(field, step, bound) for bound in bounds)
    if field.wraps and _product(field, step, greatest) >= bounds[1]:
        greatest -= 1
    return Grid(field, step, least, greatest)


def _nearest(field: Field, step: Fraction, value: float) -> int:
    if field.type in INTEGERS:
        return math.floor(Fraction(value) / step + Fraction(1, 2))
    if max(step.numerator, step.denominator) > _DOUBLE:
        return round(value / float(step))
    return round(value * float(step.denominator) / float(step.numerator))


def _product(field: Field, step: Fraction, multiple: int) -> float | Fraction:
    return multiple * step if field.type in INTEGERS else as_float(multiple * step, field)


def as_float(number: Fraction, field: Field) -> float:
    try:
        value = float(number)
    except OverflowError as error:
        raise ReadError("outside of the type") from error
    if field.type == "float32" and abs(value) > 3.5e38:
        raise ReadError("outside of the type")
    return value


def bounded(field: Field, value: float) -> float:
    """Return a received float without a step: an end of the range, if it is the single of one."""
    if field.range is None or field.escapes or field.type != "float32":
        return value
    low, high = field.range
    if not single(low) <= value <= single(high) or (field.wraps and value >= high):
        raise ReadError("outside of the range")
    return min(max(value, low), high)


def in_range(field: Field, value: float) -> bool:
    """Tell whether a number lies in the range of its field."""
    if field.range is None:
        return True
    low, high = field.range
    return low <= value < high if field.wraps else low <= value <= high


def reaches(field: Field, value: float) -> bool:
    """Tell whether a received number lies in the range, with the singles of its ends."""
    if in_range(field, value) or field.range is None:
        return in_range(field, value)
    return field.type == "float32" and single(field.range[0]) <= value <= single(field.range[1])


def at_end(field: Field, value: float) -> float:
    """Return the end of the range for the single of one beyond it, as a sender takes it."""
    if field.range is None or field.type in INTEGERS or field.range[0] <= value <= field.range[1]:
        return value
    low, high = field.range
    near = single(value) if field.type == "float32" else value
    if near == single(high) and near > high:
        return low if field.wraps else high
    return low if near == single(low) and near < low else value


def fold(field: Field, value: float) -> float:
    """Fold a number into its range, if the field wraps."""
    if field.range is None or not field.wraps or not math.isfinite(value):
        return value
    low, high = field.range
    folded = value if low <= value < high else low + (value - low) % (high - low)
    is_single = field.type == "float32" and field.step is None
    return low if (single(folded) if is_single else folded) >= high else folded


def escaped(field: Field, value: float) -> float:
    """Return a number as it escapes: of a single, the nearest one."""
    if not field.escapes or field.type != "float32" or in_range(field, value):
        return value
    return single(value)


def pack(form: str, value: float) -> bytes | None:
    """Return the IEEE 754 bytes of the value, or None where they are not exact."""
    try:
        raw = struct.pack(form, value)
    except (OverflowError, struct.error):
        return None
    return raw if struct.unpack(form, raw)[0] == value else None


def single(value: float) -> float:
    """Return the nearest single."""
    try:
        return float(struct.unpack(">f", struct.pack(">f", value))[0])
    except OverflowError:
        return math.copysign(math.inf, value)
