"""`RmwDesertCodec`: values of a type as the fields of a message of rmw_desert, and back.

A value to be sent is checked twice: against its type, as on any stream, and against what the
receiver of rmw_desert survives (`flattening.compile_counter`, `messages.check_limits`). Steps do
not apply; numbers are sent as they are. Of received fields only those that their sender can have
written are accepted: a packet has no check, so a form that the sender never writes is the only sign
of damage.
"""

import struct
from typing import Any, Final

from zacoustic.core.values.payload import PayloadError, TypedCodec
from zacoustic.core.values.rmw_desert.flattening import (
    compile_counter,
    compile_reader,
    compile_writer,
)
from zacoustic.core.values.rmw_desert.messages import check_limits
from zacoustic.core.values.rmw_desert.sizes import sizes_bytes
from zacoustic.core.values.types import TypeSpec
from zacoustic.errors import PayloadInvalidError

_TRUNCATED: Final = (IndexError, struct.error)


class RmwDesertCodec(TypedCodec):
    """Values of a type as rmw_desert encodes them.

    Args:
        type_spec: The type, resolved.
        head_items: Items of the head of its packets.
        head_bytes: Size of that head, bytes.

    Raises:
        ConfigError: The type is not resolved.
    """

    def __init__(self, type_spec: TypeSpec, *, head_items: int = 0, head_bytes: int = 0) -> None:
        super().__init__(type_spec)
        self.smallest_bytes, self.largest_bytes = sizes_bytes(type_spec)
        self._head_items = head_items
        self._head_bytes = head_bytes
        self._write = compile_writer(type_spec)
        self._read = compile_reader(type_spec)
        self._count = compile_counter(type_spec)

    def encode(self, value: object) -> bytes:
        """Return the fields of a value.

        Raises:
            PayloadInvalidError: It is not of the type, or would crash the receiver of rmw_desert.
            PayloadTooLargeError: The receiver would cut it.
        """
        normal = self.normalised(value)
        items = self._head_items + self._count(normal, self.type_spec.name)
        fields = self.write(normal)
        check_limits(self.type_spec.name, items, self._head_bytes + len(fields))
        return fields

    def write(self, normal: dict[str, Any]) -> bytes:
        """Return the fields of a value that `normalised` returned, as rmw_desert would send them.

        This does not check what the receiver survives.
        """
        payload = bytearray()
        self._write(payload, normal)
        return bytes(payload)

    def decode(self, payload: bytes) -> dict[str, Any]:
        """Return the value as a dict with every field, as `TypeSpec.validate` normalises it."""
        try:
            value, end = self._read(payload, 0)
        except _TRUNCATED:
            raise PayloadError("the packet ends inside a value") from None
        if end != len(payload):
            raise PayloadError(f"{len(payload) - end} bytes behind the value")
        try:
            return self.normalised(value)
        except PayloadInvalidError as error:
            raise PayloadError(str(error)) from None

    def measure(self, buffer: bytes, offset: int) -> int | None:
        """Return the offset after the fields that start at `offset`; None if none do."""
        try:
            return self._read(buffer, offset)[1]
        except (PayloadError, *_TRUNCATED):
            return None
