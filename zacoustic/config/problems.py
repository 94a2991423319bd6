"""Errors of a section: one line with file, key path, value, allowed values, what to do.

Errors come from msgspec, which applies the declarations of the fields and ends its message with a
path; from records that refuse their values, whose message starts with the key; and from the checks
of `reading`, which know the path. Here all become a `ConfigError` of one form, with the allowed
values that the field declares::

    fleet.json5: plugins.acoustic.streams[3].priority: "urgent"; allowed: real_time, … (hint)
"""

import json
import re
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final, NoReturn, TypeVar

import msgspec

from zacoustic.config.sections import Section
from zacoustic.errors import ConfigError
from zacoustic.text.allowed import allowed as words_of
from zacoustic.text.allowed import find, located, mark, steps_of, table_of, tables

SECTION_PATH: Final = "plugins.acoustic"
"""Path of the section in the file."""

_SHOWN_CHARACTERS: Final = 60  # of a value: enough to find it, and still one line
_UNKNOWN: Final = re.compile(r"Object contains unknown field `(.*)`", re.DOTALL)
_MISSING: Final = re.compile(r"Object missing required field `(.*)`", re.DOTALL)
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
        return _walk(self._whole, steps_of(self.path))

    @property
    def allowed(self) -> str:
        """The allowed values in words: the nodes of the fleet, or what the field declares."""
        kind = self._kind
        if kind is None:
            return ""
        fleet = Place(self.source, self._whole, ".nodes").items
        nodes = [(each.at("address").written, each.at("name").written) for each in fleet]
        if mark(kind, "refers") in ("nodes", "own") and nodes:
            return ", ".join(_printable(f"{address} ({name})") for address, name in nodes)
        return words_of(kind)

    @property
    def hint(self) -> str:
        """What to do, as the field declares, or which of its words is nearly the one here."""
        declared = mark(self._kind, "hint") if self._kind is not None else None
        words = [each for each in self.allowed.split(", ") if " " not in each]
        close = get_close_matches(self.written, words, 1) if isinstance(self.written, str) else []
        return str(declared or "") or (f'did you mean "{close[0]}"?' if close else "")

    @property
    def items(self) -> "list[Place]":
        """The places of the items of the list here; empty if it is not a list."""
        written = self.written
        count = len(written) if isinstance(written, list | tuple) else 0
        return [self.at(index) for index in range(count)]

    def at(self, key: str | int) -> "Place":
        """Return the place of a key of this table, or of an index of this list."""
        step = f"[{key}]" if isinstance(key, int) else f".{key}"
        return Place(self.source, self._whole, self.path + step)

    def refuse(self, what: str | None = None, *, allowed: str = "", hint: str = "") -> NoReturn:
        """Raise the error about this place.

        Args:
            what: What is wrong; default: the value here, which is not what the key declares.
            allowed: The allowed values.
            hint: What to do.

        Raises:
            ConfigError: Always.
        """
        if what is None:
            what = shown(self.written)
            hint = hint or ("" if allowed else self.hint)
            allowed = allowed or self.allowed
        message = f"{self.source}: {SECTION_PATH}{self.path}: {what}"
        raise ConfigError(f"{message}; allowed: {allowed}" if allowed else message, hint=hint)

    def repeat(self, error: ConfigError) -> NoReturn:
        """Raise the error of a record or a table, whose message starts with a key, with its place.

        Raises:
            ConfigError: Always.
        """
        key, colon, rest = str(error.args[0]).partition(": ")
        place = self if not colon or not _WRITTEN_KEY.fullmatch(key) else self.at(key)
        what = rest if place is not self else str(error.args[0])
        place.refuse(what, hint=error.hint)

    def convert(self, record: type[Entry]) -> Entry:
        """Convert the value here.

        Raises:
            ConfigError: The value does not fit the record.
        """
        try:
            return msgspec.convert(self.written, record)
        except msgspec.ValidationError as error:
            _translate(self, record, error)

    def path_of(self, written: str, folder: Path) -> Path:
        """Return the path of the file or folder that is named here; ``~`` is a home.

        Args:
            written: The name.
            folder: Folder to which it is relative.

        Raises:
            ConfigError: This computer does not know whose home.
        """
        try:
            return folder / Path(written).expanduser()
        except RuntimeError:
            self.refuse(hint="write it out")

    def content(self, folder: Path, most_bytes: int) -> bytes:
        """Return the content of the file that is named here.

        Args:
            folder: Folder to which the name is relative.
            most_bytes: Largest size, bytes.

        Raises:
            ConfigError: There is no such file, or it is larger.
        """
        try:
            content = self.path_of(self.written, folder).read_bytes()
        except OSError as error:
            what = f"{self.written}: {error.strerror}"
            self.refuse(what, allowed=self.allowed, hint=self.hint)
        if len(content) > most_bytes:
            what = f"{self.written}: {len(content)} bytes"
            self.refuse(what, allowed=f"{most_bytes}", hint=self.hint)
        return content

    @property
    def _kind(self) -> msgspec.inspect.Type | None:
        return find(table_of(Section), steps_of(self.path), self._whole)


def shown(value: object) -> str:
    """Return a value in the form of the file: one line, not too long."""
    try:
        text = json.dumps(value, ensure_ascii=False, default=lambda other: type(other).__name__)
    except (ValueError, TypeError, RecursionError):
        text = type(value).__name__
    return _printable(text)


RENAMED: Final = {"orders_from": "commands_from"}
"""Former keys and their present names."""
LATER_VALUES: Final = {"stamp": ("time",)}
"""Words of the format that this version does not have yet, by key: refused by name, so that nobody
silently gets less. The version that adds a word removes it here."""


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


def _translate(
    place: Place, record: type[msgspec.Struct], error: msgspec.ValidationError
) -> NoReturn:
    """Raise an error of msgspec about a value below `place`, in our words.

    Raises:
        ConfigError: Always.
    """
    message, path = located(error)
    below = Place(place.source, place._whole, place.path + path)
    unknown, missing = _UNKNOWN.fullmatch(message), _MISSING.fullmatch(message)
    kind = find(table_of(record), steps_of(path), place.written)
    if unknown and kind is not None:
        table = next(tables(kind, below.written))
        unknown_key(below, unknown[1], tuple(each.encode_name for each in table.fields))
    if isinstance(error.__cause__, ConfigError):
        below.repeat(error.__cause__)
    if missing:
        here = below.at(missing[1])
        here.refuse("is missing", allowed=here.allowed, hint=here.hint)
    if below.written in LATER_VALUES.get(below.path.rpartition(".")[2], ()):
        what = f"{shown(below.written)} is not available yet"
        below.refuse(what, allowed=below.allowed, hint="a later version will have it")
    below.refuse()


def _walk(written: object, steps: list[str | int]) -> Any:  # noqa: ANN401 (of a file)
    for step in steps:
        if isinstance(step, str) and isinstance(written, dict):
            written = written.get(step)
        elif isinstance(step, int) and isinstance(written, list | tuple) and step < len(written):
            written = written[step]
        else:
            return None
    return written


def _printable(text: str) -> str:
    text = text if len(text) <= _SHOWN_CHARACTERS else f"{text[: _SHOWN_CHARACTERS - 1]}…"
    return "".join(
        letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text
    )
