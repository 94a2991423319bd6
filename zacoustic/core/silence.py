"""Transmit silence: when this node must not make a sound.

Divers in the water, somebody else's sonar, a measurement: for a while nothing may be transmitted.
Silence is *ordered* (for a time, or until it is resumed), or it is a *quiet window* of the config,
at the same hours of each day in UTC. It is a gate in front of every transmission, urgent ones and
retransmissions included: from the instant of the order on nothing new goes to the link, and what
waits goes on waiting, expires or is superseded as always. A frame that the modem has begun is not
cut off.

An order outlives a restart. While the node lives, its end is an instant of the monotonic clock, so
that no step of the wall clock moves it. In the journal it is the UTC at which it began and how long
it lasts; in the next life it ends at begin and duration, but never later than its duration from now
(the clock went back), and as long as nobody has told the time it goes on for its duration. A clock
that was set forward while the node was down ends it early: that cannot be told from time that has
passed.

An order that came over the water is answered over the water, and its answer is the one frame that
may still go: it alone, once, within the time that is *granted* to it.

With quiet windows and no UTC the node keeps silent: whoever wrote them would rather have that.
"""

from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.events import SilenceChanged
from zacoustic.core.journal import JournalPort
from zacoustic.core.queue import LaneKey

SILENCE_KEY: Final = "silence"
"""Key of the order in the journal: UTC at which it began, ns (8 bytes; 0: unknown), and how long it
lasts, ns (8 bytes; 0: until resumed), big-endian."""
_DAY_NS: Final = 24 * 3600 * NS_PER_S
_LONGEST_NS: Final = (1 << 62) - 1


class QuietWindow(msgspec.Struct, frozen=True):
    """Hours of each day in UTC at which this node keeps silent."""

    begins_ns: int
    """Since midnight, ns."""
    ends_ns: int
    """Since midnight, ns; before the beginning: on the next day."""

    def left_ns(self, utc_ns: int) -> int:
        """Return how long the window still lasts at that time, ns; 0 outside of it."""
        since_begin = (utc_ns - self.begins_ns) % _DAY_NS
        length = (self.ends_ns - self.begins_ns) % _DAY_NS
        return max(0, length - since_begin)


