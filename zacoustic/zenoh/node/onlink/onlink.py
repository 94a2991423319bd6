"""Endpoints on a link: a node with its own engine, and no Zenoh anywhere."""

import asyncio
import contextlib
import logging
import random
import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.qos import Reliability
from zacoustic.core.base.stats import NO_STREAM, EngineStats, LedgerEntry
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    CallFailure,
    DeliveryEnded,
    DeliveryStored,
    Event,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
    StreamsDiffer,
)
from zacoustic.core.peers.measurements import Range
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import StreamSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.transport.actions.news import ActionEvent
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.errors import LinkClosedError, LocalError, QueueFullError
from zacoustic.link.contract import Link
from zacoustic.run.hostclock import HostClock
from zacoustic.run.journal import Journal, JournalState
from zacoustic.run.permitlog import PermitLog
from zacoustic.run.replacement.intact import Intact
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.node.carrier import (
    Incoming,
    IncomingCall,
    NodeEvent,
    Outlet,
    call_error,
    range_error,
)
from zacoustic.zenoh.node.delivery import Deliveries, Delivery
from zacoustic.zenoh.node.onlink.ends import LinkCall, LinkOutlet
from zacoustic.zenoh.node.onlink.goals import LinkGoals
from zacoustic.zenoh.node.onlink.listeners import Listeners
from zacoustic.zenoh.node.onlink.orders import LinkOrders
from zacoustic.zenoh.node.routes import ServiceRoute, TopicRoute

if TYPE_CHECKING:
    from zacoustic.run.recording.live import LiveRecording

CLOSE_LINGER_S: Final = 5.0
"""A node that is closed says what it has to acknowledge, for so long at most, s: on usual links the
answer's turn and its airtime. Where nothing is owed, or nothing can be said, it closes at once."""

_logger = logging.getLogger(__name__)


