"""Endpoints on a Zenoh session: the gateway of the island carries them across the water.

Zenoh's callbacks run in its own threads and do nothing but fill a `Crossing`. From the loop, puts
are dropped on a full connection; replies, gets and closing, which may block on one, are for a
worker thread.
"""

import asyncio
import contextlib
import functools
import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final

import zenoh

from zacoustic.config import Config
from zacoustic.core.events import CallFailure, LinkStateChanged
from zacoustic.core.linktypes import LinkMetrics, LinkState
from zacoustic.core.stats import NO_STREAM, EngineStats, LedgerEntry, count
from zacoustic.core.streams import Stream, StreamSpec
from zacoustic.errors import (
    CallTimeoutError,
    LinkClosedError,
    LocalError,
    PayloadInvalidError,
    SessionError,
)
from zacoustic.node.carrier import Incoming, IncomingCall, NodeEvent, Outlet, call_error
from zacoustic.node.crossing import Crossing
from zacoustic.node.exitguard import ExitGuard
from zacoustic.node.island import (
    decode_value,
    encode_value,
    read_marker,
    said_encoding,
    zenoh_errors,
    zenoh_priority,
)
from zacoustic.node.queries import FirstReply, QueryDesk
from zacoustic.node.routes import ServiceRoute, TopicRoute
from zacoustic.node.session import close_session, open_session

# Zenoh's own time limit stands behind ours, which says more.
_BEHIND_S: Final = 1.0

_logger = logging.getLogger(__name__)


