"""Commands about routes: runs of probes, what was heard of them, and other paths.

A service of its own, `ROUTING_STREAM_ID`, which every table has and every node serves; a node
executes it for those whose commands it executes. A command crosses one hop, so a request for a node
further away names the nodes between: each calls the next one in its own name, and passes the answer
on. So a node far away executes it if it executes the commands of its neighbour.
"""

from collections.abc import Callable
from functools import partial
from typing import Final, assert_never

import msgspec

from zacoustic.core.base.clock import NS_PER_S, ns_to_seconds
from zacoustic.core.relay.paths import Paths
from zacoustic.core.relay.prober import Prober
from zacoustic.core.schedule.context import NodeContext
from zacoustic.core.streams.routing import ROUTING_STREAM_ID, ROUTING_TIMEOUT_S
from zacoustic.core.transport.calls.calls import (
    CallEvent,
    CallFailed,
    RequestReceived,
    ResponseReceived,
)
from zacoustic.core.transport.calls.services import Services
from zacoustic.core.wire.calls import CallFailure, CallKey
from zacoustic.core.wire.routing import MOST_SOURCES, RoutingAnswer, RoutingKind, RoutingRequest
from zacoustic.errors import LocalError

_NS_PER_MS: Final = 1_000_000
_LONGEST: Final = 0xFFFF
HOP_S: Final = 120.0
"""Time that a node which passes a request on waits for the answer, for each hop ahead, s.

At 30 % loss request and answer take up to a dozen tries; in 60 s, enough for six of them, one
question in a hundred had no answer."""


class RoutingHandled(msgspec.Struct, frozen=True, kw_only=True):
    """A command about routes of another node was executed, or any was refused."""

    commanded_by: int
    """Address of the node that gave it to this one."""
    request: RoutingRequest | None
    """The request; None: it was refused unread."""
    refusal: str
    """The reason for the refusal, one line; empty: it was executed."""
    handled_at: int
    """Instant, ns."""


_CHANGES: Final = (RoutingKind.PROBE, RoutingKind.SET, RoutingKind.RESET)
"""The kinds that do something; the others only ask."""