class LinkCarrier:
    """An engine on a link.

    Args:
        link: The link, not open yet.
        address: Address of the node.
        table: Its streams.
        journal: Keeps what must survive a restart; None: none.
        state: What the journal has kept.
        ranges: Nodes whose range is measured periodically, each with its period, s.
        rules: When, and how much, the node may transmit.
        permit_log: Takes each emission, or None; closed with the carrier.
        recording: Makes the engine and records it, or None; closed with the carrier.
        report: Takes the events that concern no stream of the application.
        fail: Takes the error that has stopped the engine.
    """

    can_declare = True

    def __init__(
        self,
        link: Link,
        address: int,
        table: StreamTable,
        *,
        journal: Journal | None,
        state: JournalState,
        ranges: Mapping[int, float],
        rules: TransmitRules,
        permit_log: PermitLog | None,
        recording: "LiveRecording | None" = None,
        report: Callable[[NodeEvent], None],
        fail: Callable[[Exception], None],
    ) -> None:
        self._table = table
        self._report = report
        self._fail = fail
        self._recording = recording
        host, make = HostClock(), Engine if recording is None else recording.make

        def renew(epoch: int, stored: Mapping[str, bytes]) -> Engine:
            return make(
                address=address,
                table=table,
                epoch=epoch,
                rng=random.Random(random.SystemRandom().getrandbits(64)),
                stored=host.named(stored),
                rules=rules,
                trace=None,
            )

        self._runner = LinkRunner(
            Intact(renew, state.boot_epoch, state.entries),
            link,
            self._deliver,
            renew=renew,
            journal=journal,
            wall_clock=host.utc_ns,
            clock_error_s=rules.clock_error_s,
            ask_clock=host.ask,
            permit_log=permit_log,
        )
        self._thread = threading.get_ident()
        self._settled = asyncio.Event()
        self._runner.settled = self._settled.set
        self._watch: asyncio.Task[None] | None = None
        self._listeners = Listeners(self._runner, table)
        self._servers: dict[int, Callable[[IncomingCall], None]] = {}
        self._calls: dict[int, asyncio.Future[object]] = {}
        self._ranges: dict[int, asyncio.Future[Range]] = {}
        self._deliveries = Deliveries()
        self._schedule = ranges
        self.goals = LinkGoals(self._runner, table)
        self._orders = LinkOrders(self._runner)
        self.order = self._orders.give

    @property
    def stats(self) -> EngineStats:
        """What the engine has counted."""
        return self._runner.engine.stats

    def ledger(self) -> list[LedgerEntry]:
        """Bytes given to the link, by stream and cause."""
        return self._runner.engine.stats.ledger()

    def expired(self) -> dict[int, int]:
        """Samples and calls that became too old before they could be sent, by stream id."""
        return self._runner.engine.expired

    def declare(self, spec: StreamSpec) -> Stream:
        """Add a stream; peers learn of it as of a restart."""
        return self._runner.apply(lambda engine, now: engine.declare(spec, now))

    async def open(self) -> None:
        """Open the link and run the engine.

        Raises:
            LinkOpenError: The link cannot be opened.
            RangeUnavailableError: The config measures ranges, and the link cannot.
        """
        try:
            await self._runner.start()
            for address, every_s in self._schedule.items():
                self._runner.apply(partial(_repeat, address, every_s))
        except BaseException:
            await self._runner.close()
            await self._close_recording()
            raise
        self._watch = asyncio.create_task(self._wait_failed(), name="engine of the node")

    async def close(self) -> None:
        """Send the owed acknowledgements, then stop; calls under way fail.

        May be called again.
        """
        try:
            await self._linger()
        finally:
            await self._stop()

    async def _stop(self) -> None:
        await self._runner.close()
        if self._watch is not None:
            await asyncio.wait([self._watch])
        await self._close_recording()
        self._settled.set()
        self._end_all(LinkClosedError("the node was closed"))

    async def range(self, address: int, timeout_s: float) -> Range:
        """Measure the range of another node; cancelling gives it up."""
        answer: asyncio.Future[Range] = asyncio.get_running_loop().create_future()

        def begin(engine: Engine, now: int) -> int:
            range_id = engine.ranging.request(address, now, timeout_s=timeout_s)
            self._ranges[range_id] = answer  # before the events of the engine are polled
            return range_id

        range_id = self._runner.apply(begin)
        try:
            return await answer
        finally:
            if self._ranges.pop(range_id, None) is not None:
                with contextlib.suppress(LinkClosedError):
                    self._runner.apply(lambda engine, now: engine.ranging.cancel(range_id))

    async def flush(self) -> None:
        """Wait until nothing is queued and no transmission is under way.

        What waits may also expire, be cancelled or be pushed out: each ends in an input of the
        engine, but expiry of what is best effort, for which an engine sets no timer.
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

    def advertise(self, route: TopicRoute[Any]) -> Outlet:
        """Make the way out of a publisher."""
        return LinkOutlet(self, route)

    def subscribe(
        self, route: TopicRoute[Any], deliver: Callable[[Incoming], None]
    ) -> Callable[[], None]:
        """Deliver the samples of a topic, or of one key of it."""
        return self._listeners.add(route, deliver)

    async def call(
        self, route: ServiceRoute[Any, Any], value: object, timeout_s: float | None
    ) -> object:
        """Call a service and wait for the answer; cancelling gives the call up."""
        assert route.stream is not None
        stream_id = route.stream.stream_id
        answer: asyncio.Future[object] = asyncio.get_running_loop().create_future()

        def begin(engine: Engine, now: int) -> int:
            call_id = engine.call(stream_id, value, now, timeout_s=timeout_s)
            self._calls[call_id] = answer  # before the events of the engine are polled
            return call_id

        call_id = self._runner.apply(begin)
        try:
            return await answer
        finally:
            if self._calls.pop(call_id, None) is not None:
                with contextlib.suppress(LinkClosedError):
                    self._runner.apply(lambda engine, now: engine.cancel(call_id, now))

    def serve(
        self, route: ServiceRoute[Any, Any], handle: Callable[[IncomingCall], None]
    ) -> Callable[[], None]:
        """Hand over the requests of a service.

        Raises:
            LocalError: It is served already.
        """
        assert route.stream is not None
        stream_id = route.stream.stream_id
        if stream_id in self._servers:
            raise LocalError(f"{route.name} is served by this node already")
        self._servers[stream_id] = handle

        def stop() -> None:
            if self._servers.get(stream_id) is handle:
                del self._servers[stream_id]

        return stop

    # For outlets and calls

    def publish(
        self, route: TopicRoute[Any], value: object, *, encoding: str | None, delete: bool
    ) -> Delivery | None:
        """Queue a sample, from any thread."""
        stream, instance = route.stream, route.instance
        assert stream is not None
        made_at = time.monotonic_ns()
        delivery: Delivery | None = None
        if stream.qos.reliability is Reliability.RELIABLE:
            delivery = Delivery(
                route.key or route.name, is_journalled=stream.spec.journal, cancel=self._cancel
            )

        def put(engine: Engine, now: int) -> None:
            try:
                delivery_id = engine.publish(
                    stream.stream_id,
                    value,
                    now,
                    instance=instance,
                    encoding=encoding,
                    delete=delete,
                    queued_at=made_at,
                )
            except LocalError as error:
                if delivery is not None:
                    delivery.fail(error)
                raise
            if delivery is not None:  # before the events of the engine are polled
                self._deliveries.add(delivery_id, delivery)

        if not delete and threading.get_ident() != self._thread:
            stream.codec.encode(value)  # raises here what the loop could only log
        self._command(put, route.name)
        return delivery

    def _cancel(self, delivery: Delivery) -> None:
        """Give a sample up, from any thread."""

        def cancel(engine: Engine, now: int) -> None:
            delivery_id = self._deliveries.id_of(delivery)
            if delivery_id is not None:
                engine.cancel_delivery(delivery_id, now)

        self._command(cancel, delivery.key)

    def refuse(self, source: int, transfer: int) -> bool:
        """Refuse the rest of a large sample that is on its way to here."""
        return self._runner.apply(lambda engine, now: engine.refuse_object(source, transfer, now))

    def _command(self, command: Callable[[Engine, int], None], name: str) -> None:
        """Have the engine do something, from any thread; what it raises is raised on the loop."""
        if threading.get_ident() == self._thread:
            self._runner.apply(command)
        elif not self._runner.submit(command):
            raise QueueFullError(f"{name}: the loop of the node is far behind, or has ended")

    def reply(self, request: RequestReceived, value: object) -> bool:
        """Answer a request."""
        return self._runner.apply(lambda engine, now: engine.reply(request.call, value, now))

    def reply_error(self, request: RequestReceived, failure: CallFailure, text: str) -> bool:
        """Answer a request with an error."""
        try:
            return self._runner.apply(
                lambda engine, now: engine.reply_error(request.call, failure, text, now)
            )
        except LinkClosedError:
            return False

    # Events of the engine

    def _deliver(self, event: Event) -> None:
        if isinstance(event, ActionEvent):
            self.goals.deliver(event)
            return
        if self._orders.deliver(event):
            return
        match event:
            case SampleReceived():
                self._listeners.deliver(event)
            case RequestReceived():
                self._deliver_request(event)
            case ResponseReceived():
                self._answer(event.call_id, event.value)
            case CallFailed():
                name = self._table.by_id(event.stream_id).name
                self._answer(event.call_id, call_error(name, event.failure, event.text))
            case StreamsDiffer():
                stream = self._table.get(event.stream_id)
                _logger.warning(
                    "node %d and node %d define stream %d (%s) in different ways: "
                    "nothing of it passes between them",
                    self._runner.engine.address, event.address, event.stream_id,
                    stream.name if stream else "only there",
                )  # fmt: skip
                self._report(event)
            case DeliveryStored():
                self._deliveries.stored(event)
            case DeliveryEnded():
                if not self._deliveries.ended(event):  # of a former boot epoch
                    self._report(event)
            case RangeMeasured():
                found = self._ranges.pop(event.range_id, None)
                if found is not None and not found.done():
                    found.set_result(event.range)
            case RangeFailed():
                self._fail_range(event)
            case ObjectProgress():
                self._deliveries.progressed(event)
                self._report(event)
            case _ if isinstance(event, NodeEvent):
                self._report(event)

    def _deliver_request(self, event: RequestReceived) -> None:
        call = LinkCall(self, event)
        handle = self._servers.get(event.call.stream_id)
        if handle is None:
            name = self._table.by_id(event.call.stream_id).name
            call.fail(CallFailure.NO_SERVER, f"no program serves {name}")
        else:
            handle(call)

    def _answer(self, call_id: int, outcome: object) -> None:
        answer = self._calls.pop(call_id, None)
        if answer is None or answer.done():
            return
        if isinstance(outcome, Exception):
            answer.set_exception(outcome)
        else:
            answer.set_result(outcome)

    def _fail_range(self, event: RangeFailed) -> None:
        error = range_error(event)
        if event.range_id is None:
            node = self._runner.engine.address
            _logger.warning("node %d: ranging is not possible: %s", node, error)
            return
        answer = self._ranges.pop(event.range_id, None)
        if answer is not None and not answer.done():
            answer.set_exception(error)

    async def _close_recording(self) -> None:
        if self._recording is not None:
            recording, self._recording = self._recording, None
            await recording.close()

    async def _linger(self) -> None:
        """Wait until the acknowledgements that are owed have been on the air, if that is soon.

        The application has the samples, and nobody else can tell their publishers. Nothing more is
        heard meanwhile: it would be acknowledged, and there is nobody left to have it.
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
        # Beside the streams what they do not carry: subscriptions.
        lanes = (NO_STREAM, *(stream.stream_id for stream in self._table))
        waiting = any(self._runner.engine.pending(each) for each in lanes)
        return not waiting and stats.frames_transmitted == sum(stats.reports.values())

    async def _wait_failed(self) -> None:
        try:
            await self._runner.wait_failed()
        except Exception as failure:
            error = LinkClosedError(f"the node has failed: {failure}")
            error.__cause__ = failure
            self._end_all(error)
            self._settled.set()
            self._fail(error)

    def _end_all(self, error: Exception) -> None:
        for call_id in tuple(self._calls):
            self._answer(call_id, error)
        for answer in self._ranges.values():
            if not answer.done():
                answer.set_exception(error)
        self._ranges.clear()
        self.goals.end_all(error)
        self._orders.end_all(error)
        self._deliveries.fail(error)


def _repeat(address: int, every_s: float, engine: Engine, now: int) -> None:
    engine.ranging.repeat(address, every_s, now)
