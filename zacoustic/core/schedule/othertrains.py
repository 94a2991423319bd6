"""The holes between the trains of a bulk service, as a third node hears them.

It hears sounds that it cannot read. While a train lasts, its receiver hears nobody; after it there
is a hole: its sender awaits the acknowledgement for a round trip, or longer if that is lost.
Whoever repeats something in its own rhythm may meet train after train, since both take a few
seconds.

A train is taken to be a sound about as long as the longest plain frame, or longer, that gives no
frame here, with such a sound and a hole before it. Plain frames in a row have no hole between them.

A sender whose trains were not acknowledged calls by short sounds, and awaits an answer to each. So
while trains are heard now and then, there is a hole after every sound, but not after the
acknowledgement of a train, which the next one follows at once.
"""

from typing import Final

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import LinkCapabilities

_LEAST_SHARE: Final = 0.75
"""A train is at least this part of the longest plain frame: packets may be fast and few."""
_LEAST_HOLE_NS: Final = 4 * NS_PER_S // 10
"""The shortest hole: the device turns round, and the other one acknowledges."""
_ACKNOWLEDGED_NS: Final = 4 * NS_PER_S
"""By then the acknowledgement of a train has been heard everywhere, or is lost."""
_RUN_NS: Final = 150 * NS_PER_S
"""Trains that are not acknowledged come no more seldom than this."""
_READ_NS: Final = NS_PER_S // 5
"""A device gives a frame this soon after its sound."""


class OtherTrains:
    """Which instants begin such a hole.

    Args:
        capabilities: The link's.
    """

    def __init__(self, capabilities: LinkCapabilities) -> None:
        self._least_ns = int(_LEAST_SHARE * capabilities.airtime_ns(capabilities.mtu_bytes))
        self._since: int | None = None
        self._long_at: int | None = None
        """When the last long sound ended, ns."""
        self._long_before: int | None = None
        """When the one before it ended, ns."""
        self._train_at: int | None = None
        """When the last train ended, ns."""

    def heard(self, now: int) -> None:
        """Take the instant of a frame: the sound that gave it is no train."""
        if self._long_at is None or now - self._long_at > _READ_NS:
            return
        if self._train_at == self._long_at:
            self._train_at = None
        self._long_at = self._long_before

    def begins_hole(self, busy: bool, now: int) -> bool:
        """Take the begin or end of another node's sound; return whether a hole begins with it."""
        since, self._since = self._since, now if busy else None
        if busy or since is None:
            return False
        if now - since < self._least_ns:
            train_at = self._train_at
            return train_at is not None and _ACKNOWLEDGED_NS < now - train_at < _RUN_NS
        before, self._long_before, self._long_at = self._long_at, self._long_at, now
        if before is None or not _LEAST_HOLE_NS <= since - before < _RUN_NS:
            return False
        self._train_at = now
        return True
