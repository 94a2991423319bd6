"""Transmit silence: when this node must not transmit.

Divers in the water, another party's sonar, a measurement: for a while nothing may be transmitted.
Silence is *commanded* (for a time, or until it is resumed), or it is a *quiet window* of the
config, at the same hours of each day in UTC. It stops every transmission, urgent ones and
repetitions included: from the instant of the command nothing new goes to the link, and waiting
payloads stay, expire or are superseded as always. A frame that the modem has begun is not cut off.

People rely on a command, so it never ends sooner than it says. While the node runs, the end is an
instant of the monotonic clock, which no step of the wall clock moves. The journal has how much was
left at an instant, and the UTC of the end with its error, or nothing in its place when UTC was not
sure (`hosttime`). It is written again every minute or so, and when the wall clock is set. After a
restart the node takes the earliest end of these three, each of which is late enough: the same
instant on the same run of the monotonic clock; what was left, counted from now; and the UTC of the
end, once that is sure. So a node that knows nothing begins with what was left, and says that this
may be too long.

A command over the channel is answered over the channel. The answer is the one frame that may still
go: alone, once, within the time *granted* to it.

With quiet windows and without a sure UTC the node stays silent. A window is longer by the error of
UTC.
"""

from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S, ns_to_seconds, seconds_to_ns
from zacoustic.core.base.journal import BOOT_KEY, JournalPort
from zacoustic.core.base.timers import Due, Timers
from zacoustic.core.schedule.hosttime import HostTime
from zacoustic.core.schedule.queue import LaneKey

SILENCE_KEY: Final = "silence"
"""Key of the command in the journal."""
_DAY_NS: Final = 24 * 3600 * NS_PER_S
_LONGEST_NS: Final = (1 << 62) - 1


_WRITE_EVERY_NS: Final = 60 * NS_PER_S
_WRITE_PARTS: Final = 64
"""The rest is journalled again when this time, or this part of it, has passed."""
_MOVED_NS: Final = NS_PER_S
"""A change of the end in UTC by more than this is a new end."""


class SilenceChanged(msgspec.Struct, frozen=True, kw_only=True):
    """A command or end of silence is journalled, or a silence from before the restart continues."""

    is_silent: bool
    """Whether nothing may be transmitted now."""
    is_commanded: bool
    """Whether it is commanded; otherwise, if silent, it is a quiet window."""
    ends_at: int | None
    """The end as far as it is known, ns; None: not silent, or until it is resumed."""
    changed_at: int
    """Instant of this state, ns."""
    doubt: str = ""
    """Why it may last longer than commanded, one line; empty: it does not."""


class QuietWindow(msgspec.Struct, frozen=True):
    """Hours of each day in UTC at which this node keeps silent."""

    begins_ns: int
    """Begin since midnight, ns."""
    ends_ns: int
    """End since midnight, ns; before the begin: on the next day."""

    def left_ns(self, utc_ns: int, error_ns: int = 0) -> int:
        """Return how long the window still lasts at a time, ns; 0 outside of it.

        Args:
            utc_ns: The time, UTC, ns.
            error_ns: Its largest error, ns.
        """
        since_begin = (utc_ns - self.begins_ns + error_ns) % _DAY_NS
        length = (self.ends_ns - self.begins_ns) % _DAY_NS + 2 * error_ns
        return max(0, length - since_begin)


class _Entry(msgspec.Struct, frozen=True, array_like=True):
    """A command in the journal."""

    left_ns: int
    """How long it lasts from `written_at` on, ns; 0: until it is resumed."""
    written_at: int
    boot: bytes
    """The run of the monotonic clock that `written_at` belongs to."""
    ends_utc_ns: int | None
    """UTC of its end, error included, ns; None: unknown."""


