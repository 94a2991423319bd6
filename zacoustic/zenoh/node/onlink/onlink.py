"""Endpoints on a link: a node with its own engine and without Zenoh."""

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable
from functools import partial
from typing import Any, Final, get_args

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.stats import NO_STREAM, EngineStats, LedgerEntry
from zacoustic.core.engine.events import (
    CallFailed,
    CustodyChanged,
    DeliveryEnded,
    DeliveryStored,
    Event,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
    StreamsDiffer,
)
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.core.streams.specs import StreamSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.actions.events import ActionEvent
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.errors import LinkClosedError
from zacoustic.run.dispatching import Dispatcher
from zacoustic.run.node import PreparedNode
from zacoustic.run.pending import CallEnd, Pending
from zacoustic.zenoh.ends.calls import TakeCall
from zacoustic.zenoh.ends.enginecalls import EngineCalls
from zacoustic.zenoh.ends.enginegoals import EngineGoals
from zacoustic.zenoh.ends.goals import GoalHandler
from zacoustic.zenoh.node.calls import SentCall
from zacoustic.zenoh.node.carrier import NodeEvent, Outlet
from zacoustic.zenoh.node.goals import SentGoals
from zacoustic.zenoh.node.onlink.listeners import Listeners
from zacoustic.zenoh.node.onlink.publishing import LinkPublishing
from zacoustic.zenoh.node.onlink.requests import LinkRequests
from zacoustic.zenoh.node.routes import ActionRoute, ServiceRoute, TopicRoute
from zacoustic.zenoh.node.waiters import Waiters
from zacoustic.zenoh.requests.context import RequestContext

CLOSE_LINGER_S: Final = 5.0
"""Longest time for which a closing node still acknowledges samples, s: on usual links the answer's
turn and its airtime. A node that owes or can say nothing closes at once."""

_logger = logging.getLogger(__name__)


