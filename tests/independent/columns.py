"""Annex C.1: a type as columns of integers, and a rest. Written from docs/wire.md alone."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from tests.independent import numbers
from tests.independent.table import INTEGERS, Field, Types

Guard = tuple[int, int] | None
Row = list[int | None]

_ARRAY = 32


@dataclass(frozen=True)
class Column:
    """One integer of each sample."""

    name: str
    size: int
    guard: Guard = None
    is_number: bool = False
    wraps: bool = False
    zero: int | None = None


class Kind(Enum):
    """What a part of the rest is."""

    STRING = "string"
    BYTES = "bytes"
    OTHER = "other"


@dataclass(frozen=True)
class Part:
    """One part of the rest: the fields that are packed plainly."""

    fields: tuple[Field, ...]
    kind: Kind
    guard: Guard = None


class Columns:
    """The columns and parts of a type."""

    def __init__(self, types: Types, name: str) -> None:
        self.types = types
        self.columns: list[Column] = []
        self.parts: list[Part] = []
        self._root = _Nested(self, name, None, "")
        self.symbols = [n for n, each in enumerate(self.columns) if not each.is_number]
        self.numbers = sorted(
            (n for n, each in enumerate(self.columns) if each.is_number),
            key=lambda n: (self.columns[n].size, n),
        )

    def is_missing(self, guard: Guard, row: Row) -> bool:
        return guard is not None and row[guard[0]] != guard[1]

    def join(self, row: Row, rest: list[Any]) -> dict[str, Any]:
        found: dict[str, Any] = self._root.join(row, rest)
        return found

    def split(self, value: Mapping[str, Any]) -> tuple[Row, list[Any]]:
        row: Row = [None] * len(self.columns)
        rest: list[Any] = [None] * len(self.parts)
        self._root.split(value, row, rest)
        return row, rest

    def column(self, name: str, size: int, guard: Guard, **more: Any) -> int:
        is_number = more.pop("is_number", False) and size > 2
        zero = more.pop("zero", None) if is_number else None
        self.columns.append(Column(name, size, guard, is_number, zero=zero, **more))
        return len(self.columns) - 1

    def part(self, fields: tuple[Field, ...], guard: Guard, kind: Kind = Kind.OTHER) -> int:
        self.parts.append(Part(fields, kind, guard))
        return len(self.parts) - 1


class _Piece(ABC):
    @abstractmethod
    def join(self, row: Row, rest: list[Any]) -> Any: ...

    @abstractmethod
    def split(self, value: Any, row: Row, rest: list[Any]) -> None: ...


class _Nested(_Piece):
    def __init__(self, columns: Columns, name: str, guard: Guard, path: str) -> None:
        fields = columns.types[name]
        self._pieces: list[tuple[tuple[str, ...], _Piece]] = []
        place = 0
        while place < len(fields):
            group = fields[place : place + 4]
            if _is_quaternion(group):
                names = tuple(each.name for each in group)
                self._pieces.append((names, _Quaternion(columns, group, guard)))
                place += 4
            else:
                field = fields[place]
                piece = _piece(columns, field, guard, field.name)
                self._pieces.append(((field.name,), piece))
                place += 1

    def join(self, row: Row, rest: list[Any]) -> Any:
        value: dict[str, Any] = {}
        for names, piece in self._pieces:
            found = piece.join(row, rest)
            value |= {names[0]: found} if len(names) == 1 else found
        return value

    def split(self, value: Any, row: Row, rest: list[Any]) -> None:
        for names, piece in self._pieces:
            piece.split(value[names[0]] if len(names) == 1 else value, row, rest)


class _Number(_Piece):
    def __init__(self, columns: Columns, field: Field, guard: Guard, name: str) -> None:
        self._field = field
        self._values = _lattice(field)
        size = len(field.values) or 2
        more: dict[str, Any] = {}
        if self._values is not None:
            size = self._values.count
            low, high = field.range or INTEGERS.get(field.type, (-1, 1))
            if low < 0 < high and not field.wraps:
                more["zero"] = -self._values.least
            more |= {"is_number": True, "wraps": field.wraps}
        self._place = columns.column(name, size, guard, **more)

    def join(self, row: Row, rest: list[Any]) -> Any:
        index = row[self._place]
        assert index is not None
        if self._values is None:
            return bool(index) if self._field.type == "bool" else self._field.values[index]
        return self._values.value(self._values.least + index)

    def split(self, value: Any, row: Row, rest: list[Any]) -> None:
        if self._values is None:
            is_bool = self._field.type == "bool"
            row[self._place] = int(value) if is_bool else self._field.values.index(value)
        else:
            row[self._place] = self._values.multiple(value) - self._values.least


def _lattice(field: Field) -> numbers.Grid | None:
    return numbers.grid(field) if field.type not in ("bool", "enum") else None


class _Maybe(_Piece):
    """A column that says which of two there is."""

    def __init__(self, flag: int, present: _Piece, absent: _Piece | None = None) -> None:
        self._flag = flag
        self._present = present
        self._absent = absent

    def join(self, row: Row, rest: list[Any]) -> Any:
        if row[self._flag]:
            return self._present.join(row, rest)
        return None if self._absent is None else self._absent.join(row, rest)

    def split(self, value: Any, row: Row, rest: list[Any]) -> None:
        is_there = value is not None
        if self._absent is not None:
            grid = self._present._values  # type: ignore[attr-defined]
            is_there = grid.takes(value)
        row[self._flag] = int(is_there)
        if is_there:
            self._present.split(value, row, rest)
        elif self._absent is not None:
            self._absent.split(value, row, rest)


_WITHOUT_VALUE = {0: math.nan, 2: math.inf, 3: -math.inf}


class _NoValue(_Piece):
    """A column that says which of the floats without a value there is, if none has one."""

    def __init__(self, kind: int, number: _Piece) -> None:
        self._kind = kind
        self._number = number

    def join(self, row: Row, rest: list[Any]) -> Any:
        kind = row[self._kind]
        assert kind is not None
        return self._number.join(row, rest) if kind == 1 else _WITHOUT_VALUE[kind]

    def split(self, value: Any, row: Row, rest: list[Any]) -> None:
        row[self._kind] = 1
        if math.isfinite(value):
            self._number.split(value, row, rest)
        else:
            row[self._kind] = 0 if math.isnan(value) else 2 if value > 0 else 3


class _Array(_Piece):
    def __init__(self, elements: list[_Piece]) -> None:
        self._elements = elements

    def join(self, row: Row, rest: list[Any]) -> Any:
        return [each.join(row, rest) for each in self._elements]

    def split(self, value: Any, row: Row, rest: list[Any]) -> None:
        for element, each in zip(self._elements, value, strict=True):
            element.split(each, row, rest)


class _Part(_Piece):
    def __init__(self, columns: Columns, fields: tuple[Field, ...], guard: Guard) -> None:
        kind = Kind.OTHER
        if len(fields) == 1 and fields[0].type in ("string", "bytes") and not fields[0].is_array:
            kind = Kind(fields[0].type)
        self._place = columns.part(fields, guard, kind)
        self._is_one = len(fields) == 1

    def join(self, row: Row, rest: list[Any]) -> Any:
        return rest[self._place]

    def split(self, value: Any, row: Row, rest: list[Any]) -> None:
        rest[self._place] = value


class _Quaternion(_Piece):
    """Four numbers as roll, pitch and yaw."""

    def __init__(self, columns: Columns, group: tuple[Field, ...], guard: Guard) -> None:
        step = group[0].step
        assert step is not None
        self._names = [each.name for each in group]
        self._tilt = 4 * math.ceil(math.tau / (5.8 * step))
        self._turn = 2 * math.ceil(math.tau / (3.5 * step))
        self._flag = columns.column("", 2, guard)
        inside = (self._flag, 1)
        tilt = self._tilt
        self._place = columns.column("", 2, inside)
        columns.column("", tilt + 1, inside, is_number=True, zero=tilt // 2)
        columns.column("", tilt // 2 + 1, inside, is_number=True, zero=tilt // 4)
        columns.column("", self._turn, inside, is_number=True, wraps=True)
        self._plain = columns.part(group, (self._flag, 0))

    def join(self, row: Row, rest: list[Any]) -> Any:
        if not row[self._flag]:
            return rest[self._plain]
        sign, roll, pitch, yaw = (each or 0 for each in row[self._place : self._place + 4])
        halves = (
            (roll - self._tilt // 2) * (math.pi / self._tilt),
            (pitch - self._tilt // 4) * (math.pi / self._tilt),
            (yaw - self._turn // 2) * (math.pi / self._turn),
        )
        (cr, cp, cy), (sr, sp, sy) = map(math.cos, halves), map(math.sin, halves)
        parts = (
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        )
        signed = [-part if sign else part for part in parts]
        return dict(zip(self._names, [min(max(each, -1.0), 1.0) for each in signed], strict=True))

    def split(self, value: Any, row: Row, rest: list[Any]) -> None:
        """Say them as four numbers: a sender may."""
        row[self._flag] = 0
        rest[self._plain] = {name: value[name] for name in self._names}


def _is_quaternion(group: tuple[Field, ...]) -> bool:
    if len(group) < 4 or [each.name[-1:].lower() for each in group] != ["x", "y", "z", "w"]:
        return False
    first = group[0]
    if first.type not in ("float32", "float64") or first.step is None or first.step > 0.1:
        return False
    return all(
        (each.type, each.step, each.range) == (first.type, first.step, (-1.0, 1.0))
        and not (each.escapes or each.optional or each.is_array or each.wraps or each.nan)
        for each in group
    )


def _piece(columns: Columns, field: Field, guard: Guard, name: str) -> _Piece:
    if field.optional:
        flag = columns.column("", 2, guard)
        return _Maybe(flag, _piece(columns, replace(field, optional=False), (flag, 1), name))
    if field.is_array:
        if field.length is None or field.length * _width(columns.types, field) > _ARRAY:
            return _Part(columns, (field,), guard)
        element = replace(field, length=None)
        return _Array([_piece(columns, element, guard, "") for _ in range(field.length)])
    if field.type in columns.types:
        return _Nested(columns, field.type, guard, name)
    if field.nan:
        kind = columns.column("", 4, guard)
        return _NoValue(
            kind, _piece(columns, replace(field, nan=False, is_finite=True), (kind, 1), name)
        )
    if field.type in ("bool", "enum") or field.type in INTEGERS or field.step is not None:
        if not field.escapes:
            return _Number(columns, field, guard, name)
        flag = columns.column("", 2, guard)
        inside = _Number(columns, field, (flag, 1), name)
        exact = replace(field, range=None, step=None, escapes=False)
        return _Maybe(flag, inside, _Part(columns, (exact,), (flag, 0)))
    return _Part(columns, (field,), guard)


def _width(types: Types, field: Field) -> int:
    if field.type not in types:
        return 2
    return sum((each.length or 1) * _width(types, each) + 1 for each in types[field.type])
