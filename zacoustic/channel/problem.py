"""Messages of the mapping converter, reworded for users of a file.

The converter names what it expected and where. A user needs the key path, the present value and the
allowed values, in one line. Messages of our own records begin with the key ("frame is 2.0; allowed:
0..1"); they only get their path.
"""

import re
from typing import Final

import msgspec

from zacoustic.text.allowed import allowed, find, located, steps_of, table_of, tables

_UNKNOWN_KEY: Final = re.compile(r"Object contains unknown field `(?P<key>.*)`", re.DOTALL)
_MISSING_KEY: Final = re.compile(r"Object missing required field `(?P<key>.*)`", re.DOTALL)
_KEYED: Final = re.compile(r"[a-z][\w.\[\]]* is ")
_MAX_SHOWN: Final = 60  # characters of a value


def explain(
    error: Exception, mapping: object, record: type[msgspec.Struct], whole: str = "the scenario"
) -> str:
    """Turn an error of the converter into key path, value, and allowed values.

    Args:
        error: The error.
        mapping: The converted mapping, to look the value up in.
        record: The record expected in its place, whose fields declare the allowed values.
        whole: Name of the whole mapping.

    Returns:
        One line without the name of the file.
    """
    what, place = located(error)
    steps, path = steps_of(place), place.removeprefix(".")
    kind = find(table_of(record), steps, mapping)
    if what == "Expected `str`" and "`key` in" in str(error):
        return f"{path or whole} has a key that is no string; allowed: strings"
    if (match := _UNKNOWN_KEY.fullmatch(what)) and kind is not None:
        keys = ", ".join(each.encode_name for each in next(tables(kind)).fields)
        return f"{_joined(path, match['key'])} is no key; allowed: {keys}"
    if match := _MISSING_KEY.fullmatch(what):
        return f"{_joined(path, match['key'])} is missing; it is required"
    if _KEYED.match(what):
        return _joined(path, what)
    expected = "" if kind is None else allowed(kind)
    if what == "Number out of range":
        expected = "a number that a float can hold"
    return f"{path or whole} is {_shown(_value_at(mapping, steps))}; allowed: {expected}"


def _joined(path: str, key: str) -> str:
    # A key of the file may contain anything, even line ends.
    printable = key if key.isprintable() else repr(key)
    return f"{path}.{printable}" if path else printable


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _MAX_SHOWN else f"{text[:_MAX_SHOWN]}…"


def _value_at(value: object, steps: list[str | int]) -> object:
    for step in steps:
        if isinstance(step, str) and isinstance(value, dict):
            value = value.get(step)
        elif isinstance(step, int) and isinstance(value, list | tuple):
            value = value[step]
    return value