class Silence:
    """The transmit silence of one node.

    Args:
        quiet: The quiet windows.
        stored: The content of the journal.
        host: Knows UTC.
        journal: Holds the command.
        timers: End the command.
        emit: Takes `SilenceChanged` when a command, or its end, is journalled.
    """

    def __init__(
        self,
        quiet: tuple[QuietWindow, ...],
        stored: Mapping[str, bytes],
        *,
        host: HostTime,
        journal: JournalPort,
        timers: Timers,
        emit: Callable[[SilenceChanged], None],
    ) -> None:
        self._quiet = quiet
        self._timers = timers
        self._journal = journal
        self._emit = emit
        self.host = host
        """Knows UTC; read-only."""
        self._boot = stored.get(BOOT_KEY, b"")
        self._commanded = False
        self._ends_at: int | None = None
        self._ends_utc_ns: int | None = None
        self._written_at = 0
        self._kept: _Entry | None = None
        self._is_former = False
        self._doubt = ""
        self._granted: tuple[LaneKey, int] | None = None
        self._recover(stored.get(SILENCE_KEY))

    # Commands

    def begin(
        self,
        now: int,
        *,
        duration_s: float | None = None,
        then: Callable[[int], None] | None = None,
    ) -> None:
        """Begin a silence, for a time or until `resume`; it replaces an earlier command.

        Args:
            now: The instant.
            duration_s: Its duration, s; None: until `resume`.
            then: Called when the command is journalled.

        Raises:
            ValueError: The duration is not above 0.
        """
        if duration_s is not None and not 0 < duration_s < float("inf"):
            raise ValueError(f"duration_s is {duration_s}; allowed: above 0")
        self._commanded, self._kept, self._granted, self._doubt = True, None, None, ""
        self._ends_at = None
        if duration_s is not None:
            self._ends_at = now + min(_LONGEST_NS, max(1, seconds_to_ns(duration_s)))
        self._ends_utc_ns = self._end_in_utc(now)
        self._write(now, lambda at: self._tell(at, then))
        self._arm()

    def resume(self, now: int, *, then: Callable[[int], None] | None = None) -> None:
        """End the command; quiet windows stay. Call `then` once that is journalled."""
        self._commanded, self._kept, self._granted, self._doubt = False, None, None, ""
        self._journal.write(SILENCE_KEY, None, lambda at: self._tell(at, then))
        self._arm()

    def begin_at_least(self, now: int, *, until: int | None, then: Callable[[int], None]) -> None:
        """Begin a silence unless an earlier command lasts at least as long.

        Args:
            now: The instant.
            until: The end, ns; None: until `resume`.
            then: Called when the command is journalled.
        """
        lasts = self._commanded and (
            self._ends_at is None or (until is not None and until <= self._ends_at)
        )
        if lasts or (until is not None and until <= now):
            then(now)
        else:
            duration_s = None if until is None else ns_to_seconds(until - now)
            self.begin(now, duration_s=duration_s, then=then)

    def grant(self, lane: LaneKey, *, until: int) -> None:
        """Grant a lane one frame during the silence, until an instant, ns."""
        self._granted = lane, until

    def use_grant(self) -> None:
        """Use up the grant: its frame goes."""
        self._granted = None

    # Inputs

    def wake(self, now: int) -> None:
        """Restore a command when the link is up, before anything could be transmitted."""
        self._begin_life(now)
        self._go_on(now)
        if self._commanded and self._is_former:
            self._emit(self.state(now))
        self._is_former = False

    def keep(self, now: int) -> None:
        """Journal again what is left of a command if the last entry is old."""
        if not self._commanded or self._ends_at is None or self._ends_at <= now:
            return
        left_ns = self._ends_at - now
        if now - self._written_at >= max(_WRITE_EVERY_NS, left_ns // _WRITE_PARTS):
            self._write(now)

    def handle_clock(self, now: int) -> None:
        """Adjust the end of a command to the host's time."""
        if not self._commanded:
            return
        self._begin_life(now)
        if self._ends_at is None:
            return
        if self.host.is_sure and self._kept is not None:
            self._shorten(self._kept, now)
        if self._kept is None:
            before_ns, self._ends_utc_ns = self._ends_utc_ns, self._end_in_utc(now)
            if _is_other(before_ns, self._ends_utc_ns):
                self._write(now)
        self._go_on(now)

    # Getters

    def until(self, now: int) -> int | None:
        """Return the end of the silence, ns; None: no end is known.

        An end at or before `now` means that there is no silence.
        """
        commanded_until = self._ends_at if self._commanded else 0
        if commanded_until is None:
            return None
        return self._quiet_until(max(now, commanded_until)) if self._quiet else commanded_until

    def after_silence(self, wanted: object, at: int, now: int) -> int | None:
        """Return the end of the silence, ns, or `at`; None: no end is known."""
        until = self.until(now)
        if until is None:
            return None
        return max(at, until) if until > now else at

    def is_silent(self, now: int) -> bool:
        """Return whether nothing may be transmitted now."""
        until = self.until(now)
        return until is None or until > now

    def granted(self, now: int) -> LaneKey | None:
        """Return the lane that may still transmit in this silence, or None."""
        if self._granted is None or self._granted[1] <= now or not self.is_silent(now):
            return None
        return self._granted[0]

    def state(self, now: int) -> SilenceChanged:
        """Return the present state."""
        until = self.until(now)
        return SilenceChanged(
            is_silent=self.is_silent(now),
            is_commanded=self._commanded,
            ends_at=None if until is None or until <= now else until,
            changed_at=now,
            doubt=self._doubt,
        )

    @property
    def commanded(self) -> tuple[bool, int | None]:
        """Whether silence is commanded, and its end, ns; None: until `resume`."""
        return self._commanded, self._ends_at

    @property
    def clock_doubt(self) -> str:
        """Why quiet windows and a doubtful time keep this node silent; empty: they do not."""
        if not self._quiet or self.host.is_sure:
            return ""
        is_known = self.host.time.offset_ns is not None
        return "the clock has jumped" if is_known else "UTC is not known"

    # Below the methods above

    def _go_on(self, now: int) -> None:
        """End a command whose time has passed; otherwise keep its rest in the journal."""
        if self._commanded and self._ends_at is not None and self._ends_at <= now:
            self.resume(now)
        self.keep(now)
        self._arm()

    def _arm(self) -> None:
        if self._commanded and self._ends_at is not None:
            self._timers.at((Due.SILENCE,), self._ends_at, self._go_on)
        else:
            self._timers.cancel((Due.SILENCE,))

    def _quiet_until(self, at: int) -> int | None:
        """Return the end of the quiet windows at an instant, ns, or it; None: no UTC."""
        offset_ns, error_ns = self.host.time.offset_ns, self.host.time.error_at(at)
        if offset_ns is None or error_ns is None:
            return None
        # A window may begin before another one has ended.
        for _ in self._quiet:
            left_ns = max(each.left_ns(at + offset_ns, error_ns) for each in self._quiet)
            if not left_ns:
                break
            at += left_ns
        return at

    def _begin_life(self, now: int) -> None:
        """Set the end of a command from before the restart, once."""
        kept = self._kept
        if kept is None or self._ends_at is not None or not kept.left_ns:
            return
        if kept.boot and kept.boot == self._boot and kept.written_at <= now:
            self._ends_at = kept.written_at + kept.left_ns
            self._kept = None  # exact: UTC cannot improve it
        else:
            self._ends_at = now + kept.left_ns
            self._doubt = "it is not known how long this node was down; what was left counts anew"
            if self.host.is_sure:
                self._shorten(kept, now)

    def _shorten(self, kept: _Entry, now: int) -> None:
        """Correct the end of a command from before the restart now that UTC is sure."""
        self._kept = None
        offset_ns, error_ns = self.host.time.offset_ns, self.host.time.error_at(now)
        assert self._ends_at is not None
        if kept.ends_utc_ns is None or offset_ns is None or error_ns is None:
            return
        self._doubt = ""
        self._ends_at = min(self._ends_at, max(now, kept.ends_utc_ns - offset_ns + error_ns))

    def _end_in_utc(self, now: int) -> int | None:
        """Return the latest possible UTC of the end, ns; None: not sure."""
        offset_ns, error_ns = self.host.time.offset_ns, self.host.time.error_at(now)
        if self._ends_at is None or offset_ns is None or error_ns is None:
            return None
        return self._ends_at + offset_ns + error_ns

    def _write(self, now: int, then: Callable[[int], None] | None = None) -> None:
        left_ns = 0 if self._ends_at is None else max(1, self._ends_at - now)
        entry = _Entry(left_ns, now, self._boot, self._ends_utc_ns)
        self._written_at = now
        self._journal.write(SILENCE_KEY, msgspec.msgpack.encode(entry), then)

    def _tell(self, now: int, then: Callable[[int], None] | None) -> None:
        self._emit(self.state(now))
        if then is not None:
            then(now)

    def _recover(self, entry: bytes | None) -> None:
        if entry is None:
            return
        try:
            self._kept = msgspec.msgpack.decode(entry, type=_Entry)
        except msgspec.MsgspecError:
            return
        self._commanded = self._is_former = True
        self._ends_utc_ns = self._kept.ends_utc_ns


def _is_other(before_ns: int | None, ns: int | None) -> bool:
    if before_ns is None or ns is None:
        return before_ns is not ns
    return abs(ns - before_ns) > _MOVED_NS