class Routing:
    """Commands about routes that a node gives, executes and passes on.

    Args:
        node: The components that all links of the node share.
        services: Carry the calls; None: the wire carries none.
        executes: Addresses of the nodes whose commands it executes; None: all nodes of the table.
        prober: The probes of this node; None: it transmits none.
        paths: The paths of its routes.
    """

    def __init__(
        self,
        node: NodeContext,
        services: Services | None,
        executes: frozenset[int] | None,
        prober: Prober | None,
        paths: Paths,
    ) -> None:
        self._address = node.address
        self._table = node.table
        self._services = services
        self._executes = executes
        self._prober = prober
        self._paths = paths
        self._emit: Callable[[RoutingHandled], None] = node.emit
        self._alarms = node.alarms if node.seal is not None else None
        self._passed_on: dict[int, CallKey] = {}
        """The requests that are passed on, by the id of the call to the next node."""
        stream = node.table.get(ROUTING_STREAM_ID)
        self.is_carried = services is not None and stream is not None and stream.is_built_in
        """Whether the wire carries it, and the table has not given its id to another stream."""
        if services is not None and self.is_carried:
            services.serve_here(ROUTING_STREAM_ID, self._receive)
            services.take_ends(ROUTING_STREAM_ID, self._ended)

    def send(
        self,
        node: int,
        request: RoutingRequest,
        now: int,
        *,
        timeout_s: float = ROUTING_TIMEOUT_S,
    ) -> int:
        """Send a request to a node; return the call id of its answer.

        The answer is a `ResponseReceived`, which `RoutingAnswer.decode` reads, or a `CallFailed`:
        HANDLER with the reason when a node refuses it, or cannot reach the next one.

        Args:
            node: The node that executes it, 1…254.
            request: The request; `via` has the nodes between, in order.
            now: The instant.
            timeout_s: How long to try, s, at most 600.

        Raises:
            LocalError: No such node, or this one; or it `is_carried` not.
            QueueFullError: Too many requests to that node are under way.
        """
        way = (*request.via, node)
        if not 1 <= node <= 254 or self._address in way or len(set(way)) < len(way):
            raise LocalError(f"node {node}; allowed: 1..254, over others, each once")
        if not 0 < timeout_s <= ROUTING_TIMEOUT_S:
            raise LocalError(f"timeout_s is {timeout_s:g}; allowed: at most {ROUTING_TIMEOUT_S:g}")
        if self._services is None or not self.is_carried:
            raise LocalError(
                f"no commands about routes cross the channel: wire {self._table.wire.value} has "
                f"none, or the table gives their id, {ROUTING_STREAM_ID}, to another stream"
            )
        return self._call(way, request, now, timeout_s)

    def execute(
        self, request: RoutingRequest, now: int, then: Callable[[RoutingAnswer, int], None]
    ) -> None:
        """Execute a request at this node.

        Args:
            request: The request.
            now: The instant.
            then: Takes the answer and the instant, once what has changed is journalled.

        Raises:
            LocalError: It makes no sense here.
        """
        match request.kind:
            case RoutingKind.PROBE:
                then(self._probe(request, now), now)
            case RoutingKind.HEARD:
                heard = {} if self._prober is None else self._prober.heard(request.run)
                later = [pair for pair in heard.items() if pair[0] > request.after]
                then(RoutingAnswer(heard=dict(later[:MOST_SOURCES])), now)
            case RoutingKind.ASK:
                then(self._path_of(request), now)
            case RoutingKind.SET:
                changed = partial(self._changed, request, then)
                self._paths.set(
                    request.route_id, request.revision, request.number, request.path, now, changed
                )
            case RoutingKind.RESET:
                changed = partial(self._changed, request, then)
                self._paths.reset(request.route_id, request.revision, now, changed)
            case _:
                assert_never(request.kind)

    # For the channel

    def _receive(self, received: RequestReceived, now: int) -> None:
        call = received.call
        executes = self._table.nodes if self._executes is None else self._executes
        if call.client not in executes:
            if self._alarms is not None:
                self._alarms.forbidden(call.client, ROUTING_STREAM_ID, now)
            text = f"node {self._address} takes no commands from {call.client}"
            self._refuse(call, None, text, now)
            return
        request: RoutingRequest | None = None
        try:
            request = RoutingRequest.decode(received.value)
            if request.via:
                self._pass_on(call, request, ns_to_seconds(received.deadline_at - now), now)
            else:
                self.execute(request, now, partial(self._executed, call, request))
        except (ValueError, LocalError) as error:
            self._refuse(call, request, str(error), now)

    def _pass_on(self, call: CallKey, request: RoutingRequest, left_s: float, now: int) -> None:
        """Call the next node; the last address of `via` is that of the executing one."""
        if {self._address, call.client} & set(request.via):
            raise LocalError("it comes back to where it was")
        timeout_s = min(left_s, HOP_S * len(request.via))
        call_id = self._call(request.via, request, now, timeout_s)
        self._passed_on[call_id] = call

    def _ended(self, event: CallEvent, now: int) -> CallEvent | None:
        """Pass the answer of the next node on; return the event to emit, or None."""
        if not isinstance(event, ResponseReceived | CallFailed):
            return event
        call = self._passed_on.pop(event.call_id, None)
        if call is None:
            return event
        assert self._services is not None
        if isinstance(event, ResponseReceived):
            self._services.reply(call, event.value, now)
        else:
            text = event.text
            if event.failure is CallFailure.TIMED_OUT:
                text = f"node {self._address} had no answer"
            self._services.reply_error(call, CallFailure.HANDLER, text, now)
        return None

    def _executed(
        self, call: CallKey, request: RoutingRequest, answer: RoutingAnswer, now: int
    ) -> None:
        assert self._services is not None
        self._services.reply(call, answer.encode(request.kind), now)
        if request.kind in _CHANGES:
            self._tell(call, request, "", now)

    def _refuse(self, call: CallKey, request: RoutingRequest | None, reason: str, now: int) -> None:
        assert self._services is not None
        self._services.reply_error(call, CallFailure.HANDLER, reason, now)
        self._tell(call, request, reason, now)

    def _tell(self, call: CallKey, request: RoutingRequest | None, refusal: str, now: int) -> None:
        self._emit(
            RoutingHandled(
                commanded_by=call.client, request=request, refusal=refusal, handled_at=now
            )
        )

    # Below the methods above

    def _call(
        self, way: tuple[int, ...], request: RoutingRequest, now: int, timeout_s: float
    ) -> int:
        """Call the first node of a way; the rest of it is in the request."""
        assert self._services is not None
        request = msgspec.structs.replace(request, via=way[1:])
        return self._services.call(
            ROUTING_STREAM_ID, request.encode(), now, timeout_s=timeout_s, server=way[0]
        )

    def _changed(
        self, request: RoutingRequest, then: Callable[[RoutingAnswer, int], None], now: int
    ) -> None:
        then(self._path_of(request), now)

    def _path_of(self, request: RoutingRequest) -> RoutingAnswer:
        state = self._paths.state(request.route_id)
        return RoutingAnswer(revision=state.revision, number=state.number, path=state.path)

    def _probe(self, request: RoutingRequest, now: int) -> RoutingAnswer:
        if self._prober is None:
            raise LocalError(f"node {self._address} transmits no probes")
        over_ns = self._prober.begin(request.run, request.count, now) - now
        airtime_ns = self._prober.probe_airtime_ns()
        return RoutingAnswer(
            over_s=min(-(-over_ns // NS_PER_S), _LONGEST),
            airtime_ms=min(airtime_ns // _NS_PER_MS, _LONGEST),
        )
