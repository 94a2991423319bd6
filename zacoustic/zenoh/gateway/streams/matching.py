"""Local subscribers of topics: whether there are any.

Zenoh tells a publisher whether its key has subscribers (*matching*). So this gateway declares a
publisher that never puts anything: on the keys of the topic or, if they contain the name of the
node, one for each node that may publish. The gateway's own subscriptions do not count; those of
another local gateway that forwards the same topic do.

The gateway subscribes at remote nodes to the on-demand topics that have local subscribers.

A subscriber that goes often comes back at once: its program or the router restarts. So a
subscription outlasts its last local subscriber by `GRACE_S`, and such a restart costs no frames.
"""

import asyncio
import logging
import threading
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

import zenoh

from zacoustic.core.base.qos import Reliability
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.run.inbox import tell_loop
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.gateway.redundant import RedundantGateways
from zacoustic.zenoh.gateway.streams.topics import Topics
from zacoustic.zenoh.session.session import ZenohSession

GRACE_S: Final = 10.0
"""How long a subscription outlasts its last local subscriber, s."""
RETURN_S: Final = 5.0
"""Longest wait for subscribers after a restart, s; a Zenoh client tries to connect each 4 s."""
_ANY: Final = 0

_logger = logging.getLogger(__name__)


class Lookout:
    """Publishers whose matching is watched; made and undeclared in the worker.

    Args:
        declared: What was declared.
    """

    def __init__(self, declared: list[Any]) -> None:
        self._declared = declared

    def undeclare(self) -> None:
        """Stop to watch."""
        while self._declared:
            self._declared.pop().undeclare()


