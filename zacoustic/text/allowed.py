"""Allowed values of a key, in words, from the declaration of its field.

A field states its range once, where it is declared::

    max_airtime: Annotated[float, Meta(gt=0, le=1, title="a share")] | None = None

msgspec applies the range when it converts a file, and puts it into a JSON Schema. This module says
it in words, for errors and pages, and applies it to records that a program makes. `title` is the
noun before a range, here "a share, above 0, at most 1"; `description` replaces all of the words;
without either they follow from the type.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from typing import Any, Final

import msgspec
from msgspec import Meta, inspect

ANY: Final = "a value"
"""Words of a type that declares nothing, and is none of those that have words."""
_FAR: Final = 1e9
"""Upper bounds from here on are named after the lower one: hardly anybody meets them."""
_FINITE: Final = 1e300
"""Upper bounds from here on only mean that a number is finite: they are not named."""
_SHOWN_CHARACTERS: Final = 60  # of a value
_PATH: Final = re.compile(r"(.*) - at (?:`key` in )?`\$(.*)`", re.DOTALL)
_STEPS: Final = re.compile(r"\.(\w+)|\[(\d+)\]")

_Record = type[msgspec.Struct]
_BOUNDS: Final = ("gt", "ge", "lt", "le", "pattern", "min_length", "max_length")
_CONTAINERS: Final = (inspect.VarTupleType, inspect.ListType)


def one_of(words: Iterable[str]) -> Meta:
    """Return the declaration of a text that is one of a few words."""
    listed = tuple(words)
    # Python's `$` stands before a last line break, too.
    pattern = rf"^({'|'.join(map(re.escape, listed))})$(?!\n)"
    enum = {"enum": list(listed)}  # what editors complete
    return Meta(pattern=pattern, description=", ".join(listed), extra_json_schema=enum)


def allowed(kind: inspect.Type) -> str:
    """Return the allowed values of a type in words; empty for None."""
    said, _, inner = _unwrapped(kind)
    if "description" in said:
        return str(said["description"])
    noun = said.get("title", "")
    match inner:
        case inspect.NoneType():
            return ""
        case inspect.UnionType(types=kinds):
            return _union(kinds)
        case inspect.BoolType():
            return "true, false"
        case inspect.EnumType(cls=words):
            return ", ".join(str(each.value) for each in words)
        case inspect.LiteralType(values=values):
            return ", ".join(map(str, values))
        case inspect.IntType() | inspect.FloatType():
            within = _range(inner)
            plain = "a whole number" if isinstance(inner, inspect.IntType) else "a number"
            return f"{noun or 'a number'}, {within}" if within else noun or plain
        case inspect.StrType():
            return noun or "a text"
        case inspect.StructType():
            return _table(inner.fields)
        case inspect.TupleType(item_types=items):
            return noun or f"a list of {len(items)} values"
        case inspect.VarTupleType(item_type=item) | inspect.ListType(item_type=item):
            return (noun or _list(item)) + _length(inner)
    return noun or ANY


def mark(kind: inspect.Type, name: str) -> Any:  # noqa: ANN401 (of the declaration)
    """Return a mark of a declaration, `Meta(extra={name: …})`; None: it has none."""
    marks = (_unwrapped(each)[1].get(name) for each in (kind, *variants(kind)))
    return next((each for each in marks if each is not None), None)


def variants(kind: inspect.Type) -> tuple[inspect.Type, ...]:
    """Return the types that a union joins, each with its declaration and without; or the type."""
    inner = _unwrapped(kind)[2]
    if isinstance(inner, inspect.UnionType):
        joined = (each for every in inner.types for each in (every, *variants(every)))
        return tuple({id(each): each for each in joined}.values())
    return (inner,)


def steps_of(path: str) -> list[str | int]:
    """Return the keys and indices of a path such as ``.streams[3].topic``."""
    return [int(index) if index else name for name, index in _STEPS.findall(path)]


def located(error: Exception) -> tuple[str, str]:
    """Return the message and the path of an error of the converter."""
    found = _PATH.fullmatch(str(error))
    return (found[1], found[2]) if found else (str(error), "")


def find(
    kind: inspect.Type, steps: Sequence[str | int], written: object = None
) -> inspect.Type | None:
    """Return the declaration at a path below a type; None: there is none.

    Args:
        kind: The type of the whole.
        steps: Keys and indices.
        written: The value of the whole: its tag tells which table of several it is.
    """
    if not steps:
        return kind
    step, rest = steps[0], steps[1:]
    for each in variants(kind):
        if isinstance(step, int) and isinstance(each, _CONTAINERS):
            value = written[step] if isinstance(written, list | tuple) else None
            return find(each.item_type, rest, value)
        if isinstance(step, int) and isinstance(each, inspect.TupleType):
            return each.item_types[step]
    if isinstance(step, str):
        tags = tuple(each.tag for each in tables(kind) if each.tag_field == step)
        if tags:
            return inspect.LiteralType(tags)
        value = written.get(step) if isinstance(written, dict) else None
        for table in tables(kind, written):
            for field in table.fields:
                if field.encode_name == step:
                    return find(field.type, rest, value)
    return None


def tables(kind: inspect.Type, written: object = None) -> Iterator[inspect.StructType]:
    """Yield the tables that a type can be, first the one that a value says it is.

    A table of plain keys lists its records in the mark `tables`, by the key that tells them.
    """
    said = written if isinstance(written, dict) else {}
    marked = {key: table_of(each) for key, each in (mark(kind, "tables") or {}).items()}
    found = [each for each in variants(kind) if isinstance(each, inspect.StructType)]
    yield from (each for key, each in marked.items() if key in said)
    yield from (each for each in found if each.tag and said.get(each.tag_field) == each.tag)
    yield from (*marked.values(), *found)


@cache
def table_of(record: _Record) -> inspect.StructType:
    """Return the declarations of a record."""
    kind = inspect.type_info(record)
    assert isinstance(kind, inspect.StructType)
    return kind


def check_fields(record: msgspec.Struct, error: type[ValueError] = ValueError) -> None:
    """Check a record that a program makes, whose constructor checks nothing.

    Args:
        record: The record.
        error: Class of the error. Its own classes have "KEY: VALUE", as errors of a file, and
            ValueError "KEY is VALUE".

    Raises:
        ValueError: A value is not allowed; states key, value and what is allowed.
    """
    join = " is " if error is ValueError else ": "
    for name, annotation, kind in _limited(type(record)):
        value = getattr(record, name)
        try:
            msgspec.convert(value, annotation)
        except msgspec.ValidationError as refusal:
            steps = steps_of(located(refusal)[1])
            for step in steps:
                name += f"[{step}]"
                value = value[step]
            words = allowed(find(kind, steps) or kind)
            raise error(f"{name}{join}{_short(value)}; allowed: {words}") from None
        again = repeated(value, kind)
        if again is not None:
            what = f"{name}[{again}]{join}{value[again]} a second time"
            raise error(f"{what}; allowed: each once")


def repeated(value: object, kind: inspect.Type) -> int | None:
    """Return the index of an item that is in a list before, if its declaration has each once."""
    if not isinstance(value, tuple) or not mark(kind, "unique"):
        return None
    return next((index for index, each in enumerate(value) if each in value[:index]), None)


@cache
def _limited(record: _Record) -> tuple[tuple[str, Any, inspect.Type], ...]:
    """Return name, annotation and declaration of each field that states limits."""
    kinds = {each.name: each.type for each in table_of(record).fields}
    return tuple(
        (each.name, each.type, kinds[each.name])
        for each in msgspec.structs.fields(record)
        if _has_limits(kinds[each.name])
    )


def _short(value: object) -> str:
    text = f'"{value}"' if isinstance(value, str) else str(value)
    return text if len(text) <= _SHOWN_CHARACTERS else f"{text[: _SHOWN_CHARACTERS - 1]}…"


def _has_limits(kind: inspect.Type) -> bool:
    """Return whether a type says more than the kind of a value."""
    for each in (kind, *variants(kind)):
        if isinstance(each, _CONTAINERS) and _has_limits(each.item_type):
            return True
        if any(getattr(each, bound, None) is not None for bound in _BOUNDS):
            return True
    return False


def _unwrapped(kind: inspect.Type) -> tuple[dict[str, Any], dict[str, Any], inspect.Type]:
    """Return words and marks of a declaration, and its type; the outer ones count."""
    said: dict[str, Any] = {}
    extra: dict[str, Any] = {}
    while isinstance(kind, inspect.Metadata):
        said = {**(kind.extra_json_schema or {}), **said}
        extra = {**(kind.extra or {}), **extra}
        kind = kind.type
    return said, extra, kind


def _union(kinds: Sequence[inspect.Type]) -> str:
    """Return the words of several types; of tables that a tag tells, the tags."""
    tagged = [each for each in kinds if isinstance(each, inspect.StructType) and each.tag]
    # Whole numbers are numbers.
    said = tagged + ([inspect.IntType()] if inspect.FloatType() in kinds else [])
    words = [allowed(each) for each in kinds if each not in said]
    if tagged:
        tags = " | ".join(f'"{each.tag}"' for each in tagged)
        words.insert(0, f"{{ {tagged[0].tag_field}: {tags}, … }}")
    return " or ".join(filter(None, dict.fromkeys(words)))


def _table(fields: Iterable[inspect.Field]) -> str:
    return f"{{ {', '.join(each.encode_name for each in fields)} }}"


def _list(item: inspect.Type) -> str:
    """Return the words of a list; of tables it says only the keys that they must have."""
    if not isinstance(item, inspect.StructType):
        words = allowed(item)
        return f"a list, each {words}" if words.startswith("a ") else f"a list of {words}"
    must = [each.encode_name for each in item.fields if each.required]
    more = ["…"] if len(must) < len(item.fields) else []
    return f"a list of {{ {', '.join([*must, *more])} }}"


def _length(kind: inspect.VarTupleType | inspect.ListType) -> str:
    least, most = kind.min_length, kind.max_length
    if least is None:
        return "" if most is None else f", at most {most}"
    return f", at least {least}" if most is None else f", {least}..{most} of them"


def _range(kind: inspect.IntType | inspect.FloatType) -> str:
    most = kind.le if kind.le is not None and kind.le < _FINITE else None
    at_most = "" if most is None else f", at most {_number(most)}"
    if kind.gt is not None:
        return f"above {_number(kind.gt)}{at_most}"
    if kind.ge is None:
        return at_most.removeprefix(", ")
    if most is None or most >= _FAR:
        return f"{_number(kind.ge)} or more{at_most}"
    return f"{_number(kind.ge)}..{_number(most)}"


def _number(value: float) -> str:
    """Return a bound as people write it: no point in whole numbers, no row of zeros."""
    if isinstance(value, int):
        return str(value)
    return f"{value:.15g}" if value < _FAR else f"{value:g}"
