"""Tracks in files: past or planned positions of a node, written by another program.

A track file is CSV with a header. Its columns ``t``, ``x``, ``y``, ``z`` are s since the beginning,
and m east, north and down; other columns are ignored. A scenario names it instead of way-points:
``track: "auv1.csv"``, relative to its own file.
"""

import csv
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from zacoustic.errors import ConfigError

COLUMNS: Final = ("t", "x", "y", "z")
MOST_WAYPOINTS: Final = 1_000_000


def with_tracks(mapping: object, folder: Path) -> object:
    """Return a scenario with the way-points of its track files.

    Args:
        mapping: The parsed scenario; not changed.
        folder: Folder of the track files.

    Raises:
        ConfigError: A file is missing or invalid; names file, line, column and value.
    """
    nodes = mapping.get("nodes") if isinstance(mapping, dict) else None
    if not (isinstance(mapping, dict) and isinstance(nodes, list)):
        return mapping
    return {**mapping, "nodes": [_with_track(node, folder) for node in nodes]}


def read_track(path: Path) -> list[dict[str, Any]]:
    """Return the way-points of a track file.

    Raises:
        ConfigError: It is missing or invalid.
    """
    try:
        if path.exists() and not path.is_file():
            raise ConfigError(f"{path} is no file; allowed: CSV with the columns t, x, y, z")
        with path.open(encoding="utf-8-sig", newline="") as file:
            waypoints = list(_waypoints(path, csv.DictReader(file)))
    except (OSError, ValueError, csv.Error) as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(
            f"{path}: {getattr(error, 'strerror', None) or error}",
            hint="a track is CSV with the columns t, x, y, z: s, and m east, north, down",
        ) from error
    if not waypoints:
        raise ConfigError(f"{path}: no line below the header; allowed: at least one way-point")
    return waypoints


def _with_track(node: object, folder: Path) -> object:
    if isinstance(node, dict) and isinstance(track := node.get("track"), str):
        return {**node, "track": read_track(folder / track)}
    return node


def _waypoints(path: Path, rows: "csv.DictReader[str]") -> Iterator[dict[str, Any]]:
    lacking = [name for name in COLUMNS if name not in (rows.fieldnames or ())]
    if lacking:
        there = ", ".join(map(repr, rows.fieldnames or ())) or "nothing"
        raise ConfigError(
            f"{path}:1: the header is {there[:80]}; allowed: a line with {', '.join(COLUMNS)}",
            hint="s since the beginning, and m east, north, down",
        )
    before_s = -math.inf
    for count, row in enumerate(rows):
        if count >= MOST_WAYPOINTS:
            raise ConfigError(f"{path}: allowed: at most {MOST_WAYPOINTS} way-points")
        t, *position = (_number(path, rows.line_num, name, row[name]) for name in COLUMNS)
        if t <= before_s:
            raise ConfigError(
                f"{path}:{rows.line_num}: t is {t!r}; allowed: above that of the line before, "
                f"{before_s!r}"
            )
        before_s = t
        yield {"t": t, "position": position}


def _number(path: Path, line: int, name: str, text: str | None) -> float:
    try:
        number = float(text or "")
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ConfigError(f"{path}:{line}: {name} is {(text or '')[:40]!r}; allowed: a number")
    return number
