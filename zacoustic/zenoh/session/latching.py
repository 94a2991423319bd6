"""Latched topics on Zenoh: a publisher with a cache, a subscriber that asks for its content.

Zenoh's advanced subscriber with a history, such as a *transient local* subscription of rmw_zenoh,
asks the caches of publishers, each under ``KEY/@adv/pub/SESSION/uhlc/_``, and looks for their
tokens there. Zenoh's own cache neither drops a sample that has become too old nor one of a deleted
key, and counts the samples of all publishers of a key together; so `LatchedPublisher` answers these
queries itself. Subscribers order and compare samples by their time stamps.
"""

import json
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Final

import msgspec
import zenoh
import zenoh.ext

from zacoustic.core.base.clock import NS_PER_S, Clock
from zacoustic.core.base.qos import Priority
from zacoustic.zenoh.session.session import ZenohSession, zenoh_priority

_CACHE: Final = "@adv/pub/{}/uhlc/_"
_SINCE: Final = re.compile(r"\[now\(-([0-9.]+)s?\)\.\.")
"""The oldest time stamp that a query wants, as Zenoh's history writes it."""


class Kept(msgspec.Struct, frozen=True):
    """A sample for late joiners."""

    payload: bytes
    encoding: str
    attachment: bytes | None
    stamp: zenoh.Timestamp
    """Its time stamp."""
    put_at: int
    """Instant of its publication, ns."""
    expires_at: int | None
    """Instant from which no late joiner gets it, ns; None: never."""


class LatchedPublisher:
    """A publisher of one key that keeps its last samples for late joiners.

    Args:
        zenoh_session: The session.
        key: The key.
        depth: Number of samples that it keeps of each source.
        priority: Priority of its samples.
        clock: Source of instants.
    """

    def __init__(
        self,
        zenoh_session: ZenohSession,
        key: str,
        depth: int,
        priority: Priority,
        clock: Clock = time.monotonic_ns,
    ) -> None:
        self._zenoh_session = zenoh_session
        self._key = key
        self._depth = depth
        self._priority = priority
        self._clock = clock
        self._guard = threading.Lock()
        self._publisher: zenoh.Publisher | None = None
        self._declared: list[zenoh.Queryable[None] | zenoh.LivelinessToken] = []
        self._kept: dict[int, deque[Kept]] = {}
        self._waiting: deque[Kept] = deque()

    def declare(self) -> None:
        """Declare it if needed, and put the samples that wait for that; it may block."""
        if self._publisher is not None:
            return
        session = self._zenoh_session.session
        publisher = session.declare_publisher(
            zenoh.KeyExpr(self._key),
            priority=zenoh_priority(self._priority),
            congestion_control=zenoh.CongestionControl.DROP,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        cache = zenoh.KeyExpr(f"{self._key}/{_CACHE.format(session.zid())}")
        queryable = session.declare_queryable(cache, self._zenoh_session.callback(self._answer))
        with self._guard:
            self._publisher = publisher
            waiting, self._waiting = self._waiting, deque()
        for each in waiting:
            self._put(publisher, each)
        # Whoever sees the token asks at once.
        self._declared = [queryable, session.liveliness().declare_token(cache)]

    def put(
        self,
        payload: bytes,
        *,
        encoding: str,
        attachment: bytes | None = None,
        expires_at: int | None = None,
        source: int = 0,
    ) -> None:
        """Put a sample, at once or when it is declared.

        Args:
            payload: The payload.
            encoding: Its encoding.
            attachment: Its attachment.
            expires_at: Instant from which no late joiner gets it, ns; None: never.
            source: Which of the publishers that it stands for has published the sample.
        """
        stamp = self._zenoh_session.session.new_timestamp()
        kept = Kept(payload, encoding, attachment, stamp, self._clock(), expires_at)
        with self._guard:
            self._kept.setdefault(source, deque(maxlen=self._depth)).append(kept)
            publisher = self._publisher
            if publisher is None:
                self._waiting.append(kept)
                while len(self._waiting) > self._depth * len(self._kept):
                    self._waiting.popleft()
                return
        self._put(publisher, kept)

    def delete(self) -> None:
        """Delete the key, and forget its samples."""
        self.clear()
        if self._publisher is not None:
            self._publisher.delete()

    def clear(self) -> None:
        """Forget all samples."""
        with self._guard:
            self._kept.clear()
            self._waiting.clear()

    def undeclare(self) -> None:
        """Undeclare it; it may block. Its samples stay, and later ones wait for `declare`."""
        with self._guard:
            publisher, self._publisher = self._publisher, None
        while self._declared:
            self._declared.pop().undeclare()  # type: ignore[no-untyped-call]
        if publisher is not None:
            publisher.undeclare()  # type: ignore[no-untyped-call]

    # Below the methods above

    def _put(self, publisher: zenoh.Publisher, kept: Kept) -> None:
        publisher.put(
            kept.payload,
            encoding=kept.encoding,
            attachment=kept.attachment,
            timestamp=kept.stamp,
        )

    def _answer(self, query: zenoh.Query) -> None:
        """Reply with the samples that a late joiner wants; on Zenoh's thread."""
        with query:
            parameters = query.parameters
            if parameters.get("_sn") is not None:
                return  # that asks for numbers, and these samples have none
            most, now = parameters.get("_max"), self._clock()
            since = _SINCE.match(parameters.get("_time") or "")
            oldest_at = None if since is None else now - round(float(since[1]) * NS_PER_S)
            for each in self._of(now, int(most) if most and most.isdecimal() else None):
                if oldest_at is None or each.put_at >= oldest_at:
                    query.reply(
                        self._key,
                        each.payload,
                        encoding=each.encoding,
                        attachment=each.attachment,
                        timestamp=each.stamp,
                    )

    def _of(self, now: int, most: int | None) -> list[Kept]:
        """Return the samples that are not too old, so many of each source, by time stamp."""
        with self._guard:
            for kept in self._kept.values():
                fresh = [each for each in kept if each.expires_at is None or each.expires_at > now]
                if len(fresh) < len(kept):
                    kept.clear()
                    kept.extend(fresh)
            found = [each for kept in self._kept.values() for each in list(kept)[-(most or 0) :]]
        return sorted(found, key=lambda each: each.put_at)


def stamp_samples(settings: zenoh.Config) -> None:
    """Enable time stamps, which caches need, unless the file has its own setting."""
    if json.loads(settings.get_json("timestamping/enabled")) is None:
        everywhere = {"router": True, "peer": True, "client": True}
        settings.insert_json5("timestamping/enabled", json.dumps(everywhere))


def latched_subscriber(
    zenoh_session: ZenohSession, expression: str, take: Callable[[zenoh.Sample], None], depth: int
) -> "zenoh.ext.AdvancedSubscriber[None]":
    """Declare a subscriber that also gets the samples of caches.

    Args:
        zenoh_session: The session.
        expression: Keys of the subscriber.
        take: Receives samples, on a thread of Zenoh.
        depth: Number of earlier samples to request from each publisher.
    """
    return zenoh.ext.declare_advanced_subscriber(
        zenoh_session.session,
        zenoh.KeyExpr(expression),
        zenoh_session.callback(take),
        allowed_origin=zenoh.Locality.REMOTE,
        history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=depth),
    )
