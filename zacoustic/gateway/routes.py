"""Routes: what is declared on the island for each stream, as far as this gateway does the job.

=========  =========================  ====================================================
job        declared                   on
=========  =========================  ====================================================
forward    a subscriber               the keys that this node publishes
deliver    a queryable                the keys that come from beyond the water; it answers
                                      a `get` from the last value and is not complete: a
                                      storage on the island may know more
proxy      a complete queryable       the service's name, or all keys of the action
attend     a subscriber               the feedback of the program that serves the action
watch      publishers that put        the keys of an on-demand topic that is delivered here:
           nothing                    Zenoh tells them whether anybody subscribes
=========  =========================  ====================================================

Each of them costs a thread of Zenoh's. Declaring may block, so it is done in the worker, in order.
"""

from functools import partial
from typing import Final, TypeAlias

import zenoh

from zacoustic.core.streams import Stream, StreamTable
from zacoustic.core.streamspecs import ActionSpec
from zacoustic.gateway.actions import Actions
from zacoustic.gateway.onlookers import Lookout, Onlookers
from zacoustic.gateway.services import Services
from zacoustic.gateway.siblings import Siblings
from zacoustic.gateway.topics import Topics
from zacoustic.island.goals import ActionKey, every_key
from zacoustic.island.queries import HeldQuery, QueryDesk, Serve
from zacoustic.island.session import Island
from zacoustic.runtime import LinkRunner

FORWARD: Final = "forward"
DELIVER: Final = "deliver"
PROXY: Final = "proxy"
ATTEND: Final = "attend"
WATCH: Final = "watch"

Entity: TypeAlias = "zenoh.Subscriber[None] | zenoh.Queryable[None] | Lookout"
"""What is declared for one job on one stream."""


class Routes:
    """The declarations of one gateway; for the loop.

    Args:
        table: All streams.
        island: Where they are declared.
        siblings: Which jobs are ours.
        topics: Takes samples, answers a `get` on a topic.
        services: Takes calls.
        actions: Takes goals, and feedback.
        onlookers: Watches who subscribes to on-demand topics.
        desk: Takes queries from Zenoh's threads.
        runner: Gives calls to the engine.
    """

    def __init__(
        self,
        table: StreamTable,
        island: Island,
        siblings: Siblings,
        *,
        topics: Topics,
        services: Services,
        actions: Actions,
        onlookers: Onlookers,
        desk: QueryDesk,
        runner: LinkRunner,
    ) -> None:
        self.jobs: frozenset[tuple[str, int]] = frozenset()
        """Job and stream id of what is declared, or soon will be."""
        self._table = table
        self._island = island
        self._siblings = siblings
        self._topics = topics
        self._services = services
        self._actions = actions
        self._onlookers = onlookers
        self._desk = desk
        self._runner = runner
        # Of the worker alone.
        self._declared: dict[tuple[str, int], Entity] = {}

    def reconcile(self) -> None:
        """Declare what has become ours, undeclare what is not any more."""
        wanted = frozenset(
            (job, stream.stream_id)
            for stream in self._table
            for job, is_ours in (
                (FORWARD, self._siblings.forwards(stream)),
                (DELIVER, self._siblings.delivers(stream)),
                (PROXY, self._siblings.proxies(stream)),
                (ATTEND, self._siblings.attends(stream)),
                (WATCH, stream.is_on_demand and self._siblings.delivers(stream)),
            )
            if is_ours
        )
        gone, new = self.jobs - wanted, wanted - self.jobs
        self.jobs = wanted
        for key in sorted(gone):
            self._island.worker.submit(partial(self._undeclare, key))
        for job, stream_id in sorted(new):
            stream = self._table.by_id(stream_id)
            self._island.worker.submit(partial(self._declare, job, stream))
        self._onlookers.watch({stream_id for job, stream_id in wanted if job == WATCH})

    def undeclare(self) -> None:
        """Undeclare everything; in the worker."""
        for key in list(self._declared):
            self._undeclare(key)

    def _declare(self, job: str, stream: Stream) -> None:
        session, stream_id = self._island.session, stream.stream_id
        entity: Entity
        if job == FORWARD:
            entity = session.declare_subscriber(
                zenoh.KeyExpr(stream.keys.expression(self._siblings.address)),
                self._island.callback(partial(self._topics.post, stream_id)),
                allowed_origin=zenoh.Locality.REMOTE,
            )
        elif job == ATTEND:
            entity = session.declare_subscriber(
                zenoh.KeyExpr(ActionKey.FEEDBACK.of(stream.name)),
                self._island.callback(self._actions.ear(stream_id)),
                allowed_origin=zenoh.Locality.REMOTE,
            )
        elif job == WATCH:
            entity = self._onlookers.declare(stream)
        else:
            key, serve = self._served(job, stream)
            entity = session.declare_queryable(
                zenoh.KeyExpr(key),
                self._island.callback(partial(self._desk.admit, serve)),
                complete=job == PROXY,
                allowed_origin=zenoh.Locality.REMOTE,
            )
        self._declared[(job, stream_id)] = entity

    def _undeclare(self, key: tuple[str, int]) -> None:
        entity = self._declared.pop(key, None)
        if entity is not None:
            entity.undeclare()

    def _served(self, job: str, stream: Stream) -> tuple[str, Serve]:
        """Return the key of a queryable, and who answers there."""
        stream_id = stream.stream_id
        if job == DELIVER:
            return self._asked(stream), self._answer(stream_id)
        if isinstance(stream.spec, ActionSpec):
            return every_key(stream.name), partial(self._actions.ask, stream_id)
        return stream.name, self._call(stream_id)

    def _asked(self, stream: Stream) -> str:
        """Return the key expression of what comes from beyond the water."""
        publishers = self._siblings.publishers_beyond(stream)
        only_one = publishers is not None and len(publishers) == 1
        return stream.keys.expression(publishers[0] if publishers and only_one else None)

    def _answer(self, stream_id: int) -> Serve:
        return lambda held: self._topics.answer(held, stream_id)

    def _call(self, stream_id: int) -> Serve:
        def call(held: HeldQuery) -> None:
            self._runner.apply(
                lambda engine, now: self._services.call(held, stream_id, engine, now)
            )

        return call
