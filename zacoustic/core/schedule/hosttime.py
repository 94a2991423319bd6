"""UTC, as far as this node can trust its host; quiet hours and slots depend on it.

A computer that has just started may show any time: 1970, or the time when it was switched off. So a
statement of the host counts only if the host states how wrong it may be (its kernel knows whether
anything disciplines its clock), and if it is later than this version of the protocol. A trusted
statement holds as long as the monotonic clock runs: a host that loses its time server under water,
or a process that is restarted on it, still has the time, less exact by the drift. So the journal
has the last statement, its error, and the name of the run of the monotonic clock that its instant
belongs to (`BOOT_KEY`).

If hours or slots depend on UTC and UTC is in doubt, nothing is transmitted, and a
`ClockStateChanged` says why. Then the host is asked every ten seconds, so that the end of the doubt
is noticed.
"""

from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.journal import BOOT_KEY, JournalPort
from zacoustic.core.base.timers import Due, Timers
from zacoustic.core.schedule.access.networktime import NetworkTime
from zacoustic.core.schedule.access.spec import AccessSpec, TdmaSpec

EARLIEST_UTC_NS: Final = 1_735_689_600 * NS_PER_S
"""2025-01-01: a clock that shows an earlier time is not set."""
_KEY: Final = "clock"
_ASK_NS: Final = 10 * NS_PER_S
_TOLERANCE_NS: Final = NS_PER_S
"""Quiet hours tolerate this error."""
_WRITE_EVERY_NS: Final = 600 * NS_PER_S


class ClockStateChanged(msgspec.Struct, frozen=True, kw_only=True):
    """Transmission has stopped because the time is in doubt, or may go on again."""

    doubt: str
    """What is missing, one line; empty: nothing, or neither slots nor quiet hours need the time."""
    changed_at: int
    """Instant of the change, ns."""


class _Journalled(msgspec.Struct, frozen=True, array_like=True):
    """A statement in the journal."""

    boot: bytes
    offset_ns: int
    error_ns: int
    told_at: int


class HostTime:
    """One engine's knowledge of UTC.

    Args:
        access: The medium access settings of the config; their slots may follow UTC.
        has_hours: Whether there are hours of the day without transmission.
        stored: The content of the journal.
        journal: Holds the last statement.
        timers: Ask the host again.
        emit: Takes `ClockStateChanged`.
    """

    def __init__(
        self,
        access: AccessSpec | None,
        has_hours: bool,
        stored: Mapping[str, bytes],
        *,
        journal: JournalPort,
        timers: Timers,
        emit: Callable[[ClockStateChanged], None],
    ) -> None:
        self._timers = timers
        slots = access if isinstance(access, TdmaSpec) and access.clock is None else None
        self.doubt = ""
        """Why missing time keeps this node from transmitting; empty: it does not."""
        self.time = (
            NetworkTime(slots.drift_ppm)
            if slots is not None
            else NetworkTime(0.0, tolerance_ns=_TOLERANCE_NS, settling_ns=0)
        )
        """The trusted time; read-only."""
        self.shown_ns: int | None = None
        """The last offset that the host has stated, ns, trusted or not; None: none."""
        self.shown_error_ns: int | None = None
        """Its largest error, ns; None: nothing synchronises the host's clock."""
        self._is_needed = has_hours or slots is not None
        self._journal = journal
        self._emit = emit
        self._boot = stored.get(BOOT_KEY, b"")
        self._refusal = "the host has not reported its clock"
        self._ask_at: int | None = None
        self._written: _Journalled | None = None
        self._recover(stored.get(_KEY))

    @property
    def is_sure(self) -> bool:
        """Whether UTC is known and not in doubt."""
        return self.time.offset_ns is not None and self.time.sure_at is None

    def tell(self, offset_ns: int, error_ns: int | None, now: int) -> int | None:
        """Take a statement of the host.

        Returns:
            How wrong it may be, ns; None: it is not trusted.
        """
        self._ask(now)
        self._refusal = ""
        self.shown_ns, self.shown_error_ns = offset_ns, error_ns
        if now + offset_ns < EARLIEST_UTC_NS:
            error_ns = None
            self._refusal = "the clock of this computer is not set"
        elif error_ns is None:
            self._refusal = "nothing keeps the clock of this computer right"
        if self.time.tell(offset_ns, error_ns, now) and error_ns is not None and self._is_needed:
            self._keep(_Journalled(self._boot, offset_ns, error_ns, now))
        return error_ns

    def review(self, doubt: str, now: int) -> None:
        """Emit an event when the reason for this node's silence has changed.

        Args:
            doubt: What is missing, one line; empty: nothing.
            now: The instant.
        """
        if doubt and self._refusal and self._is_needed:
            doubt = f"{doubt}: {self._refusal}"
        if doubt != self.doubt:
            self.doubt = doubt
            self._arm()
            self._emit(ClockStateChanged(doubt=doubt, changed_at=now))

    # Below the methods above

    def _ask(self, now: int) -> None:
        """Record that the host is asked now."""
        self._ask_at = now + _ASK_NS
        self._arm()

    def _arm(self) -> None:
        if self._ask_at is not None and self.doubt and self._is_needed:
            self._timers.at((Due.CLOCK,), self._ask_at, self._ask)
        else:
            self._timers.cancel((Due.CLOCK,))

    def _keep(self, statement: _Journalled) -> None:
        """Journal a statement if it is better or newer than the entry there."""
        if not self._boot:
            return
        before = self._written
        if before is not None:
            moved_ns = abs(statement.offset_ns - before.offset_ns)
            is_new = moved_ns > before.error_ns + statement.error_ns + _TOLERANCE_NS
            is_old = statement.told_at - before.told_at >= _WRITE_EVERY_NS
            if not is_new and not is_old and statement.error_ns * 2 >= before.error_ns:
                return
        self._written = statement
        self._journal.write(_KEY, msgspec.msgpack.encode(statement))

    def _recover(self, entry: bytes | None) -> None:
        if entry is None or not self._boot:
            return
        try:
            kept = msgspec.msgpack.decode(entry, type=_Journalled)
        except msgspec.MsgspecError:
            return
        if kept.boot == self._boot:
            self._written = kept
            self.time.tell(kept.offset_ns, kept.error_ns, kept.told_at)
