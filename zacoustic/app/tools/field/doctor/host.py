"""This computer: room for the journal, and the clock for slots and quiet hours."""

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from zacoustic.app.tools.field.doctor.ntp import Offset
from zacoustic.config import Config
from zacoustic.core.schedule.access.spec import slots_of
from zacoustic.link.contract import Finding
from zacoustic.run.hostclock import ask_kernel

JOURNAL_BYTES: Final = 64 * 1024 * 1024
"""Largest size of a journal."""
_TRIED_BYTES: Final = 1024 * 1024
"""Bytes of a test write."""

Synchronised = Callable[[], bool | None]
"""Tells whether something synchronises the clock of this computer; None: unknown."""


def check_journal(config: Config) -> Iterator[Finding]:
    """Check that the journal can be written, and has room."""
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
            cure="make room before the mission: no remote node can",
        )


def check_clock(
    config: Config, offset: Offset | None, synchronised: Synchronised
) -> Iterator[Finding]:
    """Check that the clock is accurate enough for the slots of TDMA, and for quiet hours.

    Args:
        config: Configuration of the node.
        offset: Its measured error; None: no time server was queried.
        synchronised: Tells whether something synchronises it.
    """
    slots = slots_of(config.rules.access)
    if slots is not None and slots.clock is not None:
        slots = None
    if slots is None and not config.rules.quiet:
        return
    if offset is None:
        if synchronised() is False:
            what = "quiet hours go" if slots is None else "TDMA goes"
            yield Finding(
                what=f"nothing keeps the clock of this computer right, and {what} by it",
                why="this node transmits nothing, unless it has had the time since its start",
                cure="run chrony (with rtcsync) or another NTP client, and leave it running until "
                "the dive; --ntp HOST measures how wrong the clock is; TDMA can go by the clock of "
                "a node instead: clock in access",
            )
        return
    if slots is None:
        return
    guard_s = min(each.guard_ns for each in slots.timed_slots) / 1e9
    if abs(offset.offset_s) - offset.error_s > slots.clock_error_s:
        yield Finding(
            what=f"clock skew: the clock is {offset.offset_s:+.3f} s off {offset.server}; "
            f"clock_error_s is {slots.clock_error_s:g}, the guard {guard_s:.3f} s",
            why="this node transmits in the slots of others: frames of both are lost, and nobody "
            "sees why",
            cure="have the clock set (chrony, GPS with PPS) before the dive; or let a node "
            "tell the time: clock in access",
        )


def kernel_synchronised() -> bool | None:
    """Return the kernel's report on its clock; None: it has none."""
    state = ask_kernel()
    return None if state is None else state.error_ns is not None


def _try_to_write(folder: Path) -> None:
    """Write as much as a new journal has, and delete it.

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
