"""Network time: what slots are counted in, and how wrong it may be.

A policy with slots needs a time that several nodes have in common; the engine has only its own
monotonic one. What relates the two is an *offset*, and it has a source: the host of the node, whose
clock is UTC (a GPS receiver, NTP, a chip-scale clock), or one node of the fleet, which tells its
time in frames (CLOCK). With each offset comes the error that it may have; afterwards that error
grows by the drift of an oscillator until the next statement.

A new offset that differs from the old one by more than both errors allow is a *jump*: one of the
two was wrong, and nothing tells which. The network time is then not sure until a later statement,
at least ten seconds after, agrees with the new one. Whoever needs a time that is sure keeps silent
so long.

A source may say that it does not know how wrong it is. Nothing is learnt from such a statement: the
offset that is known stays, with its error. But a statement that contradicts it is a jump as well.
"""

from typing import Final

from zacoustic.core.base.clock import NS_PER_S

SETTLING_NS: Final = 10 * NS_PER_S
"""After a jump, the new time must hold so long."""
_PARTS: Final = 1_000_000


class NetworkTime:
    """The offset of network time to the engine's, as far as it is known.

    Args:
        drift_ppm: How fast the engine's clock goes wrong, 1e-6.
        tolerance_ns: What two statements may differ beyond their errors, ns.
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
        """Network time less the engine's, ns; None: never told."""
        return self._offset_ns

    @property
    def sure_at(self) -> int | None:
        """Earliest instant at which a statement can end the doubt, ns; None: there is none."""
        return None if self._doubted_at is None else self._doubted_at + self._settling_ns

    def tell(self, offset_ns: int, error_ns: int | None, now: int) -> bool:
        """Take a statement: network time is `now + offset_ns`, wrong by `error_ns` at most.

        Returns:
            Whether it is what counts from now on; otherwise what is known is better.
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

    def error_at(self, instant: int) -> int | None:
        """By how much network time may be wrong at an instant, ns; None: unknown, or in doubt."""
        if self._offset_ns is None or self._doubted_at is not None:
            return None
        return self._error_now(instant)

    def _error_now(self, now: int) -> int:
        drifted_ns = round(max(0, now - self._told_at) * self._drift_ppm / _PARTS)
        return self._error_ns + drifted_ns
