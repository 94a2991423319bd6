"""A recording in MCAP as lines: the JSON values of topics, from any program, and bags of ROS 2.

In a node's own recording its published samples count, and received ones only if no publisher of the
topic is in the file, so each sample appears once. Topics of other programs keep their names.
"""

import re
from collections.abc import Iterator
from typing import Final, NamedTuple

import msgspec

from zacoustic.app.tools.design.telemetry.line import Cdr, Line
from zacoustic.run.recording.reading import ReadMessage, RecordingReader

_CDR: Final = "cdr"
_OURS: Final = re.compile(r"/([0-9]{1,3})/(published|received)/(.+)")
_NO_VALUES: Final = re.compile(
    r"/\d+/(engine|frames|reports|links|events|ledger)|/samples|/table|/@acoustic/.*"
)


class _Place(NamedTuple):
    key: str
    rank: tuple[int, int]
    """Order of preference: published before received, and of receivers the first node."""


def read_mcap(path: str) -> Iterator[Line]:
    """Read the values of a recording.

    Raises:
        ConfigError: It cannot be read.
    """
    best: dict[str, tuple[int, int]] = {}
    first_ns: int | None = None
    for message in RecordingReader(path, tells=False):
        place = _place(message)
        if place is not None:
            best[place.key] = min(best.get(place.key, place.rank), place.rank)
            first_ns = message.utc_ns if first_ns is None else first_ns
    for number, message in enumerate(RecordingReader(path), 1):
        place = _place(message)
        if place is None or best.get(place.key) != place.rank:
            continue
        at_s = (message.utc_ns - (first_ns or 0)) / 1e9
        if message.encoding == _CDR:
            yield Line(f"{path}: message {number}", at_s, place.key, Cdr(message.data))
            continue
        try:
            value = msgspec.json.decode(message.data)
        except (msgspec.DecodeError, RecursionError):
            continue
        yield Line(f"{path}: message {number}", at_s, place.key, value)


def _place(message: ReadMessage) -> _Place | None:
    """Return the place of a message's value; None: it is no value."""
    if message.encoding not in ("json", _CDR):
        return None
    ours = _OURS.fullmatch(message.topic)
    if ours is not None:
        node, word, key = ours.groups()
        # A node's published samples are its own, whoever else publishes under that name.
        return _Place(key, (0, 0) if word == "published" else (1, int(node)))
    if _NO_VALUES.fullmatch(message.topic):
        return None
    return _Place(message.topic.lstrip("/"), (0, 0))
