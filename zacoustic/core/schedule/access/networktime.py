"""Network time: the time base of slots, and its error.

A policy with slots needs a time that several nodes have in common; the engine has only its own
monotonic time. An *offset* relates the two, and it has a source: the host of the node, whose clock
is UTC (a GPS receiver, NTP, a chip-scale clock), or one node of the fleet, which sends its time in
frames (CLOCK). Each offset comes with its largest error; afterwards that error grows by the drift
of an oscillator until the next statement.

A new offset that differs from the old one by more than both errors allow is a *jump*: one of the
two was wrong, and nothing tells which. The network time is then not sure until a later statement,
at least ten seconds after, agrees with the new one. A component that needs a sure time keeps silent
that long.

A source may say that it does not know its error. Nothing is learnt from such a statement: the known
offset stays, with its error. But a statement that contradicts it is a jump as well.
"""

from typing import Final

from zacoustic.core.base.clock import NS_PER_S

SETTLING_NS: Final = 10 * NS_PER_S
"""How long the new time must hold after a jump, ns."""
_PARTS: Final = 1_000_000


class NetworkTime:
    """The offset of network time from the engine's time, as far as it is known.

    Args:
        drift_ppm: Drift of the engine's clock, 1e-6.
        tolerance_ns: Allowed difference of two statements beyond their errors, ns.
        settling_ns: How long a new time must hold after a jump, ns; 0: it counts at once.
    """

    def __init__(
        self, drift_ppm: float, *, tolerance_ns: int = 0, settling_ns: int = SETTLING_NS
    ) -> None:
        self._drift_ppm = drift_ppm
        self._tolerance_ns = tolerance_ns
        self._settling_ns = settling_ns
        self._offset_ns: int | None = None
        self._error_ns = 0
        self._told_at = 0
        self._doubted_at: int | None = None

    @property
    def offset_ns(self) -> int | None:
        """Network time minus the engine's time, ns; None: unknown."""
        return self._offset_ns

    @property
    def sure_at(self) -> int | None:
        """The earliest instant at which a statement can end the doubt, ns; None: no doubt."""
        return None if self._doubted_at is None else self._doubted_at + self._settling_ns

    def tell(self, offset_ns: int, error_ns: int | None, now: int) -> bool:
        """Take a statement: network time is `now + offset_ns`, within `error_ns`.

        Returns:
            Whether it is used from now on; otherwise the known offset is better.
        """
        if self._offset_ns is not None:
            known_ns = self._error_now(now)
            allowed_ns = known_ns + (error_ns or 0) + self._tolerance_ns
            if abs(offset_ns - self._offset_ns) > allowed_ns:
                counts = error_ns is not None and not self._settling_ns
                self._doubted_at = None if counts else now
            else:
                if self._doubted_at is not None and now - self._doubted_at >= self._settling_ns:
                    self._doubted_at = None
                if error_ns is not None and error_ns > known_ns:
                    return False
        if error_ns is None:
            return False
        self._offset_ns, self._error_ns, self._told_at = offset_ns, error_ns, now
        return True

    def confirm(self) -> None:
        """End the doubt after a jump: something else has shown that the new time is right."""
        self._doubted_at = None

    def error_at(self, instant: int) -> int | None:
        """Return the largest error of network time at an instant, ns; None: unknown."""
        if self._offset_ns is None or self._doubted_at is not None:
            return None
        return self._error_now(instant)

    def _error_now(self, now: int) -> int:
        drifted_ns = round(max(0, now - self._told_at) * self._drift_ppm / _PARTS)
        return self._error_ns + drifted_ns
