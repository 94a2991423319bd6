"""The values of a type as a row of integers, plus the parts that are no integers.

Prediction needs a fixed row: the same field at the same index in every sample. So a type is split
once: nested types and short arrays become columns of their own, and every scalar with a lattice an
integer. An optional field becomes two columns, whether it is present and its value; so does a field
that escapes, and a float that may be no value. Texts, bytes, exact floats and bounded arrays are
the *rest* of a sample, carried as they are.

A column that is missing in a sample (the value of a missing optional) is None.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from enum import Enum
from typing import Any, Final

import msgspec

from zacoustic.core.values.dense.model.attitude import Attitude, quaternion_at
from zacoustic.core.values.payload.packing import (
    Packing,
    TypePacking,
    field_packing,
    value_packing,
)
from zacoustic.core.values.types import FieldSpec, Lattice, TypeSpec

# An array with more columns than this is carried as it is: prediction costs their square.
LONGEST_ARRAY: Final = 32

Row = list[int | None]
"""An integer for each column; None: missing."""


class Column:
    """One integer of every sample.

    Attributes:
        name: Path of the field.
        size: Number of values, ≥ 1.
        wraps: Whether the last value is next to the first.
        is_ordered: Whether close integers mean close values; otherwise they are symbols.
        zero: The integer of the value 0, if the field has values on both sides of it.
        guard: Column and value that it must have for this one to be present; None: always present.
    """

    def __init__(
        self,
        name: str,
        size: int,
        guard: tuple[int, int] | None,
        *,
        wraps: bool = False,
        is_ordered: bool = False,
        zero: int | None = None,
    ) -> None:
        self.name = name
        self.size = size
        self.guard = guard
        self.wraps = wraps
        self.is_ordered = is_ordered and size > 2
        self.zero = zero if self.is_ordered else None


class Content(Enum):
    """The content of a part of the rest."""

    TEXT = "text"
    BYTES = "bytes"
    # Exact floats, lists.
    OTHER = "other"


_CONTENTS: Final = {"string": Content.TEXT, "bytes": Content.BYTES}


class Remainder:
    """One part of the rest of every sample.

    Attributes:
        packing: Packs it as bits.
        content: What it holds.
        shortest: The fewest bytes of a text or of bytes.
        longest: The most; None: no bound.
        guard: As for columns.
    """

    def __init__(
        self,
        packing: Packing,
        guard: tuple[int, int] | None,
        *,
        content: Content,
        shortest: int,
        longest: int | None,
    ) -> None:
        self.packing = packing
        self.content = content
        self.shortest = shortest
        self.longest = longest
        self.guard = guard


class Layout:
    """Splits values of a type into parts.

    Args:
        type_spec: The type, resolved.
    """

    def __init__(self, type_spec: TypeSpec) -> None:
        self.type_spec = type_spec
        self.columns: list[Column] = []
        self.remainders: list[Remainder] = []
        self._whole = _Fields(self, type_spec, "", None)
        numbers = self._whole.numbers
        # Most types are nothing but numbers, each a column.
        self._is_plain = len(numbers) == len(type_spec.fields)
        self._takers = [(name, number.take) for name, number in numbers]
        self._values = [(name, number.place, number.value) for name, number in numbers]

    def take(self, value: object) -> Row | None:
        """Return the row of a value that is valid and within bounds as it is, and has no rest.

        Returns:
            None if it is not, or has a rest; or if checking that would take longer.
        """
        if not self._is_plain or type(value) is not dict or len(value) != len(self._takers):
            return None
        try:
            row = [take(value[name]) for name, take in self._takers]
        except KeyError:
            return None
        return None if None in row else row

    def split(self, value: dict[str, Any]) -> tuple[Row, list[Any]]:
        """Split a validated value within bounds into its row and its rest."""
        row: Row = [None] * len(self.columns)
        rest: list[Any] = [None] * len(self.remainders)
        self._whole.split(value, row, rest)
        return row, rest

    def join(self, row: Row, rest: list[Any]) -> dict[str, Any]:
        """Join row and rest to a value."""
        if self._is_plain:
            return {name: value(row[place]) for name, place, value in self._values}
        return self._whole.join(row, rest)


class _Part(ABC):
    @abstractmethod
    def split(self, value: Any, row: Row, rest: list[Any]) -> None: ...  # noqa: ANN401

    @abstractmethod
    def join(self, row: Row, rest: list[Any]) -> Any: ...  # noqa: ANN401


class _Fields(_Part):
    def __init__(
        self, layout: Layout, type_spec: TypeSpec, path: str, guard: tuple[int, int] | None
    ) -> None:
        self._parts: list[tuple[str, _Part]] = []
        self._quaternions: list[tuple[tuple[str, ...], _Quaternion]] = []
        fields, place = type_spec.fields, 0
        self._names = [field.name for field in fields]
        while place < len(fields):
            attitude = quaternion_at(fields, place)
            if attitude is not None:
                group = fields[place : place + 4]
                quaternion = _Quaternion(layout, attitude, group, path, guard)
                self._quaternions.append((tuple(field.name for field in group), quaternion))
                place += 4
                continue
            field = fields[place]
            part = _of_field(layout, type_spec, field, f"{path}{field.name}", guard)
            self._parts.append((field.name, part))
            place += 1
        self.numbers = [(name, part) for name, part in self._parts if isinstance(part, _Number)]
        # Most fields are numbers: no call for each of them.
        self._indexes = [(name, number.place, number.index) for name, number in self.numbers]
        self._others = [each for each in self._parts if not isinstance(each[1], _Number)]

    def split(self, value: dict[str, Any], row: Row, rest: list[Any]) -> None:
        for name, place, index in self._indexes:
            row[place] = index(value[name])
        for name, part in self._others:
            part.split(value[name], row, rest)
        for names, quaternion in self._quaternions:
            quaternion.split([value[name] for name in names], row, rest)

    def join(self, row: Row, rest: list[Any]) -> dict[str, Any]:
        value = {name: part.join(row, rest) for name, part in self._parts}
        if not self._quaternions:
            return value
        for names, quaternion in self._quaternions:
            value.update(zip(names, quaternion.join(row, rest), strict=True))
        return {name: value[name] for name in self._names}


class _Quaternion(_Part):
    def __init__(
        self,
        layout: Layout,
        attitude: Attitude,
        group: tuple[FieldSpec, ...],
        path: str,
        guard: tuple[int, int] | None,
    ) -> None:
        self._attitude = attitude
        self._flag = _flag(layout, f"{path}attitude?", guard)
        tilt, yaw, inside = attitude.tilt_circle, attitude.yaw_circle, (self._flag, 1)
        self._place = len(layout.columns)
        layout.columns += [
            Column(f"{path}sign", 2, inside),
            Column(f"{path}roll", tilt + 1, inside, is_ordered=True, zero=tilt // 2),
            Column(f"{path}pitch", tilt // 2 + 1, inside, is_ordered=True, zero=tilt // 4),
            Column(f"{path}yaw", yaw, inside, is_ordered=True, wraps=True),
        ]
        self._names = [field.name for field in group]
        bare = TypeSpec(name="Quaternion", fields=group)
        self._plain = _Other(layout, TypePacking(bare), (self._flag, 0))

    def split(self, value: list[float], row: Row, rest: list[Any]) -> None:
        angles = self._attitude.angles(value)
        row[self._flag] = int(angles is not None)
        if angles is None:
            self._plain.split(dict(zip(self._names, value, strict=True)), row, rest)
        else:
            row[self._place : self._place + 4] = angles

    def join(self, row: Row, rest: list[Any]) -> list[float]:
        if not row[self._flag]:
            return list(self._plain.join(row, rest).values())
        angles = [count or 0 for count in row[self._place : self._place + 4]]
        return [min(max(part, -1.0), 1.0) for part in self._attitude.parts(angles)]


class _Number(_Part):
    def __init__(
        self, layout: Layout, field: FieldSpec, path: str, guard: tuple[int, int] | None
    ) -> None:
        lattice = Lattice(field)
        self.place = len(layout.columns)
        self.index: Callable[[Any], int] = lattice.index
        self.value: Callable[[Any], Any] = lattice.value
        self.take: Callable[[object], int | None] = lattice.take
        limits = field.limits
        both_sides = limits is not None and limits[0] < 0 < limits[1] and not field.wraps
        is_ordered = lattice.is_ordered
        zero = lattice.index(0) if is_ordered and both_sides else None
        layout.columns.append(
            Column(path, lattice.size, guard, wraps=field.wraps, is_ordered=is_ordered, zero=zero)
        )

    def split(self, value: Any, row: Row, rest: list[Any]) -> None:  # noqa: ANN401
        row[self.place] = self.index(value)

    def join(self, row: Row, rest: list[Any]) -> Any:  # noqa: ANN401
        return self.value(row[self.place])


class _Escaping(_Part):
    def __init__(
        self, layout: Layout, field: FieldSpec, path: str, guard: tuple[int, int] | None
    ) -> None:
        self._low, self._high = field.bounds
        self._flag = _flag(layout, f"{path}?", guard)
        self._inside = _Number(layout, field, path, (self._flag, 1))
        anything = msgspec.structs.replace(field, range=None, step=None, outside="reject")
        self._beyond = _Other(layout, value_packing(anything), (self._flag, 0))

    def split(self, value: Any, row: Row, rest: list[Any]) -> None:  # noqa: ANN401
        inside = self._low <= value <= self._high
        row[self._flag] = int(inside)
        (self._inside if inside else self._beyond).split(value, row, rest)

    def join(self, row: Row, rest: list[Any]) -> Any:  # noqa: ANN401
        return (self._inside if row[self._flag] else self._beyond).join(row, rest)


class _Maybe(_Part):
    def __init__(self, flag: int, present: _Part) -> None:
        self._flag = flag
        self._present = present

    def split(self, value: Any, row: Row, rest: list[Any]) -> None:  # noqa: ANN401
        row[self._flag] = int(value is not None)
        if value is not None:
            self._present.split(value, row, rest)

    def join(self, row: Row, rest: list[Any]) -> Any:  # noqa: ANN401
        return self._present.join(row, rest) if row[self._flag] else None


class _Special(_Part):
    """A float that may be no value: which of these it is, or the number."""

    _NAN: Final = 0
    _NUMBER: Final = 1
    _ABOVE: Final = 2
    _BELOW: Final = 3

    def __init__(
        self, layout: Layout, field: FieldSpec, path: str, guard: tuple[int, int] | None
    ) -> None:
        self._kind = len(layout.columns)
        layout.columns.append(Column(f"{path}?", 4, guard))
        self._number = _of_value(layout, field, path, (self._kind, self._NUMBER))

    def split(self, value: Any, row: Row, rest: list[Any]) -> None:  # noqa: ANN401
        if value - value == 0:
            row[self._kind] = self._NUMBER
            self._number.split(value, row, rest)
        else:
            infinite = self._ABOVE if value > 0 else self._BELOW
            row[self._kind] = self._NAN if value != value else infinite

    def join(self, row: Row, rest: list[Any]) -> Any:  # noqa: ANN401
        kind = row[self._kind]
        if kind == self._NUMBER or kind is None:
            return self._number.join(row, rest)
        if kind == self._NAN:
            return math.nan
        return math.inf if kind == self._ABOVE else -math.inf


class _Several(_Part):
    def __init__(self, elements: list[_Part]) -> None:
        self._elements = elements

    def split(self, value: list[Any], row: Row, rest: list[Any]) -> None:
        for part, element in zip(self._elements, value, strict=True):
            part.split(element, row, rest)

    def join(self, row: Row, rest: list[Any]) -> list[Any]:
        return [part.join(row, rest) for part in self._elements]


class _Other(_Part):
    def __init__(
        self,
        layout: Layout,
        packing: Packing,
        guard: tuple[int, int] | None,
        *,
        content: Content = Content.OTHER,
        shortest: int = 0,
        longest: int | None = None,
    ) -> None:
        self._place = len(layout.remainders)
        layout.remainders.append(
            Remainder(packing, guard, content=content, shortest=shortest, longest=longest)
        )

    def split(self, value: Any, row: Row, rest: list[Any]) -> None:  # noqa: ANN401
        rest[self._place] = value

    def join(self, row: Row, rest: list[Any]) -> Any:  # noqa: ANN401
        return rest[self._place]


def _flag(layout: Layout, path: str, guard: tuple[int, int] | None) -> int:
    layout.columns.append(Column(path, 2, guard))
    return len(layout.columns) - 1


def _of_field(
    layout: Layout, type_spec: TypeSpec, field: FieldSpec, path: str, guard: tuple[int, int] | None
) -> _Part:
    if field.optional:
        flag = _flag(layout, f"{path}?", guard)
        present = msgspec.structs.replace(field, optional=False, default=None)
        return _Maybe(flag, _of_field(layout, type_spec, present, path, (flag, 1)))
    if field.is_bounded_array or (field.length or 0) * _width(type_spec, field) > LONGEST_ARRAY:
        return _Other(layout, field_packing(type_spec, field), guard)
    if field.length is not None:
        element = msgspec.structs.replace(field, length=None)
        return _Several(
            [
                _of_field(layout, type_spec, element, f"{path}[{index}]", guard)
                for index in range(field.length)
            ]
        )
    if field.is_nested:
        return _Fields(layout, type_spec.nested_type(field.type), f"{path}.", guard)
    make = _Special if field.nan else _of_value
    return make(layout, field, path, guard)


def _of_value(layout: Layout, field: FieldSpec, path: str, guard: tuple[int, int] | None) -> _Part:
    if Lattice.has_lattice(field):
        make = _Escaping if field.escapes else _Number
        return make(layout, field, path, guard)
    content = _CONTENTS.get(field.type, Content.OTHER)
    return _Other(
        layout,
        value_packing(field),
        guard,
        content=content,
        shortest=field.min_length or 0,
        longest=field.max_length,
    )


def _width(type_spec: TypeSpec, field: FieldSpec) -> int:
    """Return the most columns of one element."""
    if not field.is_nested:
        return 2
    inner = type_spec.nested_type(field.type)
    return sum((each.length or 1) * _width(inner, each) + 1 for each in inner.fields)