class LinkCarrier:
    """An engine on a link.

    Args:
        node: The node; closed with the carrier.
        report: Receives the events that concern no stream of the application.
        fail: Receives the error that has stopped the engine.
    """

    can_declare = True

    def __init__(
        self,
        node: PreparedNode,
        *,
        report: Callable[[NodeEvent], None],
        fail: Callable[[Exception], None],
    ) -> None:
        table = node.parts.table
        self._node = node
        self._table = table
        self._report = report
        self._fail = fail
        self._runner = node.make_runner()
        self._settled = asyncio.Event()
        self._watch: asyncio.Task[None] | None = None
        self._listeners = Listeners(self._runner, table)
        self._publishing = LinkPublishing(self._runner)
        self._context = RequestContext(
            self._runner, Pending(), clock=node.parts.clock, utc_ns=node.parts.host.utc_ns
        )
        self._waiters = Waiters()
        self._requests = LinkRequests(self._context, self._waiters)
        self.ask, self.range = self._requests.ask, self._requests.range
        self._calls = EngineCalls(self._runner, table, self._context.ends)
        self._goals = EngineGoals(
            self._runner,
            table,
            complain=lambda name, word, text: _logger.warning("%s: %s: %s", name, word, text),
            recover=lambda given: self.sent_goals.recover(given, given.name, given.tag),
        )
        self.sent_goals = SentGoals(
            lambda route, value, client, **more: self._goals.give(
                route.known_stream.stream_id, value, client, **more
            )
        )
        self.subscribe = self._listeners.add

    @property
    def stats(self) -> EngineStats:
        """The counters of the engine."""
        return self._runner.engine.stats

    def ledger(self) -> list[LedgerEntry]:
        """Return the bytes given to the link, by stream and cause."""
        return self._runner.engine.stats.ledger()

    def expired(self) -> dict[int, int]:
        """Return how many samples and calls expired before their transmission, by stream id."""
        return self._runner.engine.expired

    def declare(self, spec: StreamSpec) -> Stream:
        """Add a stream; peers learn of it as they learn of a restart."""
        return self._runner.apply(lambda engine, now: engine.declare(spec, now))

    def advertise(self, route: TopicRoute[Any]) -> Outlet:
        """Create the outlet of a publisher."""
        return Outlet(partial(self._publishing.publish, route), lambda: None)

    async def call(
        self, route: ServiceRoute[Any, Any], value: object, timeout_s: float | None
    ) -> object:
        """Call a service and wait for the answer; cancelling gives up."""
        sent, stream_id = SentCall(route.name), route.known_stream.stream_id
        cancel = self._calls.give(stream_id, value, sent, timeout_s=timeout_s)
        return await self._waiters.wait(sent.over, cancel)

    def serve(self, route: ServiceRoute[Any, Any], take: TakeCall) -> Callable[[], None]:
        """Pass on the calls of a service; return the function that ends it."""
        return self._calls.serve(route.known_stream.stream_id, take)

    def serve_goals(
        self, route: ActionRoute[Any, Any, Any], handler: GoalHandler
    ) -> Callable[[], None]:
        """Pass on the goals of an action; return the function that ends it."""
        return self._goals.serve(route.known_stream.stream_id, handler)

    def refuse(self, source: int, transfer: int) -> bool:
        """Refuse the rest of an incoming large sample."""
        return self._runner.apply(lambda engine, now: engine.refuse_object(source, transfer, now))

    async def open(self) -> None:
        """Open the link and run the engine.

        Raises:
            LinkOpenError: The link cannot be opened.
            RangeUnavailableError: The configuration measures ranges, and the link cannot.
        """
        try:
            await self._runner.start(self._dispatcher().deliver, self._settled.set)
            self._node.start_ranging(self._runner)
        except BaseException:
            await self._runner.close()
            await self._node.close()
            raise
        self._watch = asyncio.create_task(self._wait_failed(), name="engine of the node")

    async def close(self) -> None:
        """Send the owed acknowledgements, then stop and fail the calls under way.

        May be called again.
        """
        try:
            await self._linger()
        finally:
            await self._runner.close()
            if self._watch is not None:
                await asyncio.wait([self._watch])
            await self._node.close()
            self._settled.set()
            self._end_all(LinkClosedError("the node was closed"))

    async def flush(self) -> None:
        """Wait until nothing is queued and no transmission is under way.

        Waiting payloads may also expire, be cancelled or be replaced. Each of these comes with an
        input of the engine, except that best-effort payloads expire without a timer.
        """
        loop = asyncio.get_running_loop()
        while True:
            expires_at = self._runner.apply(lambda engine, now: engine.expire(now))
            if self._is_flushed():
                return
            self._settled.clear()
            if expires_at is None:
                await self._settled.wait()
                continue
            delay_s = ns_to_seconds(max(0, expires_at - time.monotonic_ns()))
            timer = loop.call_later(delay_s, self._settled.set)
            try:
                await self._settled.wait()
            finally:
                timer.cancel()

    # Events of the engine

    def _dispatcher(self) -> Dispatcher:
        """Return the takers of each type of event; programs do not need the others."""
        return Dispatcher(
            {
                **dict.fromkeys(get_args(Event), ()),
                **dict.fromkeys(get_args(NodeEvent), (self._report,)),
                **dict.fromkeys(get_args(ActionEvent), (self._goals.deliver,)),
                SampleReceived: (self._listeners.deliver,),
                RequestReceived: (self._calls.deliver,),
                ResponseReceived: (self._answer,),
                CallFailed: (self._answer,),
                StreamsDiffer: (self._see_difference,),
                DeliveryStored: (self._publishing.deliveries.stored,),
                DeliveryEnded: (self._end_delivery,),
                CustodyChanged: (self._see_custody,),
                ObjectProgress: (self._progress,),
                RangeMeasured: (self._requests.take_range,),
                RangeFailed: (self._requests.take_range,),
            }
        )

    def _answer(self, event: CallEnd) -> None:
        self._context.ends.take(event.call_id, event)

    def _see_difference(self, event: StreamsDiffer) -> None:
        stream = self._table.get(event.stream_id)
        _logger.warning(
            "node %d and node %d define stream %d (%s) in different ways: "
            "it is stopped between them",
            self._runner.engine.address, event.address, event.stream_id,
            stream.name if stream else "only there",
        )  # fmt: skip
        self._report(event)

    def _end_delivery(self, event: DeliveryEnded) -> None:
        if not self._publishing.deliveries.ended(event):  # of a former boot epoch
            self._report(event)

    def _see_custody(self, event: CustodyChanged) -> None:
        self._publishing.deliveries.carried(event)
        self._report(event)

    def _progress(self, event: ObjectProgress) -> None:
        self._publishing.deliveries.progressed(event)
        self._report(event)

    async def _linger(self) -> None:
        """Wait until the owed acknowledgements have been on the air, if that is soon.

        The application has the samples, and only this node can tell their publishers. The node
        receives nothing meanwhile: it would acknowledge samples that nobody is left to take.
        """
        if self._watch is None or self._watch.done():
            return
        self._runner.stop_hearing()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(CLOSE_LINGER_S):
                while self._runner.engine.owes_acknowledgement:
                    await self._settle()
                stats = self._runner.engine.stats
                frames = stats.frames_transmitted
                while sum(stats.reports.values()) < frames and not self._watch.done():
                    await self._settle()

    async def _settle(self) -> None:
        self._settled.clear()
        await self._settled.wait()

    def _is_flushed(self) -> bool:
        stats = self._runner.engine.stats
        # Subscriptions wait as well, under no stream.
        lanes = (NO_STREAM, *(stream.stream_id for stream in self._table))
        waiting = any(self._runner.engine.pending(each) for each in lanes)
        return not waiting and stats.frames_transmitted == sum(stats.reports.values())

    async def _wait_failed(self) -> None:
        try:
            await self._runner.wait_failed()
        except Exception as failure:  # any error that has stopped the runner
            error = LinkClosedError(f"the node has failed: {failure}")
            error.__cause__ = failure
            self._end_all(error)
            self._settled.set()
            self._fail(error)

    def _end_all(self, error: Exception) -> None:
        for each in (self._waiters, self.sent_goals):
            each.end_all(error)
        self._publishing.deliveries.fail(error)
