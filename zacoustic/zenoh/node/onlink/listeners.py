"""Subscriptions on a link: their samples, and the on-demand topics that they need.

For later subscriptions, they keep the last samples of each key of a latched topic.
"""

import contextlib
from collections import deque
from collections.abc import Callable
from typing import Any, TypeAlias

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.qos import Durability
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.values.encoding import OPAQUE
from zacoustic.errors import LinkClosedError
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.node.carrier import Incoming
from zacoustic.zenoh.node.routes import TopicRoute

Deliver: TypeAlias = Callable[[Incoming], None]
"""Receives each sample."""


class Listeners:
    """The subscriptions of one node; for the loop.

    Args:
        runner: Drives the engine.
        table: The streams.
    """

    def __init__(self, runner: LinkRunner, table: StreamTable) -> None:
        self._runner = runner
        self._table = table
        self._listeners: dict[int, dict[object, tuple[str | None, Deliver]]] = {}
        self._latched: dict[int, dict[tuple[str, int], deque[Incoming]]] = {}
        """The last samples by stream, and by key and publisher."""

    def add(self, route: TopicRoute[Any], deliver: Deliver) -> Callable[[], None]:
        """Deliver the samples of a topic, or of one key; return the function that ends it."""
        stream = route.known_stream
        listeners = self._listeners.setdefault(stream.stream_id, {})
        token = object()
        listeners[token] = (route.key, deliver)
        self._want(stream)
        for (key, _), samples in self._latched.get(stream.stream_id, {}).items():
            if route.key in (None, key):
                for incoming in tuple(samples):
                    if not self._has_expired(
                        stream, incoming, self._runner.apply(lambda engine, now: now)
                    ):
                        deliver(incoming)

        def stop() -> None:
            if listeners.pop(token, None) is not None:
                with contextlib.suppress(LinkClosedError):
                    self._want(stream)

        return stop

    def deliver(self, event: SampleReceived) -> None:
        """Pass a sample to its subscriptions."""
        stream = self._table.by_id(event.stream_id)
        is_latched = stream.qos.durability is Durability.TRANSIENT_LOCAL
        listeners = self._listeners.get(event.stream_id, {})
        if not listeners and not is_latched:
            return
        key = stream.keys.key(event.source, event.instance)
        incoming = Incoming(
            key=key,
            value=event.value,
            source=event.source,
            deleted=event.deleted,
            encoding=event.encoding or OPAQUE,
            age_s=event.age_s,
            age_error_s=event.age_error_s,
            received_at=event.received_at,
            metrics=event.metrics,
        )
        if is_latched:
            self._keep(stream, incoming, stream.keys.publisher(event.instance))
        for wanted, take in tuple(listeners.values()):
            if wanted in (None, key):
                take(incoming)

    def _keep(self, stream: Stream, incoming: Incoming, publisher: int) -> None:
        """Keep a sample of a latched topic; keep nothing for a deleted key."""
        keys = self._latched.setdefault(stream.stream_id, {})
        if incoming.deleted:
            for place in [place for place in keys if place[0] == incoming.key]:
                del keys[place]
        else:
            place = (incoming.key, publisher)
            keys.setdefault(place, deque(maxlen=stream.qos.depth)).append(incoming)

    def _has_expired(self, stream: Stream, incoming: Incoming, now: int) -> bool:
        """Return whether a sample is older than its lifespan; without a stamp, since it came."""
        lifespan_s = stream.qos.lifespan_s
        if lifespan_s is None:
            return False
        age_s = ns_to_seconds(now - incoming.received_at) + (incoming.age_s or 0.0)
        return age_s >= lifespan_s

    def _want(self, stream: Stream) -> None:
        """Subscribe to an on-demand topic while it has local subscribers."""
        if not stream.is_on_demand:
            return
        keys = {key for key, _ in self._listeners[stream.stream_id].values()}
        publishers = self._runner.engine.subscriptions.publishers(stream)
        sources = {
            source
            for source in publishers
            for key in keys
            if key is None or stream.keys.match(key, source) is not None
        }
        self._runner.apply(
            lambda engine, now: engine.subscriptions.want(stream.stream_id, now, sources)
        )
