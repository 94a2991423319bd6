"""The last value of each key from the channel, for a `get` on a topic.

A key that never arrived or was deleted has none. A `get` then ends without a reply, as always in
Zenoh when nobody has a value.
"""

from typing import Final

import msgspec

from zacoustic.core.base.clock import ns_to_seconds, seconds_to_ns

KEYS_LIMIT: Final = 4096
"""Number of keys with a stored value; the least recently changed one makes room."""


class LastValue(msgspec.Struct, frozen=True, kw_only=True):
    """The last value of a key."""

    key: str
    """The concrete key."""
    stream_id: int
    """Its stream."""
    payload: bytes
    """Payload as put on the local network."""
    encoding: str
    """Its Zenoh encoding."""
    source: int
    """Acoustic address of the publisher."""
    age_s: float | None
    """Age at `received_at`, s; None: unknown, or the stream has no stamp."""
    age_error_s: float | None = None
    """How wrong that may be, s; None: nothing bounds it."""
    received_at: int
    """Instant at which it was put here, ns."""
    attachment: bytes | None = None
    """Its attachment."""
    publisher: int = 0
    """Number of its publisher on the remote node."""
    journalled_s: float = 0.0
    """How long before that it had arrived, by the journal, s; part of its age."""

    def age_at(self, now: int) -> float | None:
        """Return the age including the time of its storage here, s."""
        return None if self.age_s is None else self.age_s + ns_to_seconds(now - self.received_at)

    def expires_at(self, lifespan_s: float | None) -> int | None:
        """Return the instant from which no late joiner gets it, ns; None: never.

        A sample without a stamp has an age of 0 when it arrives. One whose age is beyond the
        largest has expired.
        """
        if lifespan_s is None:
            return None
        left_s = lifespan_s - (self.journalled_s if self.age_s is None else self.age_s)
        return self.received_at + seconds_to_ns(left_s) if left_s > 0 else self.received_at


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
        """Return the values of a stream, the latest change at the end."""
        return [value for value in self._by_key.values() if value.stream_id == stream_id]

    def __len__(self) -> int:
        return len(self._by_key)
