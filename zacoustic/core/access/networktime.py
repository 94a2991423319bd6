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
"""

from typing import Final

from zacoustic.core.clock import NS_PER_S

SETTLING_NS: Final = 10 * NS_PER_S
"""After a jump, the new time must hold so long."""
_PARTS: Final = 1_000_000


class NetworkTime:
    """The offset of network time to the engine's, as far as it is known.

    Args:
        drift_ppm: How fast the engine's clock goes wrong, 1e-6.
    """

    def __init__(self, drift_ppm: float) -> None:
        self._drift_ppm = drift_ppm
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
        return None if self._doubted_at is None else self._doubted_at + SETTLING_NS

    def tell(self, offset_ns: int, error_ns: int, now: int) -> None:
        """Take a statement: network time is `now + offset_ns`, wrong by `error_ns` at most."""
        if self._offset_ns is not None:
            known_ns = self._error_now(now)
            if abs(offset_ns - self._offset_ns) > known_ns + error_ns:
                self._doubted_at = now
            else:
                if self._doubted_at is not None and now - self._doubted_at >= SETTLING_NS:
                    self._doubted_at = None
                if error_ns > known_ns:
                    return  # what is known is better
        self._offset_ns, self._error_ns, self._told_at = offset_ns, error_ns, now

    def error_at(self, instant: int) -> int | None:
        """By how much network time may be wrong at an instant, ns; None: unknown, or in doubt."""
        if self._offset_ns is None or self._doubted_at is not None:
            return None
        return self._error_now(instant)

    def _error_now(self, now: int) -> int:
        drifted_ns = round(max(0, now - self._told_at) * self._drift_ppm / _PARTS)
        return self._error_ns + drifted_ns
