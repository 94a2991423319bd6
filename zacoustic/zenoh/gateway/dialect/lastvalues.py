"""The last value of each key from the channel, for a `get` on a topic.

A key that has never arrived, or that was deleted, has none: then a `get` ends without a reply,
which is what Zenoh says when nobody has a value.
"""

from typing import Final

import msgspec

from zacoustic.core.base.clock import ns_to_seconds

KEYS_LIMIT: Final = 4096
"""Keys whose value is kept; the one that has not changed for longest makes room."""


class LastValue(msgspec.Struct, frozen=True, kw_only=True):
    """What a key was last set to."""

    key: str
    """The concrete key."""
    stream_id: int
    """Its stream."""
    payload: bytes
    """As it was put on the local network."""
    encoding: str
    """Its Zenoh encoding."""
    source: int
    """Acoustic address of the publisher."""
    age_s: float | None
    """Age when its frame was composed, s; None: the stream has no stamp."""
    received_at: int
    """Instant at which the frame had arrived, ns."""
    attachment: bytes | None = None
    """Its attachment."""

    def age_at(self, now: int) -> float | None:
        """Return the age with the time of its storage here, s."""
        return None if self.age_s is None else self.age_s + ns_to_seconds(now - self.received_at)


class LastValues:
    """The last values of one gateway; for the loop."""

    def __init__(self, limit: int = KEYS_LIMIT) -> None:
        self._limit = limit
        self._by_key: dict[str, LastValue] = {}

    def keep(self, value: LastValue) -> None:
        """Replace the value of a key."""
        self._by_key.pop(value.key, None)
        self._by_key[value.key] = value
        if len(self._by_key) > self._limit:
            del self._by_key[next(iter(self._by_key))]

    def forget(self, key: str) -> None:
        """Forget a deleted key."""
        self._by_key.pop(key, None)

    def of(self, stream_id: int) -> list[LastValue]:
        """Return the values of a stream, the one that changed last at the end."""
        return [value for value in self._by_key.values() if value.stream_id == stream_id]

    def __len__(self) -> int:
        return len(self._by_key)