class Silence:
    """The gate of one node.

    Args:
        quiet: The quiet windows.
        stored: What the journal has kept.
        journal: Keeps the order.
        emit: Takes `SilenceChanged` when an order, or its end, is kept.
    """

    def __init__(
        self,
        quiet: tuple[QuietWindow, ...],
        stored: Mapping[str, bytes],
        *,
        journal: JournalPort,
        emit: Callable[[SilenceChanged], None],
    ) -> None:
        self._quiet = quiet
        self._journal = journal
        self._emit = emit
        self._offset_ns: int | None = None
        self._ordered = False
        self._ends_at: int | None = None
        self._begun_at: int | None = None
        self._begun_utc_ns = 0
        self._duration_ns = 0
        self._is_recovered = False
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
        """Be silent from now on, for a time or until `resume`; replaces an earlier order.

        Args:
            now: The instant.
            duration_s: For how long, s; None: until `resume`.
            then: Called when it is written down.

        Raises:
            ValueError: A duration that is not above 0.
        """
        if duration_s is not None and not 0 < duration_s < float("inf"):
            raise ValueError(f"duration_s is {duration_s}; allowed: above 0")
        self._ordered, self._is_recovered, self._granted = True, False, None
        self._begun_at = now
        self._duration_ns = 0
        if duration_s is not None:
            self._duration_ns = min(_LONGEST_NS, max(1, seconds_to_ns(duration_s)))
        self._ends_at = now + self._duration_ns if self._duration_ns else None
        self._begun_utc_ns = 0 if self._offset_ns is None else now + self._offset_ns
        self._keep(then)

    def resume(self, now: int, *, then: Callable[[int], None] | None = None) -> None:
        """End the order; quiet windows stay. `then` is called when that is written down."""
        self._ordered, self._granted = False, None
        self._journal.write(SILENCE_KEY, None, lambda at: self._kept(at, then))

    def grant(self, lane: LaneKey, *, until: int) -> None:
        """Let one frame go all the same, with what waits in one lane, until an instant, ns."""
        self._granted = lane, until

    def use_grant(self) -> None:
        """That frame goes."""
        self._granted = None

    # Inputs

    def wake(self, now: int) -> None:
        """A life has begun, and this is the first instant at which anything could be sent."""
        if self._ordered and self._ends_at is None and self._duration_ns:
            self._ends_at = now + self._duration_ns

    def expire(self, now: int) -> None:
        """Forget an order that has come to its end."""
        if self._ordered and self._ends_at is not None and self._ends_at <= now:
            self.resume(now)

    def handle_clock(self, offset_ns: int, now: int) -> None:
        """UTC is `now + offset_ns`."""
        is_first = self._offset_ns is None
        self._offset_ns = offset_ns
        if not self._ordered or not is_first:
            return
        self.wake(now)
        if self._is_recovered:
            self._is_recovered = False
            passed_ns = now + offset_ns - self._begun_utc_ns
            if self._duration_ns and self._begun_utc_ns and passed_ns > 0:
                ends_at = now + max(0, self._duration_ns - passed_ns)
                self._ends_at = ends_at if self._ends_at is None else min(self._ends_at, ends_at)
        elif not self._begun_utc_ns and self._begun_at is not None:
            self._begun_utc_ns = self._begun_at + offset_ns
            self._keep()

    # Getters

    @property
    def next_deadline_at(self) -> int | None:
        """The end of an order, for `expire`, ns, or None."""
        return self._ends_at if self._ordered else None

    def until(self, now: int) -> int | None:
        """Return the end of the silence, ns; None: no end is known.

        At or before `now`: there is no silence.
        """
        ordered_until = self._ends_at if self._ordered else 0
        if ordered_until is None:
            return None
        return self._quiet_until(max(now, ordered_until)) if self._quiet else ordered_until

    def is_silent(self, now: int) -> bool:
        """Tell whether nothing may be transmitted now."""
        until = self.until(now)
        return until is None or until > now

    def granted(self, now: int) -> LaneKey | None:
        """Return the lane that may still be heard in this silence, or None."""
        if self._granted is None or self._granted[1] <= now or not self.is_silent(now):
            return None
        return self._granted[0]

    def state(self, now: int) -> SilenceChanged:
        """Return what holds now."""
        until = self.until(now)
        return SilenceChanged(
            is_silent=self.is_silent(now),
            is_ordered=self._ordered,
            ends_at=None if until is None or until <= now else until,
            changed_at=now,
        )

    # Below the methods above

    def _quiet_until(self, at: int) -> int | None:
        """End of the quiet windows that hold at an instant, or that instant."""
        if self._offset_ns is None:
            return None
        # A window may begin before another one has ended.
        for _ in self._quiet:
            left_ns = max(each.left_ns(at + self._offset_ns) for each in self._quiet)
            if not left_ns:
                break
            at += left_ns
        return at

    def _keep(self, then: Callable[[int], None] | None = None) -> None:
        value = self._begun_utc_ns.to_bytes(8, "big", signed=True)
        value += self._duration_ns.to_bytes(8, "big")
        self._journal.write(SILENCE_KEY, value, lambda at: self._kept(at, then))

    def _kept(self, now: int, then: Callable[[int], None] | None) -> None:
        self._emit(self.state(now))
        if then is not None:
            then(now)

    def _recover(self, kept: bytes | None) -> None:
        if kept is None or len(kept) != 16:
            return
        self._ordered = self._is_recovered = True
        self._begun_utc_ns = int.from_bytes(kept[:8], "big", signed=True)
        self._duration_ns = min(_LONGEST_NS, int.from_bytes(kept[8:], "big"))
