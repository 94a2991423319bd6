"""The clocks of a node in a `VirtualNetwork`: one that drifts, and one that people set.

The engine gets the monotonic clock as `now`. It runs as fast as its crystal and starts again with
the computer, so its instants mean nothing after a reboot. People set the wall clock, forward and
back, even by years; no engine may depend on it.
"""

from typing import Final

from zacoustic.channel.faults.nodefaults import ClockSpec
from zacoustic.core.base.clock import seconds_to_ns

_PARTS: Final = 10**12
"""Drift is counted in parts of this number: integers, so that nothing is lost in a year."""
WALL_BEGINS_NS: Final = 1_767_225_600 * 10**9
"""Wall clock at the beginning of a scenario: 2026-01-01."""
_TELL_EVERY_NS: Final = 10 * 10**9
_BOOT_NS: Final = 10**9
"""Monotonic clock after a reboot, ns."""


class NodeClock:
    """Both clocks of one node.

    Args:
        spec: Faults of the clocks; None: none.
    """

    def __init__(self, spec: ClockSpec | None = None) -> None:
        spec = spec or ClockSpec(node=1, error_s=0.0)
        self._excess = round(spec.drift_ppm * 1e6)
        self._began_at = 0
        self._shows = 0
        self._offset_ns = seconds_to_ns(spec.offset_s)
        self._jumps = sorted(
            (seconds_to_ns(jump.at_s), seconds_to_ns(jump.by_s)) for jump in spec.jumps
        )
        self._error_ns = None if spec.error_s is None else seconds_to_ns(spec.error_s)
        self._told_at: int | None = None
        self.boots = 0
        """How often the computer has started again."""
        self.is_true = not self._excess
        """Whether the monotonic clock shows the time of the network."""

    def reboot(self, now: int) -> None:
        """Start the computer again."""
        self._began_at, self._shows = now, _BOOT_NS
        self.boots += 1
        self.is_true = False

    def local(self, now: int) -> int:
        """Return the monotonic clock at an instant, ns."""
        if self.is_true:
            return now
        passed = now - self._began_at
        return self._shows + passed + passed * self._excess // _PARTS

    def instant(self, local: int) -> int:
        """Return the first instant at which the monotonic clock shows `local` or more, ns."""
        if self.is_true:
            return local
        wanted = local - self._shows
        instant = self._began_at + wanted * _PARTS // (_PARTS + self._excess)
        while self.local(instant) < local:
            instant += 1
        return instant

    def wall(self, now: int) -> int:
        """Return the wall clock at an instant, ns since 1970."""
        drifted = now + now * self._excess // _PARTS
        set_by = sum(by_ns for at, by_ns in self._jumps if at <= now)
        return WALL_BEGINS_NS + self._offset_ns + drifted + set_by

    @property
    def is_told(self) -> bool:
        """Whether the engine learns of the wall clock."""
        return self._error_ns is not None

    def is_due(self, now: int) -> bool:
        """Tell whether the engine should learn of it again, ten seconds after the last time."""
        if not self.is_told:
            return False
        return self._told_at is None or now - self._told_at >= _TELL_EVERY_NS

    def told(self, now: int) -> None:
        """Note that the engine has learnt of it."""
        self._told_at = now

    def error(self, now: int) -> int:
        """Return the believed error of the wall clock, ns."""
        return (self._error_ns or 0) + abs(now * self._excess // _PARTS)
