"""Routes: local declarations for each stream whose job this gateway does.

=========  =========================  ====================================================
job        declared                   on
=========  =========================  ====================================================
forward    a subscriber               the keys that this node publishes
deliver    a queryable                the keys of remote nodes; it answers a `get` from the
                                      last value and is not complete: a local storage may
                                      know more
proxy      complete queryables        the service's name, or all keys of the action; not
                                      while its dialect stands back
serve      nothing of Zenoh's         a service of this node: its client becomes visible
attend     a subscriber               the feedback of the program that serves the action
watch      publishers that put        the keys of an on-demand topic that is delivered here:
           nothing                    Zenoh tells them whether there are subscribers
=========  =========================  ====================================================

Keys are those of the stream's dialect, which also makes the job visible. Each declaration costs a
thread of Zenoh's. Declaring may block, so the worker does it, in order.
"""

from functools import partial

import zenoh

from zacoustic.core.streams.specs import ActionSpec, ServiceSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.gateway.dialect.dialects import Declared, Dialects
from zacoustic.zenoh.gateway.jobs import ATTEND, DELIVER, FORWARD, PROXY, SERVE, WATCH
from zacoustic.zenoh.gateway.redundant import RedundantGateways
from zacoustic.zenoh.gateway.streams.handlers import StreamHandlers
from zacoustic.zenoh.session.asking.goals import ActionKey
from zacoustic.zenoh.session.asking.queries import QueryHandler, Serve
from zacoustic.zenoh.session.session import ZenohSession


class Routes:
    """The declarations of one gateway; for the loop.

    Args:
        table: All streams.
        zenoh_session: The session of the declarations.
        redundant: Decides which of the shared jobs this gateway does.
        streams: Take samples, calls and goals.
        dialects: Make jobs visible, and see local programs.
        queries: Takes queries from Zenoh's threads.
        runner: Gives calls to the engine.
    """

    def __init__(
        self,
        table: StreamTable,
        zenoh_session: ZenohSession,
        redundant: RedundantGateways,
        *,
        streams: StreamHandlers,
        dialects: Dialects,
        queries: QueryHandler,
        runner: LinkRunner,
    ) -> None:
        self.jobs: frozenset[tuple[str, int]] = frozenset()
        """Job and stream id of present declarations, and of those in progress."""
        self.table = table
        """All streams."""
        self._zenoh_session = zenoh_session
        self._redundant = redundant
        self._streams = streams
        self._dialects = dialects
        self._queries = queries
        self._runner = runner
        # Used by the worker only.
        self._declared: dict[tuple[str, int], list[Declared]] = {}

    def reconcile(self) -> None:
        """Declare new jobs, undeclare ended ones."""
        wanted = frozenset(
            (job, stream.stream_id)
            for stream in self.table
            for job, is_ours in (
                (FORWARD, self._redundant.forwards(stream)),
                (DELIVER, self._redundant.delivers(stream)),
                (PROXY, self._proxies(stream)),
                (SERVE, self._serves(stream)),
                (ATTEND, self._redundant.attends(stream)),
                (WATCH, stream.is_on_demand and self._redundant.delivers(stream)),
            )
            if is_ours
        )
        gone, new = self.jobs - wanted, wanted - self.jobs
        self.jobs = wanted
        for key in sorted(gone):
            self._zenoh_session.worker.submit(partial(self._undeclare, key))
        for job, stream_id in sorted(new):
            stream = self.table.by_id(stream_id)
            self._zenoh_session.worker.submit(partial(self._declare, job, stream))
        self._streams.matching.watch({stream_id for job, stream_id in wanted if job == WATCH})

    def undeclare(self) -> None:
        """Undeclare everything; in the worker."""
        for key in list(self._declared):
            self._undeclare(key)

    def _proxies(self, stream: Stream) -> bool:
        return self._redundant.proxies(stream) and not self._dialects.stands_back(stream)

    def _serves(self, stream: Stream) -> bool:
        is_ours = (
            isinstance(stream.spec, ServiceSpec) and stream.spec.server == self._redundant.address
        )
        return is_ours and self._dialects.visible(stream)

    def _declare(self, job: str, stream: Stream) -> None:
        # A program may use what it sees at once, so the visible part comes last.
        self._declared[(job, stream.stream_id)] = [
            *self._entities(job, stream),
            *self._dialects.declare(job, stream),
        ]

    def _entities(self, job: str, stream: Stream) -> list[Declared]:
        session, stream_id = self._zenoh_session.session, stream.stream_id
        if job == SERVE:
            return []
        if job == WATCH:
            return [self._streams.matching.declare(stream)]
        if job == ATTEND:
            key = self._streams.actions.forms[stream_id].key(ActionKey.FEEDBACK)
            subscriber = session.declare_subscriber(
                zenoh.KeyExpr(key),
                self._zenoh_session.callback(self._streams.actions.ear(stream_id)),
                allowed_origin=zenoh.Locality.REMOTE,
            )
            return [subscriber]
        if job == FORWARD:
            dialect = self._streams.topics.dialects[stream_id]
            expression = dialect.key(stream.keys.expression(self._redundant.address))
            return list(self._streams.topics.intake.subscribe(stream_id, expression))
        declared: list[Declared] = []
        keys, serve = self._served(job, stream)
        for key in keys:
            queryable = session.declare_queryable(
                zenoh.KeyExpr(key),
                self._zenoh_session.callback(partial(self._queries.admit, serve)),
                complete=job == PROXY,
                allowed_origin=zenoh.Locality.REMOTE,
            )
            declared.append(queryable)
        if job == DELIVER:
            declared += self._streams.topics.dialects[stream_id].offer(self._sources(stream))
        return declared

    def _undeclare(self, key: tuple[str, int]) -> None:
        for entity in reversed(self._declared.pop(key, [])):
            entity.undeclare()

    def _served(self, job: str, stream: Stream) -> tuple[tuple[str, ...], Serve]:
        """Return the keys of queryables, and the function that answers."""
        stream_id = stream.stream_id
        if job == DELIVER:
            return (self._asked(stream),), self._answer(stream_id)
        if isinstance(stream.spec, ActionSpec):
            actions = self._streams.actions
            return actions.forms[stream_id].served(), partial(actions.ask, stream_id)
        services = self._streams.services
        return (services.dialects[stream_id].key,), partial(services.ask, stream_id)

    def _asked(self, stream: Stream) -> str:
        """Return the key expression of remote samples."""
        publishers = self._redundant.publishers_beyond(stream)
        only_one = publishers is not None and len(publishers) == 1
        expression = stream.keys.expression(publishers[0] if publishers and only_one else None)
        return self._streams.topics.dialects[stream.stream_id].key(expression)

    def _sources(self, stream: Stream) -> tuple[int, ...]:
        """Return the remote nodes that may publish, if they are listed."""
        publishers = self._redundant.publishers_beyond(stream)
        if publishers is None:
            return tuple(each for each in self.table.nodes if each not in self._redundant.alive)
        return publishers

    def _answer(self, stream_id: int) -> Serve:
        return lambda held: self._streams.topics.answer(held, stream_id)
