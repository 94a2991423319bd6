"""Recorded channels in files: impulse responses measured at sea, at a fixed rate.

Archives of delay-Doppler channels, Watermark among them, hold one complex response per
probe. A scenario names such a file in place of the fades and the distortion of a model::

    channel: "recorded", recorded: { file: "bay.mat", window_s: 0.001 }

The file is MATLAB v7.3, which is HDF5, with ``h`` (in MATLAB one row for each response),
``fs_t`` (responses per second) and ``fs_tau`` (samples of delay per second). The last two are
variables, or members of the struct ``params``. Only power matters here: a receiver that follows the
strongest window of each response uses what is in it, and everything else disturbs it.
"""

from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.channel.faults.limits import check_range
from zacoustic.errors import ConfigError
from zacoustic.text.installing import with_extra

MOST_RESPONSES: Final = 1_000_000
DEFAULT_WINDOW_S: Final = 0.001
"""About a symbol of a modem with 1 kbit/s, s."""
_LEAST_DB: Final = -100.0
_MOST_DB: Final = 100.0
_MOST_RATE_HZ: Final = 1e6
_MOST_DELAYS: Final = 1_000_000
_AT_ONCE: Final = 1 << 20
"""Samples in memory at once."""
_KEYS: Final = ("file", "window_s")


class RecordedSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A recorded channel as receivers meet it; its end is followed by its beginning."""

    every_s: float
    """Time between two responses, s, 0.000001…1000000."""
    gains_db: tuple[float, ...]
    """Power of all paths of each response over the mean of the recording, dB, −100…100."""
    used_db: tuple[float, ...]
    """Power of the window that a receiver uses, over the same mean, dB; at most that of all."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ValueError: One is out of its range, or the two lists do not match.
        """
        check_range("every_s", self.every_s, 1 / _MOST_RATE_HZ, _MOST_RATE_HZ)
        if not 1 <= len(self.gains_db) <= MOST_RESPONSES:
            raise ValueError(f"gains_db has {len(self.gains_db)}; allowed: 1..{MOST_RESPONSES}")
        if len(self.used_db) != len(self.gains_db):
            raise ValueError(f"used_db has {len(self.used_db)}; allowed: {len(self.gains_db)}")
        for gain_db, used_db in zip(self.gains_db, self.used_db, strict=True):
            check_range("gains_db", gain_db, _LEAST_DB, _MOST_DB)
            check_range("used_db", used_db, _LEAST_DB, gain_db)


def with_recording(mapping: object, folder: Path) -> object:
    """Return a scenario with the content of its recorded channel.

    Args:
        mapping: The parsed scenario; not changed.
        folder: Folder of the recording.

    Raises:
        ConfigError: The file is missing or invalid; names file, variable and value.
    """
    named = mapping.get("recorded") if isinstance(mapping, dict) else None
    if not (isinstance(mapping, dict) and isinstance(named, dict) and "file" in named):
        return mapping
    for key in named:
        if key not in _KEYS:
            raise ConfigError(f"recorded.{key} is unknown; allowed: {', '.join(_KEYS)}")
    file, window_s = named["file"], named.get("window_s", DEFAULT_WINDOW_S)
    if not isinstance(file, str):
        raise ConfigError(f"recorded.file is {file!r}; allowed: the name of a file")
    is_number = isinstance(window_s, int | float) and not isinstance(window_s, bool)
    if not is_number or not 0 < window_s <= 1:
        raise ConfigError(f"recorded.window_s is {window_s!r}; allowed: above 0, up to 1")
    spec = read_recording(folder / file, window_s=float(window_s))
    return {**mapping, "recorded": msgspec.structs.asdict(spec)}


def read_recording(path: Path, *, window_s: float = DEFAULT_WINDOW_S) -> RecordedSpec:
    """Read a file of impulse responses.

    Args:
        path: MATLAB v7.3.
        window_s: Length of the part of a response that a receiver uses, s, > 0.

    Raises:
        ConfigError: It is missing or invalid, or h5py is not installed.
    """
    try:
        import h5py
    except ImportError as error:
        raise ConfigError(f"{path}: h5py is not installed", hint=with_extra("channel")) from error
    try:
        with path.open("rb") as raw:
            is_old = raw.read(10) == b"MATLAB 5.0"
        if is_old:
            raise ConfigError(
                f"{path} is MATLAB v5; allowed: v7.3", hint='save it again with the flag "-v7.3"'
            )
        with h5py.File(path, "r") as file:
            return _read(path, file, window_s)
    except OSError as error:
        raise ConfigError(
            f"{path}: {error.strerror or 'is no HDF5 file'}",
            hint="a recorded channel is MATLAB v7.3 with h, fs_t and fs_tau",
        ) from error


def _read(path: Path, file: Any, window_s: float) -> RecordedSpec:  # noqa: ANN401 (h5py has no types)
    import numpy as np

    responses_hz, delays_hz = (_rate(path, file, name) for name in ("fs_t", "fs_tau"))
    responses = file.get("h")
    shape: tuple[int, ...] = getattr(responses, "shape", ())
    # HDF5 has MATLAB's columns as rows.
    if len(shape) != 2 or not (1 <= shape[0] <= _MOST_DELAYS and 1 <= shape[1] <= MOST_RESPONSES):
        raise ConfigError(
            f"{path}: h has the shape {shape[::-1]}; allowed: responses × delays, "
            f"up to {MOST_RESPONSES} × {_MOST_DELAYS}"
        )
    delays, count = shape
    width = min(delays, max(1, round(window_s * delays_hz)))
    all_of, used_of = np.empty(count), np.empty(count)
    step = max(1, _AT_ONCE // delays)
    for begin in range(0, count, step):
        part = responses[:, begin : begin + step]
        if part.dtype.names == ("real", "imag"):  # a complex array of MATLAB
            power = part["real"].astype(float) ** 2 + part["imag"].astype(float) ** 2
        elif part.dtype.kind in "fc":
            power = np.abs(part).astype(float) ** 2
        else:
            raise ConfigError(f"{path}: h is of {part.dtype}; allowed: real or complex numbers")
        sums = np.vstack([np.zeros((1, power.shape[1])), np.cumsum(power, axis=0)])
        all_of[begin : begin + step] = sums[-1]
        used_of[begin : begin + step] = (sums[width:] - sums[:-width]).max(axis=0)
    mean = all_of.mean()
    if not np.isfinite(mean) or mean <= 0.0:
        raise ConfigError(f"{path}: the mean power of h is {mean}; allowed: above 0, finite")
    least = 10.0 ** (_LEAST_DB / 10.0)
    gains_db = 10.0 * np.log10(np.maximum(all_of / mean, least))
    used_db = 10.0 * np.log10(np.maximum(np.minimum(used_of, all_of) / mean, least))
    return RecordedSpec(
        every_s=1.0 / responses_hz,
        gains_db=tuple(gains_db.tolist()),
        used_db=tuple(used_db.tolist()),
    )


def _rate(path: Path, file: Any, name: str) -> float:  # noqa: ANN401 (h5py has no types)
    """Return a rate of the file, Hz."""
    params = file.get("params")
    found = file.get(name)
    if found is None and hasattr(params, "keys"):
        found = params.get(name)
    is_one = getattr(found, "size", 0) == 1 and found.dtype.kind in "fiu"
    value = float(found[()].flat[0] if found.shape else found[()]) if is_one else None
    if value is None or not 1 / _MOST_RATE_HZ <= value <= _MOST_RATE_HZ:
        raise ConfigError(
            f"{path}: {name} is {'missing' if found is None else value}; "
            f"allowed: one number, Hz, up to {_MOST_RATE_HZ:g}"
        )
    return value
