"""Endpoints on a Zenoh session: the local gateway carries their values across the channel.

Zenoh's callbacks run in its own threads and only hand data over. On the loop, a put on a full
connection is dropped. Replies, gets and closing may block on a full connection, so the worker of
the `ZenohSession` does them.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import zenoh

from zacoustic.config import Config
from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.linktypes import LinkMetrics, LinkState
from zacoustic.core.base.qos import Durability
from zacoustic.core.base.stats import NO_STREAM, EngineStats, LedgerEntry, count
from zacoustic.core.engine.events import LinkStateChanged
from zacoustic.core.peers.measurements import Range
from zacoustic.core.streams.specs import StreamSpec
from zacoustic.core.streams.table import Stream
from zacoustic.errors import (
    LinkClosedError,
    LocalError,
    PayloadInvalidError,
    RangeUnavailableError,
    SessionError,
)
from zacoustic.run.inbox import crossing, tell_loop
from zacoustic.text import safetext
from zacoustic.zenoh.ends.calls import TakeCall
from zacoustic.zenoh.ends.zenohcalls import ZenohCallers, ZenohServer
from zacoustic.zenoh.node.calls import CLOSED_TEXT, SentCall
from zacoustic.zenoh.node.carrier import A, Incoming, NodeEvent, Outlet, Q
from zacoustic.zenoh.node.onzenoh.calls import CALLS_LIMIT, ProgramCalls
from zacoustic.zenoh.node.onzenoh.goals import ZenohGoals
from zacoustic.zenoh.node.onzenoh.queries import serve_queries
from zacoustic.zenoh.node.onzenoh.session import session_config, zenoh_errors
from zacoustic.zenoh.node.routes import ServiceRoute, TopicRoute
from zacoustic.zenoh.node.waiters import Waiters
from zacoustic.zenoh.requests.asking import ask
from zacoustic.zenoh.requests.request import Request
from zacoustic.zenoh.session.latching import LatchedPublisher, latched_subscriber
from zacoustic.zenoh.session.marker import read_marker
from zacoustic.zenoh.session.session import WORDS, ZenohSession, zenoh_priority
from zacoustic.zenoh.session.values import said_encoding

_logger = logging.getLogger(__name__)


class ZenohCarrier:
    """A Zenoh session.

    Args:
        config: The node's configuration, or None.
        connect: Endpoints of the router; None: the configuration's.
        report: Receives events; here only the state of the connection.
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
        self._open_session: ZenohSession | None = None
        self._is_up: bool | None = None
        self._ends: dict[object, Callable[[], None]] = {}
        self._waiters = Waiters()
        self._goals = ZenohGoals(lambda: self.zenoh_session, self._keep)
        self.sent_goals = self._goals.sent
        self.serve_goals = self._goals.serve

    @property
    def stats(self) -> EngineStats:
        """The counters: samples and drops; the gateway counts frames."""
        return self._stats

    @property
    def zenoh_session(self) -> ZenohSession:
        """The session and its worker.

        Raises:
            SessionError: The session is not open.
        """
        if self._open_session is None:
            raise SessionError("the Zenoh session is closed")
        return self._open_session

    def expired(self) -> dict[int, int]:
        """Return nothing: samples wait in the gateway."""
        return {}

    def ledger(self) -> list[LedgerEntry]:
        """Return nothing: the gateway has the link."""
        return []

    def declare(self, spec: StreamSpec) -> Stream:
        """Refuse: the gateway has the streams."""
        raise LocalError(f"{spec.name}: streams are declared by the gateway of the local network")

    async def open(self) -> None:
        """Open the session.

        Raises:
            SessionError: No router can be reached.
        """
        zenoh_session = await ZenohSession.open(session_config(self._config, self._connect))
        self._open_session = zenoh_session
        loop = asyncio.get_running_loop()
        zenoh_session.watch(lambda is_up: tell_loop(loop, partial(self._report_connection, is_up)))

    async def close(self) -> None:
        """Close the session and inform the callers of open calls. May be called again."""
        if self._open_session is None:
            return
        self._goals.close()
        for end in tuple(self._ends.values()):
            end()
        zenoh_session, self._open_session = self._open_session, None
        self._waiters.end_all(LinkClosedError("the node was closed"))
        await zenoh_session.close()  # after the replies that wait there

    async def flush(self) -> None:
        """Do nothing: a put is under way when it returns, and closing waits for it."""

    async def range(self, address: int, timeout_s: float) -> Range:
        """Refuse: the gateway has the modem."""
        raise RangeUnavailableError(
            f"range to node {address}: the modem is the gateway's",
            hint=f"say ranging: [ {{ to: {address}, every_s: 30 }} ] in its file, and get "
            f"@acoustic/*/peer/{address}/range",
        )

    async def ask(self, request: Request[Q, A], node: int, question: Q, within_s: float) -> A:
        """Ask the local gateways, which answer for themselves or ask the node."""
        with zenoh_errors(request.subject):
            return (await ask(self.zenoh_session, request, node, question, within_s))[0]

    def refuse(self, source: int, transfer: int) -> bool:
        """Refuse nothing: samples arrive whole."""
        return False

    def advertise(self, route: TopicRoute[Any]) -> Outlet:
        """Declare a Zenoh publisher; for a latched topic, one that keeps its last samples."""
        with zenoh_errors(route.name):
            if route.qos.durability is Durability.TRANSIENT_LOCAL:
                latched = LatchedPublisher(
                    self.zenoh_session, route.expression, route.qos.depth, route.qos.priority
                )
                latched.declare()
                publisher: LatchedPublisher | zenoh.Publisher = latched
            else:
                publisher = self.zenoh_session.session.declare_publisher(
                    route.expression,
                    encoding=route.encoding,
                    priority=zenoh_priority(route.qos.priority),
                    congestion_control=zenoh.CongestionControl.DROP,
                    allowed_destination=zenoh.Locality.REMOTE,
                )
        return Outlet(partial(self._put, route, publisher), self._keep(publisher.undeclare))

    def subscribe(
        self, route: TopicRoute[Any], deliver: Callable[[Incoming], None]
    ) -> Callable[[], None]:
        """Declare a Zenoh subscriber; for a latched topic, one that also gets earlier samples."""
        put = crossing(partial(self._receive, route, deliver))

        zenoh_session, qos = self.zenoh_session, route.qos
        with zenoh_errors(route.name):
            if qos.durability is Durability.TRANSIENT_LOCAL:
                latched = latched_subscriber(zenoh_session, route.expression, put, qos.depth)
                return self._keep(latched.undeclare)
            subscriber = zenoh_session.session.declare_subscriber(
                zenoh.KeyExpr(route.expression),
                zenoh_session.callback(put),
                allowed_origin=zenoh.Locality.REMOTE,
            )
        return self._keep(subscriber.undeclare)

    async def call(
        self, route: ServiceRoute[Any, Any], value: object, timeout_s: float | None
    ) -> object:
        """Send a Zenoh `get` and wait for the first reply; cancelling gives up."""
        server = ZenohServer(
            self.zenoh_session,
            ProgramCalls(route),
            priority=route.qos.priority,
            complain=partial(_complain, route.name),
            nobody_text="nobody serves it on this Zenoh network",
        )
        sent, limit_s = SentCall(route.name), timeout_s or route.timeout_s
        return await self._waiters.wait(sent.over, server.give(value, sent, limit_s=limit_s))

    def serve(self, route: ServiceRoute[Any, Any], take: TakeCall) -> Callable[[], None]:
        """Declare a Zenoh queryable."""
        callers = ZenohCallers(
            ProgramCalls(route),
            take,
            timeout_s=route.timeout_s,
            clock=time.monotonic_ns,
            takes_marked=True,
            complain=partial(_complain, route.name),
        )
        return self._keep(
            serve_queries(
                self.zenoh_session,
                route.name,
                serve=callers.take,
                limit=CALLS_LIMIT,
                closed_text=CLOSED_TEXT,
            )
        )

    # Below the methods above

    def _keep(self, end: Callable[[], None]) -> Callable[[], None]:
        """Remember how to end a declaration; return a function that ends it once."""
        token = object()

        def end_once() -> None:
            if self._ends.pop(token, None) is not None:
                end()

        self._ends[token] = end_once
        return end_once

    def _put(
        self,
        route: TopicRoute[Any],
        publisher: LatchedPublisher | zenoh.Publisher,
        value: object,
        encoding: str | None,
        delete: bool,
    ) -> None:
        """Put a sample, or a delete; only the gateway knows the outcome."""
        said = encoding or route.encoding
        payload = b"" if delete else route.form.write(value, said)
        with zenoh_errors(route.name):
            if delete:
                publisher.delete()
            elif isinstance(publisher, LatchedPublisher):
                expires_at = None
                if route.qos.lifespan_s is not None:
                    expires_at = time.monotonic_ns() + seconds_to_ns(route.qos.lifespan_s)
                publisher.put(payload, encoding=said, expires_at=expires_at)
            else:
                publisher.put(payload, encoding=said)
        count(self._stats.published, route.stream.stream_id if route.stream else NO_STREAM)

    def _receive(
        self, route: TopicRoute[Any], deliver: Callable[[Incoming], None], sample: zenoh.Sample
    ) -> None:
        key, stream = str(sample.key_expr), route.stream
        if route.key is None and stream is not None and not self._is_key(stream, key):
            return
        is_delete = sample.kind == zenoh.SampleKind.DELETE
        encoding = said_encoding(sample.encoding, route.encoding)
        try:
            payload = sample.payload.to_bytes()
            value = None if is_delete else route.form.read(payload, encoding)
        except PayloadInvalidError as error:
            self._stats.drop("payload")
            _logger.warning("%s: a sample was dropped: %s", safetext.one_line(key), error)
            return
        count(self._stats.received, stream.stream_id if stream else NO_STREAM)
        marker = read_marker(sample.attachment)
        deliver(
            Incoming(
                key=key,
                value=value,
                source=marker.acoustic if marker else None,
                deleted=is_delete,
                encoding=encoding,
                age_s=marker.age_s if marker else None,
                age_error_s=marker.age_error_s if marker else None,
                received_at=time.monotonic_ns(),
                metrics=LinkMetrics(),
            )
        )

    def _is_key(self, stream: Stream, key: str) -> bool:
        """Return whether a key is one of the stream's; its Zenoh expression may cover more."""
        nodes = self._config.nodes if self._config is not None else {}
        return any(stream.keys.match(key, address) is not None for address in nodes or (0,))

    def _report_connection(self, is_up: bool) -> None:
        state = LinkState.UP if is_up else LinkState.DOWN
        if self._open_session is not None and self._is_up != is_up:
            if self._is_up is not None:
                _logger.warning("%s", WORDS[is_up])
            self._is_up = is_up
        self._report(LinkStateChanged(state=state, changed_at=time.monotonic_ns()))


def _complain(name: str, word: str, text: str) -> None:
    _logger.warning("%s: %s: %s", name, word, text)
