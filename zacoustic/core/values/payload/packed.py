"""Packed: the values of a type's fields as bits, one after the other.

The problem: CBOR spends whole bytes. A heading in steps of 0.1° has 3600 values, which takes 12
bits and not 24; a flag takes one bit and not eight. The idea: both ends know from the type how many
values a field has, so its value is a number of exactly as many bits as that takes, and no mark says
where it ends.

==========================  ======================================================================
field                       bits, most significant first
==========================  ======================================================================
bool                        1
enum                        position in `values`
integer                     distance from the least value
number with step and range  multiple of the step less that of the least value
... that escapes            one number more announces the full width of the type
number with a step only     6 bits: width; then sign and magnitude
float without step          its 32 or 64 bits
float that may be no value  1 and the number; ``00`` NaN, ``010`` infinity, ``011`` minus infinity
string                      1: ASCII? length; 7 or 8 bits a character
bytes                       length, 8 bits each; no length where there is only one
another type                its fields, in place
fixed array                 its elements
bounded array               number of elements, then these
optional                    1: is there a value? then the value
==========================  ======================================================================

Zeros fill the last byte. There is one payload for a value; every other form is refused, and so is
a value out of bounds: only `PayloadError` is ever raised.
"""

from typing import Any

from zacoustic.core.values.payload.bits import BitReader, BitWriter
from zacoustic.core.values.payload.codec import PayloadError
from zacoustic.core.values.payload.packing import TypePacking
from zacoustic.core.values.payload.typed import TypedCodec
from zacoustic.core.values.types import TypeSpec


class PackedCodec(TypedCodec):
    """Values of a type as packed bits.

    Args:
        type_spec: The type, resolved.

    Raises:
        ConfigError: The type is not resolved.
    """

    def __init__(self, type_spec: TypeSpec) -> None:
        super().__init__(type_spec)
        self._packing = TypePacking(type_spec)
        self.smallest_bits = self._packing.smallest_bits
        """Size of the smallest payload before padding, bits."""
        self.largest_bits = self._packing.largest_bits
        """Size of the largest payload before padding, bits; None: no bound."""
        self.smallest_bytes = (self.smallest_bits + 7) // 8
        largest = self.largest_bits
        self.largest_bytes = None if largest is None else (largest + 7) // 8

    def write(self, normal: dict[str, Any]) -> bytes:
        """Return the payload of a value that `normalised` returned."""
        writer = BitWriter()
        self._packing.write(writer, normal)
        return writer.to_bytes()

    def decode(self, payload: bytes) -> dict[str, Any]:
        """Return the value as a dict with every field, as `TypeSpec.validate` normalises it."""
        reader = BitReader(payload)
        value = self._packing.read(reader)
        reader.finish()
        return value

    def measure(self, buffer: bytes, offset: int) -> int | None:
        """Return the offset after the payload that starts at `offset`; None if none does."""
        reader = BitReader(buffer, offset)
        try:
            self._packing.skip(reader)
        except PayloadError:
            return None
        return reader.next_byte
