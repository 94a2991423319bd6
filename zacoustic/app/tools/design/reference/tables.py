"""The tables of the section `plugins.acoustic`, key by key."""

import json
from collections.abc import Iterator
from difflib import get_close_matches
from types import NoneType, UnionType
from typing import Any, Final, Union, get_args, get_origin

import msgspec

from zacoustic.app.tools.design.reference.meanings import meanings_of
from zacoustic.config.problems import allowed_at
from zacoustic.config.sections import (
    RECORDS,
    ActionEntry,
    ServiceEntry,
    StreamEntry,
    TopicEntry,
)
from zacoustic.core.schedule.access.spec import METHODS
from zacoustic.errors import ConfigError

SECTION: Final = "plugins.acoustic"
"""Name of the section's own table."""

_WORDS: Final = {
    bool: "true or false",
    int: "number",
    float: "number",
    str: "text",
    tuple: "list",
    dict: "table",
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
    return tuple(_table(name, path, record, less) for name, path, record, less in _records())


def table_named(name: str) -> KeyTable:
    """Return one table.

    Args:
        name: Its name in `tables`.

    Raises:
        ConfigError: There is no such table; lists the names.
    """
    known = {table.name: table for table in tables()}
    if name not in known:
        close = get_close_matches(name, known, 1)
        raise ConfigError(
            f'no table is called "{name}"; there are: {", ".join(known)}',
            hint=f'did you mean "{close[0]}"?' if close else "",
        )
    return known[name]


def _records() -> Iterator[tuple[str, str, type[msgspec.Struct], tuple[str, ...]]]:
    """Yield name, path of the keys, record, and the keys that an earlier table has already."""
    below = {"fields": "types", "wildcards": "streams"}
    for place, record in RECORDS.items():
        name = f"{below[place]}.{place}" if place in below else place or SECTION
        yield name, place, record, ()
        if place == "links":
            for method, spec in METHODS.items():
                yield f"links.access ({method})", "links.access", spec, ()
        if place == "fields":
            common = StreamEntry.__struct_encode_fields__
            yield "streams", "streams", StreamEntry, ()
            yield "streams (topic)", "streams", TopicEntry, common
            yield "streams (service)", "streams", ServiceEntry, common
            yield "streams (action)", "streams", ActionEntry, common


def _table(name: str, path: str, record: type[msgspec.Struct], less: tuple[str, ...]) -> KeyTable:
    meanings = meanings_of(record)
    rows = []
    for field in msgspec.structs.fields(record):
        if field.encode_name in less:
            continue
        rows.append(
            KeyRow(
                key=field.encode_name,
                type=_type(field.encode_name, field.type),
                default=_default(field),
                allowed=allowed_at(f".{path}.{field.encode_name}"),
                meaning=meanings.get(field.name, ""),
            )
        )
    meaning = (record.__doc__ or "").partition("\n")[0]
    if path == "links.access":
        method = record.__struct_config__.tag
        rows.insert(
            0,
            KeyRow(
                key="method", type="text", default=None, allowed=f'"{method}"', meaning="Which."
            ),
        )
    return KeyTable(name=name, meaning=meaning, rows=tuple(rows))


def _type(key: str, annotation: object) -> str:
    if get_origin(annotation) in (Union, UnionType):
        kinds = [each for each in get_args(annotation) if each is not NoneType]
        words = {_type(key, each): None for each in kinds}
        return " or ".join(words) if len(words) <= 2 else "value"
    origin = get_origin(annotation) or annotation
    if origin is float and key.endswith("_s"):
        return "seconds"
    if isinstance(origin, type) and issubclass(origin, msgspec.Struct):
        return "table"
    return _WORDS.get(origin, "value") if isinstance(origin, type) else "value"


def _default(field: "msgspec.structs.FieldInfo") -> str | None:
    if field.required:
        return None
    value: Any = field.default
    if value is msgspec.NODEFAULT:
        value = field.default_factory() if callable(field.default_factory) else None
    return "" if value is None else json.dumps(msgspec.to_builtins(value), ensure_ascii=False)
