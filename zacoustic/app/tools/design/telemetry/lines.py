"""A recording as lines: JSON, one sample a line, compressed or not; or MCAP (`mcaplines`).

``{"t": 12.5, "s": "auv1/nav", "v": {"lat": 43.1, …}}``: seconds, the stream by name or id, its
value by name or in the order of the fields. The first line may be ``{"meta": …}``, for people.
"""

import gzip
import math
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final, NoReturn

import msgspec

from zacoustic.app.tools.design.telemetry.line import Line
from zacoustic.app.tools.design.telemetry.mcaplines import read_mcap
from zacoustic.errors import ConfigError
from zacoustic.run.recording.reading import is_recording

_GZIP: Final = b"\x1f\x8b"
_LONGEST_BYTES: Final = 1 << 20
_ALLOWED: Final = 'one sample a line: {"t": seconds, "s": stream, "v": value}'


def read_lines(path: str) -> Iterator[Line]:
    """Read a recording.

    Raises:
        ConfigError: The file cannot be read, or a line is wrong; reports the first.
    """
    if Path(path).is_dir():
        for each in _bag(Path(path)):
            yield from read_mcap(str(each))
        return
    if is_recording(path) or path.endswith(".mcap"):
        yield from read_mcap(path)
        return
    try:
        with _open(Path(path)) as file:
            for number in range(1, 1 << 62):
                written = file.readline(_LONGEST_BYTES + 1)
                if not written:
                    return
                place = f"{path}: line {number}"
                if len(written) > _LONGEST_BYTES:
                    _complain(place, "too long", f"at most {_LONGEST_BYTES} bytes")
                line = _line(place, written)
                if line is not None:
                    yield line
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ConfigError(f"{path}: damaged: {error}; allowed: gzip, or plain text") from error
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror or error}") from error


def _bag(folder: Path) -> list[Path]:
    """Return the files of a bag of ROS 2, in order.

    Raises:
        ConfigError: It has none in MCAP.
    """
    found = sorted(folder.glob("*.mcap"))
    if not found:
        raise ConfigError(
            f"{folder}: a folder without .mcap; allowed: recordings, or bags of ROS 2 in MCAP",
            hint="ros2 bag convert makes MCAP of other bags",
        )
    return found


def _open(path: Path) -> IO[bytes] | gzip.GzipFile:
    with path.open("rb") as file:
        head = file.read(len(_GZIP))
    return gzip.open(path, "rb") if head.startswith(_GZIP) else path.open("rb")


def _line(place: str, written: bytes) -> Line | None:
    """Read a line; None for one without a sample."""
    if not written.strip():
        return None
    try:
        found = msgspec.json.decode(written)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        reason = str(error).removeprefix("JSON is malformed: ")
        _complain(place, f"no JSON: {reason}", _ALLOWED)
    if not isinstance(found, dict):
        _complain(place, f"{type(found).__name__}", _ALLOWED)
    if "meta" in found and "s" not in found:
        return None
    for key in ("t", "s", "v"):
        if key not in found:
            _complain(place, f'"{key}" is missing', _ALLOWED)
    at_s, name = found["t"], found["s"]
    if isinstance(at_s, bool) or not isinstance(at_s, int | float) or not math.isfinite(at_s):
        _complain(place, f"t: {at_s!r}", "seconds, a number")
    if isinstance(name, bool) or not isinstance(name, str | int):
        _complain(place, f"s: {name!r}", "name or id of a stream")
    return Line(place, float(at_s), str(name), found["v"])


def _complain(place: str, what: str, allowed: str) -> NoReturn:
    raise ConfigError(f"{place}: {what}; allowed: {allowed}")
