"""The two clocks of a node: the engine's instants, and UTC, which the engine gets as an input."""

import time
from typing import Final

from zacoustic.core.base.clock import NS_PER_S, Clock, seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.run.hostclock import HostClock

# The engine gets UTC at least this often while it is driven, and whenever UTC has moved by more
# than the time between two consecutive clock readings explains.
_TELL_NS: Final = 10 * NS_PER_S
_JITTER_NS: Final = NS_PER_S // 1000


class NodeClocks:
    """The clocks of one node; used only on the loop.

    Args:
        clock: Source of instants, the same as the link's.
        host: Tells UTC and its error; None: the engine never gets UTC.
        stated_error_s: Error of UTC, s, if the host does not know it.
    """

    def __init__(
        self,
        clock: Clock = time.monotonic_ns,
        host: HostClock | None = None,
        *,
        stated_error_s: float = 0.0,
    ) -> None:
        self.clock = clock
        """Source of instants."""
        self.now = 0
        """The last instant."""
        self._host = host
        self._stated_error_ns = seconds_to_ns(stated_error_s)
        self._offset_ns = 0
        self._told: Engine | None = None
        self._told_at = 0

    def instant(self) -> int:
        """Return the present instant; never decreases."""
        self.now = max(self.now, self.clock())
        return self.now

    def utc_offset_ns(self) -> int | None:
        """Return UTC less the instants, ns; None: no source of UTC."""
        return None if self._host is None else self._host.utc_ns() - self.clock()

    def tell(self, engine: Engine) -> None:
        """Give UTC to an engine: to a new one, after a clock change, or after a long time."""
        now, offset_ns = self.instant(), self.utc_offset_ns()
        if self._host is None or offset_ns is None:
            return
        is_old = engine is not self._told or now - self._told_at >= _TELL_NS
        if is_old or abs(offset_ns - self._offset_ns) > _JITTER_NS:
            self._offset_ns, self._told, self._told_at = offset_ns, engine, now
            state = self._host.ask()
            error_ns = self._stated_error_ns if state is None else state.error_ns
            engine.handle_clock(offset_ns, error_ns, now)