class ZenohCarrier:
    """A Zenoh session.

    Args:
        config: The node's configuration, or None.
        connect: Endpoints of the router; None: those of the configuration.
        report: Takes events; here only that the connection comes and goes.
    """

    can_declare = False

    def __init__(
        self,
        config: Config | None,
        connect: str | Sequence[str] | None,
        *,
        report: Callable[[NodeEvent], None],
    ) -> None:
        self._config = config
        self._connect = connect
        self._report = report
        self._stats = EngineStats()
        self._transports = 0
        self._session: zenoh.Session | None = None
        self._guard: ExitGuard | None = None
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="zenoh")
        self._ends: dict[object, Callable[[], None]] = {}
        self._calls: set[asyncio.Future[object]] = set()

    @property
    def stats(self) -> EngineStats:
        """What was counted: samples and drops; frames are the gateway's."""
        return self._stats

    @property
    def session(self) -> zenoh.Session:
        """The session.

        Raises:
            SessionError: It is not open.
        """
        if self._session is None:
            raise SessionError("the Zenoh session is closed")
        return self._session

    def ledger(self) -> list[LedgerEntry]:
        """Return nothing: the link is the gateway's."""
        return []

    def declare(self, spec: StreamSpec) -> Stream:
        """Refuse: streams are the gateway's."""
        raise LocalError(f"{spec.name}: streams are declared by the gateway of the island")

    async def open(self) -> None:
        """Open the session.

        Raises:
            SessionError: No router is reached.
        """
        try:
            session = await open_session(self._config, self._connect)
        except BaseException:
            self._worker.shutdown(wait=False)
            raise
        self._session = session
        self._guard = ExitGuard(functools.partial(close_session, session))
        self._guard.start()
        events: Crossing[bool] = Crossing(self._count_transport)

        def bring(event: zenoh.TransportEvent) -> None:
            events.put(event.kind == zenoh.SampleKind.PUT)

        session.info.declare_transport_events_listener(zenoh.handlers.Callback(bring), history=True)

    async def close(self) -> None:
        """Close the session; callers whose calls are under way are told. May be called again."""
        if self._session is None:
            return
        for end in tuple(self._ends.values()):
            end()
        session, self._session = self._session, None
        for answer in tuple(self._calls):
            if not answer.done():
                answer.set_exception(LinkClosedError("the node was closed"))
        loop = asyncio.get_running_loop()
        # Behind the replies that wait there.
        await loop.run_in_executor(self._worker, close_session, session)
        if self._guard is not None:
            await loop.run_in_executor(self._worker, self._guard.dismiss)
        self._worker.shutdown()

    async def flush(self) -> None:
        """Do nothing: a put is on its way when it returns, and closing waits for it."""

    def advertise(self, route: TopicRoute[Any]) -> Outlet:
        """Declare a Zenoh publisher."""
        with zenoh_errors(route.name):
            publisher = self.session.declare_publisher(
                route.expression,
                encoding=route.encoding,
                priority=zenoh_priority(route.qos.priority),
                congestion_control=zenoh.CongestionControl.DROP,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        return _ZenohOutlet(route, publisher, self._stats, self._keep(publisher.undeclare))

    def subscribe(
        self, route: TopicRoute[Any], deliver: Callable[[Incoming], None]
    ) -> Callable[[], None]:
        """Declare a Zenoh subscriber."""
        crossing: Crossing[zenoh.Sample] = Crossing(
            lambda sample: self._receive(sample, route, deliver)
        )

        def bring(sample: zenoh.Sample) -> None:
            crossing.put(sample)

        with zenoh_errors(route.name):
            subscriber = self.session.declare_subscriber(
                route.expression,
                zenoh.handlers.Callback(bring),
                allowed_origin=zenoh.Locality.REMOTE,
            )
        return self._keep(subscriber.undeclare)

    async def call(
        self, route: ServiceRoute[Any, Any], value: object, timeout_s: float | None
    ) -> object:
        """Ask by a Zenoh `get` and wait for the first reply."""
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[object] = loop.create_future()
        limit_s = route.timeout_s if timeout_s is None else timeout_s
        cancellation = zenoh.CancellationToken()
        ask = self._asking(
            route, FirstReply(route, answer), value, limit_s=limit_s, cancellation=cancellation
        )
        self._calls.add(answer)
        try:
            async with asyncio.timeout(limit_s):
                with zenoh_errors(route.name):
                    await loop.run_in_executor(self._worker, ask)
                return await answer
        except CallTimeoutError:
            raise
        except TimeoutError:
            text = f"no answer within {limit_s:g} s"
            raise call_error(route.name, CallFailure.TIMED_OUT, text) from None
        finally:
            self._calls.discard(answer)
            answer.cancel()
            self._submit(cancellation.cancel)

    def serve(
        self, route: ServiceRoute[Any, Any], handle: Callable[[IncomingCall], None]
    ) -> Callable[[], None]:
        """Declare a Zenoh queryable."""
        desk = QueryDesk(route, handle, self._submit)
        with zenoh_errors(route.name):
            queryable = self.session.declare_queryable(
                route.name,
                zenoh.handlers.Callback(desk.bring),
                complete=True,
                allowed_origin=zenoh.Locality.REMOTE,
            )

        def end() -> None:
            queryable.undeclare()  # type: ignore[no-untyped-call]
            desk.close()

        return self._keep(end)

    # Below the methods above

    def _asking(
        self,
        route: ServiceRoute[Any, Any],
        reply: FirstReply,
        value: object,
        *,
        limit_s: float,
        cancellation: zenoh.CancellationToken,
    ) -> Callable[[], None]:
        """Make what asks, for the worker.

        Raises:
            PayloadInvalidError: The type does not allow the value.
        """
        session = self.session
        payload = encode_value(value, route.request.spec, route.encoding)

        def ask() -> None:
            session.get(
                route.name,
                zenoh.handlers.Callback(reply.take, reply.end),
                payload=payload,
                encoding=route.encoding,
                timeout=limit_s + _BEHIND_S,
                # The first reply at once: by default the newest of all is delivered at the end.
                consolidation=zenoh.ConsolidationMode.NONE,
                priority=zenoh_priority(route.qos.priority),
                congestion_control=zenoh.CongestionControl.DROP,
                allowed_destination=zenoh.Locality.REMOTE,
                cancellation_token=cancellation,
            )

        return ask

    def _keep(self, end: Callable[[], None]) -> Callable[[], None]:
        """Remember how to end a declaration; returns what ends it, once."""
        token = object()

        def end_once() -> None:
            if self._ends.pop(token, None) is not None:
                end()

        self._ends[token] = end_once
        return end_once

    def _submit(self, step: Callable[[], object]) -> None:
        with contextlib.suppress(RuntimeError):  # the worker has ended, and the session with it
            self._worker.submit(step)

    def _receive(
        self, sample: zenoh.Sample, route: TopicRoute[Any], deliver: Callable[[Incoming], None]
    ) -> None:
        key, stream = str(sample.key_expr), route.stream
        if route.key is None and stream is not None and not self._is_key(stream, key):
            return
        is_delete = sample.kind == zenoh.SampleKind.DELETE
        encoding = said_encoding(sample.encoding, route.encoding)
        try:
            payload = sample.payload.to_bytes()
            value = None if is_delete else decode_value(payload, route.form.spec, encoding)
        except PayloadInvalidError as error:
            self._stats.drop("payload")
            _logger.warning("%s: a sample was dropped: %s", key, error)
            return
        count(self._stats.received, stream.stream_id if stream else NO_STREAM)
        marker = read_marker(sample.attachment)
        deliver(
            Incoming(
                key=key,
                value=value,
                source=marker.acoustic,
                deleted=is_delete,
                encoding=encoding,
                age_s=marker.age_s,
                received_at=time.monotonic_ns(),
                metrics=LinkMetrics(),
            )
        )

    def _is_key(self, stream: Stream, key: str) -> bool:
        """Whether the key is one of the stream's: its Zenoh expression may cover more."""
        nodes = self._config.nodes if self._config is not None else {}
        return any(stream.keys.match(key, address) is not None for address in nodes or (0,))

    def _count_transport(self, is_up: bool) -> None:
        before, self._transports = self._transports, self._transports + (1 if is_up else -1)
        if bool(before) != bool(self._transports):
            state = LinkState.UP if self._transports else LinkState.DOWN
            self._report(LinkStateChanged(state=state, changed_at=time.monotonic_ns()))


class _ZenohOutlet:
    """Where one publisher puts its samples."""

    def __init__(
        self,
        route: TopicRoute[Any],
        publisher: zenoh.Publisher,
        stats: EngineStats,
        close: Callable[[], None],
    ) -> None:
        self._route = route
        self._publisher = publisher
        self._stats = stats
        self._close = close

    def put(self, value: object, encoding: str | None) -> None:
        said = encoding or self._route.encoding
        payload = encode_value(value, self._route.form.spec, said)
        with zenoh_errors(self._route.name):
            self._publisher.put(payload, encoding=said)
        self._count()

    def delete(self) -> None:
        with zenoh_errors(self._route.name):
            self._publisher.delete()
        self._count()

    def close(self) -> None:
        self._close()

    def _count(self) -> None:
        stream = self._route.stream
        count(self._stats.published, stream.stream_id if stream else NO_STREAM)
