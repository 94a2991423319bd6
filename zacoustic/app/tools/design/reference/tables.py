"""The tables of the section `plugins.acoustic`, key by key."""

import json
from collections.abc import Iterator
from difflib import get_close_matches
from typing import Any, Final

import msgspec
from msgspec import inspect

from zacoustic.app.tools.design.reference.meanings import meanings_of
from zacoustic.config.sections import Section, StreamEntry
from zacoustic.errors import ConfigError
from zacoustic.text.allowed import allowed, find, mark, table_of, variants

SECTION: Final = "plugins.acoustic"
"""Name of the section's own table."""

_WORDS: Final[dict[type[inspect.Type], str]] = {
    inspect.BoolType: "true or false",
    inspect.IntType: "number",
    inspect.FloatType: "number",
    inspect.StrType: "text",
    inspect.EnumType: "text",
    inspect.LiteralType: "text",
    inspect.VarTupleType: "list",
    inspect.TupleType: "list",
    inspect.DictType: "table",
    inspect.StructType: "table",
}


class KeyRow(msgspec.Struct, frozen=True, kw_only=True):
    """One key."""

    key: str
    """Its text in the file."""
    type: str
    """`number`, `seconds`, `text`, `true or false`, `list`, `table`, `value`."""
    default: str | None
    """Its text in the file; "": no default value, None: the key is required."""
    allowed: str
    """Allowed values, in words; empty: any of the type."""
    meaning: str
    """Its meaning."""


class KeyTable(msgspec.Struct, frozen=True, kw_only=True):
    """One table of the file."""

    name: str
    """Its place: keys from the section down, such as `links.access (tdma)`."""
    meaning: str
    """Meaning of an entry."""
    rows: tuple[KeyRow, ...]
    """Its keys, in the order of the record."""


def tables() -> tuple[KeyTable, ...]:
    """Return all tables, the section first."""
    return tuple(_table(name, record, less) for name, record, less in records())


def table_named(name: str) -> KeyTable:
    """Return one table.

    Args:
        name: Its name in `tables`, or the last part of it.

    Raises:
        ConfigError: There is no such table; lists the names.
    """
    known = {table.name: table for table in tables()}
    name = next((each for each in known if each.endswith(f".{name}")), name)
    if name not in known:
        close = get_close_matches(name, known, 1)
        raise ConfigError(
            f'no table is called "{name}"; there are: {", ".join(known)}',
            hint=f'did you mean "{close[0]}"?' if close else "",
        )
    return known[name]


def records() -> Iterator[tuple[str, type[msgspec.Struct], tuple[str, ...]]]:
    """Yield name, record, and the keys that an earlier table has already, of each table."""
    seen: set[type[msgspec.Struct]] = set()
    for name, record, less in _below(SECTION, Section, ()):
        if record not in seen:
            seen.add(record)
            yield name, record, less


_Found = Iterator[tuple[str, type[msgspec.Struct], tuple[str, ...]]]


def _below(name: str, record: type[msgspec.Struct], less: tuple[str, ...]) -> _Found:
    """Yield the table of a record and the tables below it."""
    yield name, record, less
    for field in table_of(record).fields:
        if field.encode_name in less:
            continue
        path = name.partition(" ")[0]
        inner = field.encode_name if path == SECTION else f"{path}.{field.encode_name}"
        item = find(field.type, [0]) or field.type
        marked = mark(item, "tables")
        if marked:
            yield from _below(inner, StreamEntry, ())
            for kind, entry in marked.items():
                yield from _below(f"{inner} ({kind})", entry, StreamEntry.__struct_encode_fields__)
        for each in variants(item):
            if isinstance(each, inspect.StructType):
                yield from _below(f"{inner} ({each.tag})" if each.tag else inner, each.cls, ())


def _table(name: str, record: type[msgspec.Struct], less: tuple[str, ...]) -> KeyTable:
    kind, meanings = table_of(record), meanings_of(record)
    rows = [
        KeyRow(
            key=field.encode_name,
            type=_type(field.encode_name, field.type),
            default=_default(field),
            allowed=allowed(field.type),
            meaning=meanings.get(field.name, ""),
        )
        for field in kind.fields
        if field.encode_name not in less
    ]
    if kind.tag_field is not None:
        words = {"type": "text", "default": None, "allowed": f'"{kind.tag}"', "meaning": "Which."}
        rows.insert(0, msgspec.convert({"key": kind.tag_field, **words}, KeyRow))
    meaning = (record.__doc__ or "").partition("\n")[0]
    return KeyTable(name=name, meaning=meaning, rows=tuple(rows))


def _type(key: str, kind: inspect.Type) -> str:
    kinds = [each for each in variants(kind) if type(each) in _WORDS]
    words = dict.fromkeys(_WORDS[type(each)] for each in kinds)
    if key.endswith("_s") and any(isinstance(each, inspect.FloatType) for each in kinds):
        return "seconds"
    return " or ".join(words) if 1 <= len(words) <= 2 else "value"


def _default(field: inspect.Field) -> str | None:
    if field.required:
        return None
    value: Any = field.default
    if value is msgspec.NODEFAULT:
        value = field.default_factory() if callable(field.default_factory) else None
    return "" if value is None else json.dumps(msgspec.to_builtins(value), ensure_ascii=False)
