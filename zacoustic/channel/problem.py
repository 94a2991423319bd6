"""Messages of the mapping converter, reworded for users of a file.

The converter names what it expected and where. A user needs the key path, the present value and the
allowed values, in one line. Messages of our own records begin with the key ("frame is 2.0; allowed:
0..1"); they only get their path.
"""

import re
from collections.abc import Mapping
from typing import Final

import msgspec

_LOCATED: Final = re.compile(
    r"(?P<what>.*?)(?: - at (?P<key>`key` in )?`\$\.?(?P<path>[^`]*)`)?", re.DOTALL
)
_UNKNOWN_KEY: Final = re.compile(r"Object contains unknown field `(?P<key>.*)`", re.DOTALL)
_MISSING_KEY: Final = re.compile(r"Object missing required field `(?P<key>.*)`", re.DOTALL)
_KEYED: Final = re.compile(r"[a-z][\w.\[\]]* is ")
_STEP: Final = re.compile(r"(?P<key>[a-z_]\w*)|\[(?P<index>\d+)\]")
_MAX_SHOWN: Final = 60  # characters of a value


def explain(
    message: str,
    mapping: object,
    *,
    records: Mapping[str, type[msgspec.Struct]],
    choices: Mapping[str, tuple[str, ...]],
    whole: str = "the scenario",
) -> str:
    """Turn a message of the converter into key path, value, and allowed values.

    Args:
        message: Text of the converter's error.
        mapping: The converted mapping, to look the value up in.
        records: Path without indices ("nodes[].track[]") → the record expected there.
        choices: Path without indices → the words allowed there.
        whole: Name of the whole mapping.

    Returns:
        One line without the name of the file.
    """
    located = _LOCATED.fullmatch(message)
    assert located is not None
    what, path = located["what"], located["path"] or ""
    if located["key"]:
        return f"{path or whole} has a key that is no string; allowed: strings"
    place = re.sub(r"\d+", "", path)
    if match := _UNKNOWN_KEY.fullmatch(what):
        fields = msgspec.structs.fields(records[place]) if place in records else ()
        allowed = ", ".join(field.encode_name for field in fields)
        return f"{_joined(path, match['key'])} is no key; allowed: {allowed}"
    if match := _MISSING_KEY.fullmatch(what):
        return f"{_joined(path, match['key'])} is missing; it is required"
    if _KEYED.match(what):
        return _joined(path, what)
    if place in choices:
        expected = ", ".join(choices[place])
    else:
        expected = what.removeprefix("Expected ").split(", got ")[0].replace("`", "")
        expected = expected.replace("Number out of range", "a number that a float can hold")
    return f"{path or whole} is {_shown(_value_at(mapping, path))}; allowed: {expected}"


def _joined(path: str, key: str) -> str:
    # A key of the file may contain anything, even line ends.
    printable = key if key.isprintable() else repr(key)
    return f"{path}.{printable}" if path else printable


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _MAX_SHOWN else f"{text[:_MAX_SHOWN]}…"


def _value_at(mapping: object, path: str) -> object:
    value = mapping
    for step in _STEP.finditer(path):
        if step["key"] is not None and isinstance(value, dict):
            value = value.get(step["key"])
        elif step["index"] is not None and isinstance(value, list | tuple):
            value = value[int(step["index"])]
    return value
