"""Selects the streams of ROS 2, and makes their jobs visible."""

import time
from collections.abc import Callable, Sequence

from zacoustic.config.ros import RosConfig
from zacoustic.core.base.clock import Clock
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.ros.streams import RosAction, RosService, RosTopic
from zacoustic.zenoh.gateway.dialect.dialects import (
    Declared,
    Dialects,
    ServiceDialect,
    TopicDialect,
)
from zacoustic.zenoh.gateway.dialect.ros.actions import RosActionForm, putter
from zacoustic.zenoh.gateway.dialect.ros.graph import Graph
from zacoustic.zenoh.gateway.dialect.ros.services import RosServiceDialect
from zacoustic.zenoh.gateway.dialect.ros.topics import RosTopicDialect
from zacoustic.zenoh.gateway.inputerrors import InputErrors
from zacoustic.zenoh.gateway.jobs import FORWARD, PROXY
from zacoustic.zenoh.session.asking.goals import ActionForm, ActionKey
from zacoustic.zenoh.session.session import ZenohSession


class RosDialects(Dialects):
    """The dialects of a local network with ROS nodes.

    Args:
        address: Acoustic address of this gateway.
        table: All streams.
        ros: The ROS streams among them.
        zenoh_session: Their session.
        input_errors: Takes endpoints that do not fit.
        ring: Wakes the loop, which then calls `settle`.
        clock: Source of instants.
        wall_clock: Returns UTC, ns since 1970.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        ros: RosConfig,
        zenoh_session: ZenohSession,
        input_errors: InputErrors,
        ring: Callable[[], None],
        *,
        clock: Clock = time.monotonic_ns,
        wall_clock: Clock = time.time_ns,
    ) -> None:
        super().__init__(zenoh_session, clock)
        self._address = address
        self._table = table
        self._ros = ros.streams
        self._input_errors = input_errors
        self._wall_clock = wall_clock
        self._graph = Graph(ros.domain, address, zenoh_session, input_errors, ring)
        self._topics: dict[int, RosTopicDialect] = {}
        self._services: dict[int, RosServiceDialect] = {}
        self._actions: dict[int, RosActionForm] = {}
        self._lost: set[int] = set()

    def topic(self, stream: Stream) -> TopicDialect:
        """Return the dialect of a topic."""
        ros = self._ros.get(stream.stream_id)
        if not isinstance(ros, RosTopic):
            return super().topic(stream)
        made = self._topics[stream.stream_id] = RosTopicDialect(
            stream,
            self._zenoh_session,
            ros,
            self._graph,
            self._input_errors,
            self._wall_clock,
            self._clock,
        )
        made.expect(tuple(self._table.nodes))
        return made

    def service(self, stream: Stream) -> ServiceDialect:
        """Return the dialect of a service."""
        ros = self._ros.get(stream.stream_id)
        if not isinstance(ros, RosService):
            return super().service(stream)
        made = self._services[stream.stream_id] = RosServiceDialect(
            stream, ros, self._graph, self._wall_clock
        )
        return made

    def action(self, stream: Stream) -> ActionForm:
        """Return the form of the messages about an action's goals."""
        ros = self._ros.get(stream.stream_id)
        if not isinstance(ros, RosAction):
            return super().action(stream)
        made = self._actions[stream.stream_id] = RosActionForm(
            stream, ros, self._graph, self._zenoh_session, self._wall_clock
        )
        return made

    def put_about_goals(
        self, stream: Stream, form: ActionForm
    ) -> Callable[[ActionKey, bytes], None]:
        """Return a function that puts feedback and status of remote goals."""
        if stream.stream_id not in self._actions:
            return super().put_about_goals(stream, form)
        return putter(form)

    async def open(self) -> None:
        """Announce the gateway's node, and watch other nodes."""
        await self._graph.open()

    def declare(self, job: str, stream: Stream) -> Sequence[Declared]:
        """Announce the endpoints of a job; in the worker."""
        stream_id = stream.stream_id
        if isinstance(stream.spec, TopicSpec):
            topic = self._topics.get(stream_id)
            return topic.hear(self._address) if topic is not None and job == FORWARD else []
        ends = self._actions.get(stream_id) or (
            self._services[stream_id].ends if stream_id in self._services else None
        )
        if ends is None:
            return []
        return ends.offer() if job == PROXY else ends.use()

    def stands_back(self, stream: Stream) -> bool:
        """Return whether a local program serves it, or the node that serves it is lost."""
        if stream.stream_id in self._services:
            ends = self._services[stream.stream_id].ends
        elif stream.stream_id in self._actions:
            ends = self._actions[stream.stream_id].ends[ActionKey.SEND_GOAL]
        else:
            return False
        assert isinstance(stream.spec, ServiceSpec | ActionSpec)
        return stream.spec.server in self._lost or self._graph.serves(ends.key)

    def note_peer(self, address: int, *, is_lost: bool) -> bool:
        """Note that a node was lost or is back: clients must not wait for lost servers."""
        (self._lost.add if is_lost else self._lost.discard)(address)
        return bool(self._services or self._actions)

    def visible(self, stream: Stream) -> bool:
        """Return whether programs can see the client of calls from the channel."""
        return stream.stream_id in self._services

    def settle(self) -> bool:
        """Process observations of the local network; return whether jobs may have changed."""
        return self._graph.take()

    def undeclare(self) -> None:
        """Become invisible; in the worker."""
        self._graph.undeclare()
