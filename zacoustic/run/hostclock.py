"""The clock of this computer: its time, its possible error, and the name of its present run.

The kernel knows whether anything (an NTP client, a GPS receiver) synchronises its clock, and its
largest error: `adjtimex` reports them on Linux, `ntp_adjtime` on BSD and macOS. After a start, and
after a change by hand, they are unknown until a client has synchronised the clock. Some clients
inform the kernel only on request (chrony: `rtcsync`).

On systems without such a report the error in the configuration applies.
"""

import ctypes
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.core.base.journal import BOOT_KEY

_BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")
_STA_UNSYNC: Final = 0x40
_REST_BYTES: Final = 256
_NS_PER_US: Final = 1000
_CALLS: Final = ("adjtimex", "ntp_adjtime")


class ClockState(msgspec.Struct, frozen=True, kw_only=True):
    """The kernel's report on its clock."""

    error_ns: int | None
    """Largest possible error, ns; None: nothing synchronises the clock."""


AskClock = Callable[[], ClockState | None]
"""Asks the kernel; returns None on systems without a report."""


class _Timex(ctypes.Structure):
    """The beginning of `struct timex`, the same on all systems; only read here."""

    _fields_ = (
        ("modes", ctypes.c_uint),
        ("offset", ctypes.c_long),
        ("freq", ctypes.c_long),
        ("maxerror", ctypes.c_long),
        ("esterror", ctypes.c_long),
        ("status", ctypes.c_int),
        ("rest", ctypes.c_char * _REST_BYTES),
    )


def ask_kernel() -> ClockState | None:
    """Return the kernel's report on its clock; None: it has none."""
    if sys.platform == "win32":
        return None
    timex = _Timex()
    for name in _CALLS:
        try:
            state = getattr(ctypes.CDLL(None), name)(ctypes.byref(timex))
        except (OSError, AttributeError):
            continue
        if state < 0:
            continue
        if timex.status & _STA_UNSYNC:
            return ClockState(error_ns=None)
        return ClockState(error_ns=max(0, timex.maxerror, timex.esterror) * _NS_PER_US)
    return None


def boot_name() -> bytes:
    """Return the name of the present run of the monotonic clock; empty: the system has none."""
    try:
        return _BOOT_ID.read_bytes().strip()
    except OSError:
        return b""


class HostClock(msgspec.Struct, frozen=True, kw_only=True):
    """What a runner needs of its computer's clock."""

    utc_ns: Callable[[], int] = time.time_ns
    """Tells UTC, ns since 1970."""
    ask: AskClock = ask_kernel
    """Tells its possible error."""
    boot: bytes = msgspec.field(default_factory=boot_name)
    """Name of the present run of the monotonic clock; empty: none."""

    def named(self, stored: Mapping[str, bytes]) -> dict[str, bytes]:
        """Return a journal's entries, with the name of this run for the next engine."""
        return {**stored, BOOT_KEY: self.boot}
