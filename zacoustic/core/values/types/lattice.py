"""`Lattice`: the values of a scalar field as the integers 0…size-1, and back.

Codecs that count bits or probabilities need one thing of a field: which of how many values it has.
A number with a step is its count above the least one, an integer its distance from the least one,
an enum its position, a bool 0 or 1. Fields without step and bounds (exact floats, texts, bytes)
have no lattice.
"""

from collections.abc import Callable
from typing import Any

from zacoustic.core.values.types.fields import INTEGER_LIMITS, FieldSpec


class Lattice:
    """The values of one scalar as integers.

    Args:
        field: A scalar field that `has_lattice`; arrays are made of such scalars.

    Attributes:
        size: Number of values, ≥ 1. If the field escapes, values outside of the range are not
            counted.
        wraps: Whether the last value is a neighbour of the first.
        is_ordered: Whether neighbouring integers are neighbouring values: not for enum and bool.
        index: Returns the integer of a validated value within bounds, 0…size-1.
        value: Returns the value of an integer of 0…size-1.
        take: Returns the integer of a value that is valid and within bounds without conversion;
            None: it is not, or checking that would take longer.
    """

    index: Callable[[Any], int]
    take: Callable[[object], int | None]
    value: Callable[[int], Any]

    def __init__(self, field: FieldSpec) -> None:
        self.field = field
        self.wraps = field.wraps
        self.is_ordered = field.is_numeric
        quantiser = field.quantiser
        if quantiser is not None:
            self.size = quantiser.high_count - quantiser.low_count + 1
            self.index = quantiser.indexer()
            self.value = quantiser.locator()
            self.take = quantiser.taker()
        elif field.is_integer:
            least, greatest = (int(limit) for limit in field.limits or INTEGER_LIMITS[field.type])
            # If it wraps, the top is the bottom, and `validate` has folded it already.
            self.size = greatest - least + (0 if field.wraps else 1)
            self.index = lambda value: (value - least) % self.size
            self.value = lambda index: index + least
            self.take = lambda value: (
                value - least if type(value) is int and 0 <= value - least < self.size else None
            )
        elif field.type == "enum":
            names, positions = field.values, {name: n for n, name in enumerate(field.values)}
            self.size = len(names)
            self.index = positions.__getitem__
            self.value = names.__getitem__
            self.take = lambda value: positions.get(value) if type(value) is str else None
        else:
            assert field.type == "bool"
            self.size = 2
            self.index = int
            self.value = bool
            self.take = lambda value: int(value) if type(value) is bool else None

    @staticmethod
    def has_lattice(field: FieldSpec) -> bool:
        """Return whether the scalars of a field have bounded integers."""
        if field.is_numeric:
            return field.is_integer or field.step is not None
        return field.type in ("bool", "enum")
