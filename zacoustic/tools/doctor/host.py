"""This computer: room for the journal, and the clock that TDMA goes by."""

import contextlib
import ctypes
import os
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from zacoustic.config import Config
from zacoustic.core.access.spec import TdmaSpec
from zacoustic.link import Finding
from zacoustic.tools.doctor.ntp import Offset

JOURNAL_BYTES: Final = 64 * 1024 * 1024
"""What a journal takes at most."""
_TRIED_BYTES: Final = 1024 * 1024
"""What is written to see whether it can be."""
_STA_UNSYNC: Final = 0x40
_TIMEX_BYTES: Final = 256
_STATUS_OFFSET: Final = 40

Synchronised = Callable[[], bool | None]
"""Tells whether something keeps the clock of this computer right; None: not known."""


def check_journal(config: Config) -> Iterator[Finding]:
    """See whether the journal can be written, and has room."""
    if config.journal is None:
        return
    folder = next(
        each
        for each in (config.journal.absolute(), *config.journal.absolute().parents)
        if each.exists()
    )
    try:
        _try_to_write(folder)
    except OSError as error:
        yield Finding(
            what=f"the journal cannot be written to {config.journal}: {error.strerror}",
            why="what is to survive a restart is refused, and the gateway may not start",
            cure="make room on the disk, or name a folder that the user of the gateway can write",
        )
        return
    space = os.statvfs(folder) if hasattr(os, "statvfs") else None
    there = sum(each.stat().st_size for each in config.journal.glob("node-*.sqlite*"))
    if space is not None and space.f_bavail * space.f_frsize + there < JOURNAL_BYTES:
        left = space.f_bavail * space.f_frsize // 1_000_000
        yield Finding(
            what=f"{config.journal}: {left} MB left on the disk; a journal takes up to "
            f"{JOURNAL_BYTES // 1_000_000} MB",
            why="when it is full, samples and calls that are to survive a restart are refused",
            cure="make room before the mission: nobody can from beyond the water",
        )


def check_clock(
    config: Config, offset: Offset | None, synchronised: Synchronised
) -> Iterator[Finding]:
    """See whether the clock is good enough for the slots of TDMA.

    Args:
        config: Of the node.
        offset: How wrong it was found to be; None: nobody was asked.
        synchronised: Tells whether something keeps it right.
    """
    access = config.rules.access
    if not isinstance(access, TdmaSpec) or access.clock is not None:
        return
    why = "this node transmits in the slots of others: frames of both are lost, and nobody sees why"
    if offset is not None:
        if abs(offset.offset_s) - offset.error_s > access.clock_error_s:
            yield Finding(
                what=f"clock skew: the clock is {offset.offset_s:+.3f} s off {offset.server}; "
                f"clock_error_s is {access.clock_error_s:g}, the guard {access.guard_ns / 1e9:.3f}"
                " s",
                why=why,
                cure="have the clock set (chrony, GPS with PPS) before the dive; or let a node "
                "tell the time: clock in access",
            )
    elif synchronised() is False:
        yield Finding(
            what="nothing keeps the clock of this computer right, and TDMA goes by it",
            why=f"it drifts some seconds a day; then {why}",
            cure="run chrony or another NTP client, and leave it running until the dive; --ntp "
            "HOST measures how wrong it is; or let a node tell the time: clock in access",
        )


def kernel_synchronised() -> bool | None:
    """Tell what the kernel says of its clock; None where it cannot be asked."""
    if not sys.platform.startswith("linux") or struct.calcsize("l") != 8:
        return None
    timex = ctypes.create_string_buffer(_TIMEX_BYTES)
    try:
        state = ctypes.CDLL(None).adjtimex(timex)
    except (OSError, AttributeError):
        return None
    if state < 0:
        return None
    (status,) = struct.unpack_from("i", timex.raw, _STATUS_OFFSET)
    return not status & _STA_UNSYNC


def _try_to_write(folder: Path) -> None:
    """Write as much as a first journal has, and take it away again.

    Raises:
        OSError: It cannot be written.
    """
    handle, name = tempfile.mkstemp(prefix=".zacoustic-doctor-", dir=folder)
    try:
        with os.fdopen(handle, "wb", buffering=0) as file:
            written = 0
            while written < _TRIED_BYTES:
                written += file.write(bytes(_TRIED_BYTES - written))
            os.fsync(file.fileno())
    finally:
        with contextlib.suppress(OSError):
            Path(name).unlink()
