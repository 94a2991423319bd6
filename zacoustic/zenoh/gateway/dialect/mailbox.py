"""Samples from Zenoh's threads to the loop: bounded mailboxes.

Zenoh calls a subscriber on its own thread and stalls the whole session while that thread is slow.
So the callback does two things only: `Mailbox.post`, which keeps the newest samples of each key,
and `WakeUp.ring`. After a wake-up the loop empties all mailboxes.
"""

import threading
from collections import deque
from typing import Final

import msgspec

from zacoustic.core.values.encoding import LARGEST_VALUE_BYTES

# A stalled loop costs at most this much per stream, whatever its depth and number of keys: four
# times the largest value that is accepted.
MAILBOX_LIMIT_BYTES: Final = 4 * LARGEST_VALUE_BYTES
"""Capacity of one mailbox, bytes, counting each parcel with `PARCEL_OVERHEAD_BYTES`."""
PARCEL_OVERHEAD_BYTES: Final = 256
"""Memory of a parcel without its payload, bytes; an upper estimate."""


class Parcel(msgspec.Struct, frozen=True):
    """One sample as an application published it."""

    key: str
    """The concrete key."""
    payload: bytes
    """Payload as published; empty for a delete."""
    encoding: str
    """Zenoh's text of the encoding."""
    deleted: bool
    """The key was deleted."""
    arrived_at: int
    """Instant at which Zenoh handed it over, ns."""
    publisher: bytes = b""
    """What the network calls its publisher; empty: unknown, or of no matter."""


class Mailbox:
    """The newest samples of one stream, by key; `post` from any thread, the rest on the loop.

    Args:
        depth: Newest samples kept per key, ≥ 1.
        limit_bytes: Size of all; beyond it the oldest key makes room.
    """

    def __init__(self, depth: int, *, limit_bytes: int = MAILBOX_LIMIT_BYTES) -> None:
        self.superseded = 0
        """Samples that newer ones replaced before the loop took them."""
        self.oversized = 0
        """Samples with a payload above `LARGEST_VALUE_BYTES`."""
        self._depth = depth
        self._limit_bytes = limit_bytes
        self._guard = threading.Lock()
        self._by_key: dict[tuple[str, bytes], deque[Parcel]] = {}
        self._held_bytes = 0

    @property
    def oldest_at(self) -> int | None:
        """Arrival of its oldest sample, ns; None: it has none."""
        with self._guard:
            return min((kept[0].arrived_at for kept in self._by_key.values()), default=None)

    def post(self, parcel: Parcel) -> None:
        """Keep a sample."""
        with self._guard:
            if len(parcel.payload) > LARGEST_VALUE_BYTES:
                self.oversized += 1
                return
            kept = self._by_key.setdefault((parcel.key, parcel.publisher), deque())
            if len(kept) == self._depth:
                self._drop_oldest(kept)
            kept.append(parcel)
            self._held_bytes += _size_bytes(parcel)
            while self._held_bytes > self._limit_bytes:
                key, oldest = next(iter(self._by_key.items()))
                self._drop_oldest(oldest)
                if not oldest:
                    del self._by_key[key]

    def take(self) -> list[Parcel]:
        """Empty the mailbox in order of arrival."""
        with self._guard:
            by_key, self._by_key = self._by_key, {}
            self._held_bytes = 0
        parcels = [parcel for kept in by_key.values() for parcel in kept]
        parcels.sort(key=lambda parcel: parcel.arrived_at)
        return parcels

    def __len__(self) -> int:
        with self._guard:
            return sum(len(kept) for kept in self._by_key.values())

    def _drop_oldest(self, kept: deque[Parcel]) -> None:
        self._held_bytes -= _size_bytes(kept.popleft())
        self.superseded += 1


def _size_bytes(parcel: Parcel) -> int:
    return len(parcel.payload) + len(parcel.key) + PARCEL_OVERHEAD_BYTES
