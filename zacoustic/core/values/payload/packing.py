"""How each kind of field is packed: one class per kind, composed once per type.

A packing trusts the validated values that it writes, and trusts no bits that it reads from the
channel: a number, count or form that the type does not allow is a `PayloadError`. Every element
takes at least one bit, so a payload bounds the work that it can cause.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Any

from zacoustic.core.values.payload.bits import BitSink, BitSource
from zacoustic.core.values.payload.codec import PayloadError
from zacoustic.core.values.payload.exact import ExactNumber
from zacoustic.core.values.types import Ends, FieldSpec, Lattice, TypeSpec


class Packing(ABC):
    """Packs the values of a field, or of a part of one, as bits."""

    smallest_bits: int
    """Size of the smallest value, bits, ≥ 1 except for a type without fields."""
    largest_bits: int | None
    """Size of the largest value, bits; None: no bound."""

    @abstractmethod
    def write(self, writer: BitSink, value: Any) -> None:  # noqa: ANN401 (one kind per class)
        """Append a validated and clamped value."""

    @abstractmethod
    def read(self, reader: BitSource) -> Any:  # noqa: ANN401
        """Read a value; raise `PayloadError` if there is none."""

    @abstractmethod
    def skip(self, reader: BitSource) -> None:
        """Skip a value, reading no more than its size; raise `PayloadError` if there is none."""


class TypePacking(Packing):
    """The fields of a type, one after the other."""

    def __init__(self, type_spec: TypeSpec) -> None:
        self._plan = [(field.name, field_packing(type_spec, field)) for field in type_spec.fields]
        parts = [packing for _, packing in self._plan]
        self.smallest_bits = sum(packing.smallest_bits for packing in parts)
        self.largest_bits = _sum(packing.largest_bits for packing in parts)

    def write(self, writer: BitSink, value: dict[str, Any]) -> None:
        """Append the fields."""
        for name, packing in self._plan:
            packing.write(writer, value[name])

    def read(self, reader: BitSource) -> dict[str, Any]:
        """Read the fields."""
        return {name: packing.read(reader) for name, packing in self._plan}

    def skip(self, reader: BitSource) -> None:
        """Skip the fields."""
        for _, packing in self._plan:
            packing.skip(reader)


class _Index(Packing):
    """A position in a lattice; if the field escapes, one more code announces the number."""

    def __init__(self, field: FieldSpec) -> None:
        self._lattice = Lattice(field)
        self._exact = ExactNumber(field) if field.escapes else None
        self._name = field.name
        self._codes = self._lattice.size + (self._exact is not None)
        self._width = max(1, (self._codes - 1).bit_length())
        self.smallest_bits = self._width
        self.largest_bits = self._width + (self._exact.width if self._exact else 0)
        self._low, self._high = field.bounds if field.escapes else (0, 0)
        self._least, self._greatest = self._low, self._high
        if field.escapes and not field.is_integer:
            ends = Ends(field)
            self._least, self._greatest = ends.least, ends.greatest
        self._is_finite = field.nan

    def write(self, writer: BitSink, value: Any) -> None:  # noqa: ANN401
        if self._exact is not None and not self._low <= value <= self._high:
            writer.write(self._lattice.size, self._width)
            writer.write(self._exact.bits(value), self._exact.width)
            return
        writer.write(self._lattice.index(value), self._width)

    def read(self, reader: BitSource) -> Any:  # noqa: ANN401
        index = reader.read(self._width)
        if index < self._lattice.size:
            return self._lattice.value(index)
        if self._exact is None or index >= self._codes:
            raise PayloadError(f"{self._name} is {index}; allowed: 0..{self._codes - 1}")
        number = self._exact.number(reader.read(self._exact.width))
        if self._least <= number <= self._greatest or (self._is_finite and number - number != 0):
            raise PayloadError(f"{self._name} is {number} in a longer form than needed")
        return number

    def skip(self, reader: BitSource) -> None:
        if self._exact is None:
            reader.skip(self._width)
        elif reader.read(self._width) == self._lattice.size:
            reader.skip(self._exact.width)


class _Count(Packing):
    """A number with a step and no range: the count of steps, with its sign and width before it."""

    def __init__(self, field: FieldSpec) -> None:
        quantiser = self._quantiser = field.counting
        self._name = field.name
        self._widths = quantiser.high_count.bit_length()
        self._head_bits = self._widths.bit_length()
        self.smallest_bits = self._head_bits
        self.largest_bits = self._head_bits + self._widths

    def write(self, writer: BitSink, value: float) -> None:
        count = self._quantiser.count(value)
        width = abs(count).bit_length()
        writer.write(width, self._head_bits)
        if width:  # the first bit of the magnitude is 1: the sign takes its place
            writer.write(abs(count) ^ (1 << width - 1 if count > 0 else 0), width)

    def read(self, reader: BitSource) -> float:
        width = reader.read(self._head_bits)
        if width > self._widths:
            raise PayloadError(f"{self._name} has {width} bits; allowed: {self._widths}")
        if not width:
            return self._quantiser.value(0)
        bits, top = reader.read(width), 1 << width - 1
        count = -bits if bits & top else bits | top
        if not self._quantiser.low_count <= count <= self._quantiser.high_count:
            raise PayloadError(f"{self._name} is {count} steps")
        return self._quantiser.value(count)

    def skip(self, reader: BitSource) -> None:
        reader.skip(reader.read(self._head_bits))


class _Exact(Packing):
    """A float without a step."""

    def __init__(self, field: FieldSpec) -> None:
        self._exact = ExactNumber(field)
        self.smallest_bits = self.largest_bits = self._exact.width
        self._name = field.name
        self._range = None if field.escapes else field.range
        self._wraps = field.wraps
        self._is_finite = field.nan
        if self._range is not None:
            ends = Ends(field)
            self._least, self._greatest = ends.least, ends.greatest

    def write(self, writer: BitSink, value: float) -> None:
        if self._wraps and self._range is not None and self._exact.rounded(value) >= self._range[1]:
            value = self._range[0]  # rounded, a value just below the top becomes the bottom
        writer.write(self._exact.bits(value), self._exact.width)

    def read(self, reader: BitSource) -> float:
        number = self._exact.number(reader.read(self._exact.width))
        if self._is_finite and number - number != 0:
            raise PayloadError(f"{self._name} is {number} in a longer form than needed")
        if self._range is None:
            return number
        low, high = self._range
        if not self._least <= number <= self._greatest or (self._wraps and number >= high):
            raise PayloadError(f"{self._name} is {number}; allowed: {low}..{high}")
        return min(max(number, low), high)

    def skip(self, reader: BitSource) -> None:
        reader.skip(self._exact.width)


class _Special(Packing):
    """A float that may be no value: one bit if it is a number, else which it is instead."""

    def __init__(self, number: Packing) -> None:
        self._number = number
        self.smallest_bits = 2
        self.largest_bits = _sum((number.largest_bits, 1))

    def write(self, writer: BitSink, value: float) -> None:
        if value - value == 0:
            writer.write(1, 1)
            self._number.write(writer, value)
        elif value != value:
            writer.write(0b00, 2)
        else:
            writer.write(0b010 | (value < 0), 3)

    def read(self, reader: BitSource) -> float:
        if reader.read(1):
            number: float = self._number.read(reader)
            return number
        if not reader.read(1):
            return math.nan
        return -math.inf if reader.read(1) else math.inf

    def skip(self, reader: BitSource) -> None:
        if reader.read(1):
            self._number.skip(reader)
        elif reader.read(1):
            reader.skip(1)


class _Length:
    """A length: in as many bits as the bounds need, or seven bits at a time without an upper one.

    What is written is the distance from the shortest length.
    """

    def __init__(self, name: str, longest: int | None, shortest: int = 0) -> None:
        self._name = name
        self._longest = longest
        self.shortest = shortest
        self.bits = 8 if longest is None else (longest - shortest).bit_length()

    def write(self, writer: BitSink, count: int) -> None:
        count -= self.shortest
        if self._longest is not None:
            writer.write(count, self.bits)
            return
        while count > 0x7F:
            writer.write(count & 0x7F | 0x80, 8)
            count >>= 7
        writer.write(count, 8)

    def read(self, reader: BitSource, element_bits: int) -> int:
        """Read the count; the rest must hold that many elements."""
        count = reader.read(self.bits)
        if self._longest is None:
            count = self._read_sevens(reader, count)
        count += self.shortest
        if self._longest is not None and count > self._longest:
            raise PayloadError(f"{self._name} has {count} elements; allowed: {self._longest}")
        if count * element_bits > reader.bits_left:
            raise PayloadError(f"{self._name} has {count} elements in {reader.bits_left} bits")
        return count

    def _read_sevens(self, reader: BitSource, first: int) -> int:
        count, shift, group = first & 0x7F, 0, first
        while group & 0x80:
            shift += 7
            group = reader.read(8)
            if not group:
                raise PayloadError(f"{self._name} has a length in a longer form than needed")
            count |= (group & 0x7F) << shift
        return count


class _Octets(Packing):
    """Bytes, or a text in UTF-8 with seven bits a character if all are ASCII."""

    def __init__(self, field: FieldSpec) -> None:
        self._name = field.name
        self._length = _Length(field.name, field.max_length, field.min_length or 0)
        self._is_text = field.type == "string"
        head_bits = self._length.bits + self._is_text
        self.smallest_bits = head_bits + (8 - self._is_text) * self._length.shortest
        self.largest_bits = None
        if field.max_length is not None:
            self.largest_bits = head_bits + 8 * field.max_length

    def write(self, writer: BitSink, value: str | bytes) -> None:
        width = 8
        if isinstance(value, str):
            width = 7 if value.isascii() else 8
            writer.write(width & 1, 1)
            value = value.encode()
        self._length.write(writer, len(value))
        for octet in value:
            writer.write(octet, width)

    def read(self, reader: BitSource) -> str | bytes:
        width = self._read_width(reader)
        count = self._length.read(reader, width)
        content = bytes(reader.read(width) for _ in range(count))
        if not self._is_text:
            return content
        if width == 8 and content.isascii():
            raise PayloadError(f"{self._name} is ASCII in a longer form than needed")
        try:
            return content.decode()
        except UnicodeDecodeError:
            raise PayloadError(f"{self._name} is not UTF-8") from None

    def skip(self, reader: BitSource) -> None:
        width = self._read_width(reader)
        reader.skip(self._length.read(reader, width) * width)

    def _read_width(self, reader: BitSource) -> int:
        return 8 - reader.read(1) if self._is_text else 8


class _Elements(Packing):
    """An array; a bounded one is preceded by its length."""

    def __init__(self, field: FieldSpec, element: Packing) -> None:
        self._element = element
        self._fixed = field.length
        self._length = _Length(field.name, field.max_length)
        if field.length is not None:
            self.smallest_bits = element.smallest_bits * field.length
            self.largest_bits = _times(element.largest_bits, field.length)
        else:
            self.smallest_bits = self._length.bits
            self.largest_bits = _sum(
                (_times(element.largest_bits, field.capacity), self._length.bits)
            )

    def write(self, writer: BitSink, value: list[Any]) -> None:
        if self._fixed is None:
            self._length.write(writer, len(value))
        for element in value:
            self._element.write(writer, element)

    def read(self, reader: BitSource) -> list[Any]:
        return [self._element.read(reader) for _ in range(self._count(reader))]

    def skip(self, reader: BitSource) -> None:
        for _ in range(self._count(reader)):
            self._element.skip(reader)

    def _count(self, reader: BitSource) -> int:
        if self._fixed is not None:
            return self._fixed
        return self._length.read(reader, self._element.smallest_bits)


class _Optional(Packing):
    """One bit that says whether there is a value, then the value."""

    def __init__(self, present: Packing) -> None:
        self._present = present
        self.smallest_bits = 1
        self.largest_bits = _sum((present.largest_bits, 1))

    def write(self, writer: BitSink, value: object) -> None:
        writer.write(value is not None, 1)
        if value is not None:
            self._present.write(writer, value)

    def read(self, reader: BitSource) -> Any:  # noqa: ANN401
        return self._present.read(reader) if reader.read(1) else None

    def skip(self, reader: BitSource) -> None:
        if reader.read(1):
            self._present.skip(reader)


def field_packing(type_spec: TypeSpec, field: FieldSpec) -> Packing:
    """Make the packing of a field of a type, arrays and optional ones included."""
    packing: Packing
    if field.is_nested:
        packing = TypePacking(type_spec.nested_type(field.type))
    else:
        packing = value_packing(field)
    if field.nan:
        packing = _Special(packing)
    if field.is_array:
        packing = _Elements(field, packing)
    return _Optional(packing) if field.optional else packing


def value_packing(field: FieldSpec) -> Packing:
    """Make the packing of one element of a scalar type; of one that may be no value, the number."""
    if field.is_numeric and field.range is None and not field.is_integer:
        return _Exact(field) if field.step is None else _Count(field)
    if Lattice.has_lattice(field):
        return _Index(field)
    return _Exact(field) if field.is_numeric else _Octets(field)


def _sum(sizes: Iterable[int | None]) -> int | None:
    total = 0
    for size in sizes:
        if size is None:
            return None
        total += size
    return total


def _times(size: int | None, count: int) -> int | None:
    return None if size is None else size * count