class MatchingSubscribers:
    """The local subscribers; for the loop, except for `declare`.

    Args:
        table: All streams.
        zenoh_session: Their session.
        redundant: The local gateways.
        topics: Dialects of the topics.
        runner: Runs the engine that subscribes.
        ring: Wakes the loop, which then calls `settle`.
        grace_s: How long a subscription outlasts its last local subscriber, s.
    """

    def __init__(
        self,
        table: StreamTable,
        zenoh_session: ZenohSession,
        redundant: RedundantGateways,
        topics: Topics,
        runner: LinkRunner,
        *,
        ring: Callable[[], None],
        grace_s: float | None = None,
    ) -> None:
        self._table = table
        self._zenoh_session = zenoh_session
        self._redundant = redundant
        self._topics = topics
        self._runner = runner
        self._ring = ring
        self._grace_s = GRACE_S if grace_s is None else grace_s
        self._loop = asyncio.get_running_loop()
        self._timers: dict[int, asyncio.TimerHandle] = {}
        self._watched: set[int] = set()
        self._guard = threading.Lock()
        self._matching: dict[tuple[int, int], bool] = {}

    def declare(self, stream: Stream) -> Lookout:
        """Watch the subscribers of a topic; in the worker."""
        declared: list[Any] = []
        for node, publisher in self._publishers(stream):
            declared.append(publisher)
            place = (stream.stream_id, node)
            with self._guard:
                self._matching.pop(place, None)
            listener = publisher.declare_matching_listener(
                self._zenoh_session.callback(partial(self._see, place))
            )
            declared.append(listener)
            status: Any = publisher.matching_status  # an object, not the bool of the stub
            with self._guard:
                self._matching.setdefault(place, bool(status.matching))
        self._ring()
        return Lookout(declared)

    async def have_returned(self, limit_s: float | None = None) -> None:
        """Wait for a subscriber of each reliable topic, after a restart of this gateway.

        Args:
            limit_s: Longest wait, s; None: `RETURN_S`.
        """
        awaited = {
            stream.stream_id
            for stream in self._table
            if stream.stream_id in self._topics.dialects
            and stream.qos.reliability is Reliability.RELIABLE
            and not self._topics.dialects[stream.stream_id].is_latched  # late joiners get it
            and self._redundant.delivers(stream)
        }
        if not awaited:
            return
        are_back = asyncio.Event()

        def see(stream_id: int) -> None:
            awaited.discard(stream_id)
            if not awaited:
                are_back.set()

        def look(stream_id: int, status: zenoh.MatchingStatus) -> None:
            if bool(status.matching):
                tell_loop(self._loop, partial(see, stream_id))

        def declare() -> Lookout:
            declared: list[Any] = []
            for stream_id in sorted(awaited):
                for _, publisher in self._publishers(self._table.by_id(stream_id)):
                    declared.append(publisher)
                    listener = publisher.declare_matching_listener(
                        self._zenoh_session.callback(partial(look, stream_id))
                    )
                    declared.append(listener)
                    status: Any = publisher.matching_status  # an object, not the bool of the stub
                    look(stream_id, status)
            return Lookout(declared)

        lookout = await self._zenoh_session.worker.run(declare)
        try:
            async with asyncio.timeout(RETURN_S if limit_s is None else limit_s):
                await are_back.wait()
        except TimeoutError:
            names = ", ".join(self._table.by_id(each).name for each in sorted(awaited))
            _logger.info("restarted, and nobody here subscribes to %s", names)
        finally:
            self._zenoh_session.worker.submit(lookout.undeclare)

    def watch(self, stream_ids: set[int]) -> None:
        """Set the watched topics: those that other gateways deliver are left to them."""
        for stream_id in self._watched - stream_ids:
            with self._guard:
                for place in [each for each in self._matching if each[0] == stream_id]:
                    del self._matching[place]
        left, self._watched = self._watched, set(stream_ids)
        for stream_id in left | self._watched:
            self._settle(stream_id)

    def settle(self) -> None:
        """Subscribe to the topics that have local subscribers."""
        for stream_id in self._watched:
            self._settle(stream_id)

    def close(self) -> None:
        """Stop to subscribe; subscriptions stay for the next start of the gateway."""
        self._watched.clear()
        for timer in self._timers.values():
            timer.cancel()
        self._timers.clear()

    def _publishers(self, stream: Stream) -> Iterator[tuple[int, zenoh.Publisher]]:
        """Declare publishers on the keys of a topic, with the node that they stand for."""
        dialect = self._topics.dialects[stream.stream_id]
        nodes: tuple[int, ...] = (_ANY,)
        if stream.keys.is_named_by_node:
            others = set(self._table.nodes) - {self._redundant.address}
            nodes = tuple(each for each in sorted(others) if stream.may_publish(each))
        for node in nodes:
            yield (
                node,
                self._zenoh_session.session.declare_publisher(
                    zenoh.KeyExpr(dialect.key(stream.keys.expression(node or None))),
                    allowed_destination=zenoh.Locality.REMOTE,
                    congestion_control=zenoh.CongestionControl.DROP,
                ),
            )

    def _see(self, place: tuple[int, int], status: zenoh.MatchingStatus) -> None:
        """Note that a topic got its first subscriber, or lost its last; on Zenoh's thread."""
        with self._guard:
            self._matching[place] = bool(status.matching)
        self._ring()

    def _sources(self, stream: Stream) -> frozenset[int]:
        """Return the remote nodes whose topic has local subscribers."""
        with self._guard:
            seen = {
                node
                for (stream_id, node), is_matching in self._matching.items()
                if is_matching and stream_id == stream.stream_id
            }
        publishers = self._runner.engine.subscriptions.publishers(stream)
        wanted = publishers if _ANY in seen else publishers & seen
        return wanted.difference(self._redundant.alive)

    def _settle(self, stream_id: int) -> None:
        stream = self._table.by_id(stream_id)
        before = self._runner.engine.subscriptions.wanted(stream_id)
        after = self._sources(stream)
        if not after >= before and stream_id not in self._timers:
            self._timers[stream_id] = self._loop.call_later(
                self._grace_s, self._withdraw, stream_id
            )
        if not after <= before:
            self._want(stream_id, before | after)

    def _withdraw(self, stream_id: int) -> None:
        """Unsubscribe from topics without local subscribers."""
        del self._timers[stream_id]
        before = self._runner.engine.subscriptions.wanted(stream_id)
        after = self._sources(self._table.by_id(stream_id)) & before
        if after != before:
            self._want(stream_id, after)

    def _want(self, stream_id: int, sources: frozenset[int]) -> None:
        self._runner.apply(lambda engine, now: engine.subscriptions.want(stream_id, now, sources))
