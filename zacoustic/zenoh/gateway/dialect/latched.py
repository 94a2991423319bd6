"""A latched topic: late subscribers get the last samples at once, from a cache here.

A cache is declared in the worker; samples that arrive before that wait.
"""

from zacoustic.core.base.clock import Clock
from zacoustic.core.base.qos import Priority
from zacoustic.zenoh.session.latching import LatchedPublisher
from zacoustic.zenoh.session.session import ZenohSession


class LatchedKeys:
    """The caches of one topic, one for each key that has or may have a sample.

    Args:
        depth: Number of samples that each keeps of each publisher.
        zenoh_session: Their session.
        priority: Priority of the samples.
        clock: Source of instants.
    """

    def __init__(
        self, depth: int, zenoh_session: ZenohSession, priority: Priority, clock: Clock
    ) -> None:
        self._depth = depth
        self._zenoh_session = zenoh_session
        self._priority = priority
        self._clock = clock
        self._caches: dict[str, LatchedPublisher] = {}
        self._is_declared = False

    def put(
        self,
        key: str,
        payload: bytes,
        encoding: str,
        attachment: bytes | None,
        *,
        expires_at: int | None,
        source: int = 0,
    ) -> None:
        """Put a sample of a key; on the loop.

        Args:
            key: The key.
            payload: The payload.
            encoding: Its encoding.
            attachment: Its attachment.
            expires_at: Instant from which no late joiner gets it, ns; None: never.
            source: Which publisher of the remote node has published it.
        """
        is_new = key not in self._caches
        cache = self._cache(key)
        cache.put(
            payload, encoding=encoding, attachment=attachment, expires_at=expires_at, source=source
        )
        if is_new and self._is_declared:
            self._zenoh_session.worker.submit(cache.declare)

    def forget(self, key: str) -> None:
        """Drop a deleted key's samples for late joiners; on the loop."""
        cache = self._caches.get(key)
        if cache is not None:
            cache.clear()

    def declare(self, *keys: str) -> None:
        """Declare the existing caches, and those of these keys; in the worker."""
        self._is_declared = True
        for key in keys:
            self._cache(key)
        for cache in list(self._caches.values()):
            cache.declare()

    def undeclare(self) -> None:
        """Undeclare them; in the worker."""
        self._is_declared = False
        for cache in list(self._caches.values()):
            cache.undeclare()

    # Below the methods above

    def _cache(self, key: str) -> LatchedPublisher:
        # Either the loop or the worker comes first; `setdefault` is atomic.
        made = LatchedPublisher(self._zenoh_session, key, self._depth, self._priority, self._clock)
        return self._caches.setdefault(key, made)
