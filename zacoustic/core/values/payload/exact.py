"""Numbers as the bits of their own type: those without a step, or outside of their range.

A float is its IEEE 754 bits, with only one form of "not a number"; an integer is its distance from
the least value of its type.
"""

import struct
from typing import Final

from zacoustic.core.values.payload.codec import PayloadError
from zacoustic.core.values.types.fields import FLOAT_TYPES, INTEGER_LIMITS, FieldSpec

_LAYOUTS: Final = {
    "float32": (struct.Struct(">f"), struct.Struct(">I"), 0x7FC00000),
    "float64": (struct.Struct(">d"), struct.Struct(">Q"), 0x7FF8000000000000),
}


class ExactNumber:
    """A number of a numeric type as bits.

    Args:
        field: The field of the numbers; its range and step are ignored.

    Attributes:
        width: Size, bits.
    """

    width: int

    def __init__(self, field: FieldSpec) -> None:
        self._name = field.name
        if field.type in FLOAT_TYPES:
            self._layout, self._bits, self._nan = _LAYOUTS[field.type]
            self.width = 8 * self._layout.size
            self._least = None
        else:
            least, greatest = INTEGER_LIMITS[field.type]
            self.width = (greatest - least).bit_length()
            self._least = least

    def bits(self, number: float) -> int:
        """Return the bits of a number of the type; a float64 is rounded for a float32 field."""
        if self._least is not None:
            return int(number) - self._least
        if number != number:
            return self._nan
        bits: int = self._bits.unpack(self._layout.pack(number))[0]
        return bits

    def number(self, bits: int) -> float:
        """Return the number of received bits, 0…2**width-1.

        Raises:
            PayloadError: Another form of "not a number" than the one that is sent.
        """
        if self._least is not None:
            return bits + self._least
        number: float = self._layout.unpack(self._bits.pack(bits))[0]
        if number != number and bits != self._nan:
            raise PayloadError(f"{self._name} is a nan with content")
        return number

    def rounded(self, number: float) -> float:
        """Return the number as the receiver decodes it."""
        return self.number(self.bits(number))
