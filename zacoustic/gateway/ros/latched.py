"""A latched topic: whoever subscribes late gets the last samples at once, from a cache here.

A subscription of rmw_zenoh that is *transient local* asks the caches of publishers, each under
``KEY/@adv/pub/…``. Zenoh's advanced publisher is such a cache. It is declared in the worker, and
what arrives before that waits. It needs samples with time stamps: where the file has turned those
off there is no cache, and that is said.
"""

import logging
import threading
from collections import deque

import zenoh
import zenoh.ext

from zacoustic.core.qos import Priority
from zacoustic.island.session import Island, one_line, zenoh_priority

_logger = logging.getLogger(__name__)


class LatchedPublisher:
    """The cache of one key.

    Args:
        key: The key.
        depth: How many samples it keeps.
        island: Where it is.
        priority: Of its samples.
    """

    def __init__(self, key: str, depth: int, island: Island, priority: Priority) -> None:
        self._key = key
        self._depth = depth
        self._island = island
        self._priority = priority
        self._guard = threading.Lock()
        self._publisher: zenoh.ext.AdvancedPublisher | zenoh.Publisher | None = None
        self._waiting: deque[tuple[bytes, str, bytes | None]] = deque(maxlen=depth)

    def declare(self) -> None:
        """Declare it, and put what has waited; in the worker."""
        publisher: zenoh.ext.AdvancedPublisher | zenoh.Publisher
        try:
            publisher = zenoh.ext.declare_advanced_publisher(
                self._island.session,
                zenoh.KeyExpr(self._key),
                priority=zenoh_priority(self._priority),
                congestion_control=zenoh.CongestionControl.DROP,
                allowed_destination=zenoh.Locality.REMOTE,
                cache=zenoh.ext.CacheConfig(max_samples=self._depth),
                publisher_detection=True,
            )
        except zenoh.ZError as error:
            _logger.warning("%s: late joiners get nothing: %s", self._key, one_line(error))
            publisher = self._island.session.declare_publisher(
                zenoh.KeyExpr(self._key),
                priority=zenoh_priority(self._priority),
                congestion_control=zenoh.CongestionControl.DROP,
                allowed_destination=zenoh.Locality.REMOTE,
            )
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

    def undeclare(self) -> None:
        """Take it back; in the worker. What is put later waits for the next `declare`."""
        with self._guard:
            publisher, self._publisher = self._publisher, None
        if publisher is not None:
            publisher.undeclare()  # type: ignore[no-untyped-call]
