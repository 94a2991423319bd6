"""Blackouts: times in which no sound passes between two nodes, or to and from one.

The cause may be another vessel's sonar, a thermocline, or a hull in the way. Blocked sound is not
heard, so it collides with nothing and no carrier is sensed. A frame is lost if any part of its
arrival falls into a blackout.
"""

from collections.abc import Iterable
from typing import Final

import msgspec

from zacoustic.channel.faults.limits import check_range

_NS_PER_S: Final = 1_000_000_000
_MAX_TIME_S: Final = 1.0e9  # thirty years, as for tracks


class BlackoutSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One blackout, once or periodic."""

    node: int | None = None
    """Address of a node that hears nothing and is not heard; or a pair."""
    pair: tuple[int, int] | None = None
    """Addresses of two nodes that do not hear each other; or a node."""
    from_s: float
    """Begin, s, ≥ 0."""
    to_s: float
    """End, s, above `from_s`."""
    every_s: float | None = None
    """Period of repetitions, s, above the length; None: once."""

    def __post_init__(self) -> None:
        """Check the times, and that exactly one of node and pair is given.

        Raises:
            ValueError: A time outside its range, or not exactly one of node and pair.
        """
        if (self.node is None) == (self.pair is None):
            raise ValueError("node is missing; allowed: exactly one of node and pair")
        if self.pair is not None and self.pair[0] == self.pair[1]:
            raise ValueError(f"pair is {list(self.pair)}; allowed: two different nodes")
        check_span(self.from_s, self.to_s)
        if self.every_s is not None:
            check_range("every_s", self.every_s, 1e-3, _MAX_TIME_S)
            if self.every_s <= self.to_s - self.from_s:
                raise ValueError(
                    f"every_s is {self.every_s!r}; allowed: above to_s - from_s, which is "
                    f"{self.to_s - self.from_s:g}"
                )

    @property
    def nodes(self) -> tuple[int, ...]:
        """Addresses of the affected nodes."""
        return (self.node,) if self.node is not None else self.pair or ()

    def concerns(self, source: int, node: int) -> bool:
        """Tell whether it blocks sound from `source` to `node`."""
        if self.pair is not None:
            return source in self.pair and node in self.pair
        return self.node in (source, node)


class Darkness:
    """All blackouts of one direction.

    Args:
        specs: The blackouts of this direction only.
        until_s: End of their effect, s; None: no end.
    """

    def __init__(self, specs: Iterable[BlackoutSpec], until_s: float | None) -> None:
        self._until = None if until_s is None else round(until_s * _NS_PER_S)
        self._spans = [
            (
                round(spec.from_s * _NS_PER_S),
                round((spec.to_s - spec.from_s) * _NS_PER_S),
                None if spec.every_s is None else round(spec.every_s * _NS_PER_S),
            )
            for spec in specs
        ]

    def covers(self, starts_at: int, ends_at: int) -> bool:
        """Tell whether any part of the time between two instants, ns, is blacked out."""
        if self._until is not None and starts_at >= self._until:
            return False
        return any(_meet(span, starts_at, ends_at) for span in self._spans)


def check_span(from_s: float, to_s: float) -> None:
    """Check the keys ``from_s`` and ``to_s`` of a record.

    Raises:
        ValueError: A time outside its range, or an end that is not after the begin.
    """
    check_range("from_s", from_s, 0.0, _MAX_TIME_S)
    check_range("to_s", to_s, 0.0, _MAX_TIME_S)
    if not to_s > from_s:
        raise ValueError(f"to_s is {to_s!r}; allowed: above from_s, {from_s!r}")


def _meet(span: tuple[int, int, int | None], starts_at: int, ends_at: int) -> bool:
    begin, length, period = span
    if period is None or starts_at < begin:
        return starts_at < begin + length and ends_at > begin
    phase = (starts_at - begin) % period
    return phase < length or phase + (ends_at - starts_at) > period
