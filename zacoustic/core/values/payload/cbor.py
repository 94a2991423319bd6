"""CBOR by position: the values of a type's fields as CBOR items, one after the other.

A CBOR map of field names costs more than the values; both ends know the type, so nothing but the
values travels, one item after the other (a CBOR sequence, RFC 8742), each in its shortest form:

==========================  ======================================================================
field                       items
==========================  ======================================================================
bool                        ``f4`` or ``f5``
integers                    integer
number with a step          integer: the multiple of the step, see
                            `zacoustic.core.values.types.quantiser`
... outside, escaping       float: the number itself; integer: its multiple of the step
float32                     half where that is exact, else single
float64                     the shortest of half, single, double that is exact
float that may be no value  ``f97e00``, ``f97c00``, ``f9fc00``, else as above
string, bytes               text, bytes
enum                        unsigned: the position in `values`
another type                the items of its fields, in place
fixed array (`length`)      the items of its elements, in place
bounded array               unsigned: the number of elements, then their items
optional                    ``f6`` when there is no value, else as above
==========================  ======================================================================

So a reader that knows the type finds the end of a payload, and there is one payload for a value:
the decoder refuses every other form. It also refuses counts above the bound before it makes an
element; every element costs at least one byte, so a payload bounds the work that it can cause. A
refused payload is a `PayloadError`, and nothing else is ever raised.

Laws, tested: a value comes back within half a step, and a decoded value encodes to the payload that
it came from. One exception to the second: a float32 in a range whose end is no float32 comes back
as that end, which encodes the same.
"""

import struct
from typing import Any, Final

from zacoustic.core.values.payload.codec import PayloadError
from zacoustic.core.values.payload.readers import compile_reader, compile_skipper
from zacoustic.core.values.payload.sizes import sizes_bytes
from zacoustic.core.values.payload.typed import TypedCodec
from zacoustic.core.values.payload.writers import compile_writer
from zacoustic.core.values.types import TypeSpec

_TRUNCATED: Final = (IndexError, struct.error)


class CborCodec(TypedCodec):
    """Values of a type as CBOR by position.

    Args:
        type_spec: The type, resolved.

    Raises:
        ConfigError: The type is not resolved.
    """

    def __init__(self, type_spec: TypeSpec) -> None:
        super().__init__(type_spec)
        self.smallest_bytes, self.largest_bytes = sizes_bytes(type_spec)
        self._write = compile_writer(type_spec)
        self._read = compile_reader(type_spec)
        self._skip = compile_skipper(type_spec)

    def write(self, normal: dict[str, Any]) -> bytes:
        """Return the payload of a value that `normalised` returned."""
        payload = bytearray()
        self._write(payload, normal)
        return bytes(payload)

    def decode(self, payload: bytes) -> dict[str, Any]:
        """Return the value as a dict with every field, as `TypeSpec.validate` normalises it."""
        try:
            value: dict[str, Any]
            value, end = self._read(payload, 0)
        except _TRUNCATED:
            raise PayloadError("the payload ends inside a value") from None
        if end != len(payload):
            raise PayloadError(f"{len(payload) - end} bytes behind the value")
        return value

    def measure(self, buffer: bytes, offset: int) -> int | None:
        """Return the offset after the payload that starts at `offset`; None if none does."""
        try:
            return self._skip(buffer, offset)
        except (PayloadError, *_TRUNCATED):
            return None
