"""Errors of a section: one line with file, key path, value, allowed values, what to do.

Errors come from the checks of `reading`, which know the path; from records that refuse their
values, whose message starts with the key; and from msgspec, whose messages end with a path of its
own. Here all become a `ConfigError` of one form::

    fleet.json5: plugins.acoustic.streams[3].priority: "urgent"; allowed: real_time, … (hint)
"""

import json
import re
from difflib import get_close_matches
from typing import Any, Final, NoReturn, TypeVar

import msgspec

from zacoustic.config.sections import ALLOWED, FIELD_TYPE_ALLOWED, FOLDER_ALLOWED, RECORDS
from zacoustic.errors import ConfigError

SECTION_PATH: Final = "plugins.acoustic"
"""Path of the section in the file."""

_SHOWN_CHARACTERS: Final = 60  # of a value: enough to find it, and still one line
_MSGSPEC_PATH: Final = re.compile(r"(.*) - at `(?:key in )?\$(.*)`", re.DOTALL)
_UNKNOWN: Final = re.compile(r"Object contains unknown field `(.*)`", re.DOTALL)
_MISSING: Final = re.compile(r"Object missing required field `(.*)`", re.DOTALL)
_STEPS: Final = re.compile(r"\.(\w+)|\[(\d+)\]")
_WRITTEN_KEY: Final = re.compile(r"[\w.\[\]]+")

Entry = TypeVar("Entry", bound=msgspec.Struct)


class Place:
    """A place in the section: file, path, and the value there.

    Args:
        source: The file, or another source of the section.
        written: The whole section.
        path: Keys and indices from the section to the place, such as ``.streams[3]``.
    """

    def __init__(self, source: str, written: object, path: str = "") -> None:
        self.source = source
        self._whole = written
        self.path = path

    @property
    def written(self) -> Any:  # noqa: ANN401 (a file can hold anything)
        """The value at the place; None: there is none."""
        return _walk(self._whole, self.path)

    @property
    def entries(self) -> list[object]:
        """The items of the list at this place; empty if it is not a list."""
        written = self.written
        return list(written) if isinstance(written, list | tuple) else []

    def at(self, key: str | int) -> "Place":
        """Return the place of a key of this table, or of an index of this list."""
        step = f"[{key}]" if isinstance(key, int) else f".{key}"
        return Place(self.source, self._whole, self.path + step)

    def refuse(self, what: str | None = None, *, allowed: str = "", hint: str = "") -> NoReturn:
        """Raise the error about this place.

        Args:
            what: What is wrong; default: the value here.
            allowed: The allowed values.
            hint: What to do.

        Raises:
            ConfigError: Always.
        """
        message = f"{self.source}: {SECTION_PATH}{self.path}: {what or shown(self.written)}"
        raise ConfigError(f"{message}; allowed: {allowed}" if allowed else message, hint=hint)

    def repeat(self, error: ConfigError) -> NoReturn:
        """Raise the error of a record or a table, whose message starts with a key, with its place.

        Raises:
            ConfigError: Always.
        """
        key, colon, rest = str(error.args[0]).partition(": ")
        place = self if not colon or not _WRITTEN_KEY.fullmatch(key) else self.at(key)
        place.refuse(rest if place is not self else str(error.args[0]), hint=error.hint)

    def convert(self, record: type[Entry]) -> Entry:
        """Convert the value here.

        Raises:
            ConfigError: The value does not fit the record.
        """
        try:
            return msgspec.convert(self.written, record)
        except msgspec.ValidationError as error:
            _translate(self, record, error)


def shown(value: object) -> str:
    """Return a value in the form of the file: one line, not too long."""
    try:
        text = json.dumps(value, ensure_ascii=False, default=lambda other: type(other).__name__)
    except (ValueError, TypeError, RecursionError):
        text = type(value).__name__
    return _printable(text)


RENAMED: Final = {"orders_from": "commands_from"}
"""Former keys and their present names."""


def unknown_key(place: Place, key: str, keys: tuple[str, ...]) -> NoReturn:
    """Raise the error about a key that the table at `place` does not have.

    Raises:
        ConfigError: Always.
    """
    close = [RENAMED[key]] if RENAMED.get(key) in keys else get_close_matches(key, keys, 1)
    place.at(_printable(key)).refuse(
        "unknown key",
        allowed=", ".join(keys),
        hint=f'did you mean "{close[0]}"?' if close else "",
    )


def allowed_at(path: str) -> str:
    """Return the allowed values at a path in words; empty if they are unknown."""
    steps = _STEPS.findall(path)
    names = [name for name, _ in steps if name]
    if not names:
        return ""
    if names[-1] == "type" and "fields" in names:
        return FIELD_TYPE_ALLOWED
    if names == ["journal"]:
        return FOLDER_ALLOWED
    if names == ["quiet", "to"]:
        return ALLOWED["from"]
    if names[-2:] == ["access", "nodes"]:
        return ALLOWED["slots"]
    return ALLOWED.get(names[-1], "")


def _translate(
    place: Place, record: type[msgspec.Struct], error: msgspec.ValidationError
) -> NoReturn:
    """Raise an error of msgspec about a value below `place`, in our words.

    Raises:
        ConfigError: Always.
    """
    found = _MSGSPEC_PATH.fullmatch(str(error))
    message, path = (found[1], found[2]) if found else (str(error), "")
    below = Place(place.source, place._whole, place.path + path)
    unknown, missing = _UNKNOWN.fullmatch(message), _MISSING.fullmatch(message)
    if unknown:
        lists = [name for name, _ in _STEPS.findall(path) if name]
        outer = ".".join([name for name, _ in _STEPS.findall(below.path) if name][-2:])
        table = (RECORDS.get(outer) or RECORDS[lists[-1]]) if lists else record
        unknown_key(below, unknown[1], table.__struct_encode_fields__)
    if missing:
        key = below.at(missing[1])
        key.refuse("is missing", allowed=allowed_at(key.path))
    if isinstance(error.__cause__, ConfigError):
        below.repeat(error.__cause__)
    below.refuse(allowed=allowed_at(below.path) or _one_line(message.replace("`", "")))


def _walk(written: object, path: str) -> Any:  # noqa: ANN401 (a file can hold anything)
    for name, index in _STEPS.findall(path):
        if name and isinstance(written, dict):
            written = written.get(name)
        elif index and isinstance(written, list | tuple) and int(index) < len(written):
            written = written[int(index)]
        else:
            return None
    return written


def _printable(text: str) -> str:
    text = text if len(text) <= _SHOWN_CHARACTERS else f"{text[: _SHOWN_CHARACTERS - 1]}…"
    return "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text
    )


def _one_line(text: str) -> str:
    return " ".join(text.split())
