"""A latched topic: late subscribers get the last samples at once, from a cache here.

A cache is declared in the worker; samples that arrive before that wait.
"""

import threading
from collections import deque
from functools import partial

from zacoustic.core.base.qos import Priority
from zacoustic.zenoh.session.latching import Latched, latched_publisher
from zacoustic.zenoh.session.session import ZenohSession


class LatchedPublisher:
    """The cache of one key.

    Args:
        key: The key.
        depth: Number of samples that it keeps.
        zenoh_session: The session.
        priority: Priority of its samples.
    """

    def __init__(
        self, key: str, depth: int, zenoh_session: ZenohSession, priority: Priority
    ) -> None:
        self._key = key
        self._depth = depth
        self._zenoh_session = zenoh_session
        self._priority = priority
        self._guard = threading.Lock()
        self._publisher: Latched | None = None
        self._waiting: deque[tuple[bytes, str, bytes | None]] = deque(maxlen=depth)

    def declare(self) -> None:
        """Declare it if needed, and put waiting samples; in the worker."""
        if self._publisher is not None:
            return
        publisher = latched_publisher(self._zenoh_session, self._key, self._depth, self._priority)
        with self._guard:
            self._publisher = publisher
            waiting = list(self._waiting)
            self._waiting.clear()
        for payload, encoding, attachment in waiting:
            publisher.put(payload, encoding=encoding, attachment=attachment)

    def put(self, payload: bytes, encoding: str, attachment: bytes | None) -> None:
        """Put a sample; on the loop."""
        with self._guard:
            publisher = self._publisher
            if publisher is None:
                self._waiting.append((payload, encoding, attachment))
                return
        publisher.put(payload, encoding=encoding, attachment=attachment)

    def clear(self) -> Latched | None:
        """Forget all samples; on the loop. Later puts wait for the next `declare`.

        Returns:
            The publisher that still has them, to be undeclared in the worker.
        """
        with self._guard:
            publisher, self._publisher = self._publisher, None
            self._waiting.clear()
        return publisher

    def undeclare(self) -> None:
        """Undeclare it; in the worker. Later puts wait for the next `declare`."""
        with self._guard:
            publisher, self._publisher = self._publisher, None
        if publisher is not None:
            publisher.undeclare()  # type: ignore[no-untyped-call]


class LatchedKeys:
    """The caches of one topic, one for each key that has or may have a sample.

    Args:
        depth: Number of samples that each keeps.
        zenoh_session: Their session.
        priority: Priority of the samples.
    """

    def __init__(self, depth: int, zenoh_session: ZenohSession, priority: Priority) -> None:
        self._depth = depth
        self._zenoh_session = zenoh_session
        self._priority = priority
        self._caches: dict[str, LatchedPublisher] = {}
        self._is_declared = False

    def put(self, key: str, payload: bytes, encoding: str, attachment: bytes | None) -> None:
        """Put a sample of a key; on the loop."""
        is_new = key not in self._caches
        cache = self._cache(key)
        cache.put(payload, encoding, attachment)
        if is_new and self._is_declared:
            self._zenoh_session.worker.submit(cache.declare)

    def forget(self, key: str) -> None:
        """Drop a deleted key's samples for late joiners; on the loop."""
        cache = self._caches.get(key)
        if cache is not None:
            self._zenoh_session.worker.submit(partial(self._renew, cache, cache.clear()))

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

    def _renew(self, cache: LatchedPublisher, full: Latched | None) -> None:
        """Undeclare a cache, which Zenoh cannot empty, and declare another one."""
        if full is not None:
            full.undeclare()  # type: ignore[no-untyped-call]
        if self._is_declared:
            cache.declare()

    def _cache(self, key: str) -> LatchedPublisher:
        # Either the loop or the worker comes first; `setdefault` is atomic.
        made = LatchedPublisher(key, self._depth, self._zenoh_session, self._priority)
        return self._caches.setdefault(key, made)
