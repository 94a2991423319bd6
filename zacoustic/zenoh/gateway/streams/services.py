"""Services: local calls to remote servers, and received calls to local ones.

Each call passes from one End of the gateway to the other one (`zacoustic.zenoh.ends`).
"""

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import zenoh

from zacoustic.core.base.clock import Clock, ns_to_seconds
from zacoustic.core.engine.events import RequestReceived
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.zenoh.ends.calls import TakenCall
from zacoustic.zenoh.ends.enginecalls import EngineCalls, EngineTakenCall
from zacoustic.zenoh.ends.zenohcalls import ZenohCallers, ZenohServer
from zacoustic.zenoh.gateway.dialect.dialects import Dialects
from zacoustic.zenoh.gateway.inputerrors import InputErrors
from zacoustic.zenoh.requests.context import RequestContext
from zacoustic.zenoh.session.asking.queries import HeldQuery
from zacoustic.zenoh.session.session import ZenohSession

# An answer that is due already has this long, s.
_LEAST_LIMIT_S: Final = 0.001


class Services:
    """The services of one gateway; for the loop.

    Args:
        table: All streams.
        zenoh_session: The session of the servers.
        input_errors: Takes the errors of local programs.
        dialects: Their local forms.
        context: The node, which has its calls.
        clock: Source of instants.
    """

    def __init__(
        self,
        table: StreamTable,
        zenoh_session: ZenohSession,
        input_errors: InputErrors,
        dialects: Dialects,
        context: RequestContext,
        *,
        clock: Clock,
    ) -> None:
        self._zenoh_session = zenoh_session
        self._clock = clock
        self._engine = EngineCalls(context.runner, table, context.ends)
        self.deliver: Callable[[RequestReceived], None] = self._engine.deliver
        """Takes a call from the channel."""
        self._streams = [stream for stream in table if isinstance(stream.spec, ServiceSpec)]
        self.dialects = {stream.stream_id: dialects.service(stream) for stream in self._streams}
        """The local form of each service, by stream id."""
        self._callers: dict[int, ZenohCallers] = {}
        self._servers: dict[int, ZenohServer] = {}
        self._watched: dict[int, Any] = {}
        for stream in self._streams:
            assert isinstance(stream.spec, ServiceSpec)
            dialect = self.dialects[stream.stream_id]
            complain = partial(input_errors.add, stream.name)
            self._callers[stream.stream_id] = ZenohCallers(
                dialect,
                partial(self._to_channel, stream),
                timeout_s=stream.spec.timeout_s,
                clock=clock,
                takes_marked=False,
                complain=complain,
            )
            self._servers[stream.stream_id] = ZenohServer(
                zenoh_session, dialect, priority=stream.qos.priority, complain=complain
            )
            self._engine.serve(stream.stream_id, partial(self._to_program, stream))

    def watch(self, address: int) -> None:
        """Watch for local servers of this node's services; in the worker."""
        for stream in self._streams:
            assert isinstance(stream.spec, ServiceSpec)
            if stream.spec.server == address:
                self._watched[stream.stream_id] = self._zenoh_session.session.declare_querier(
                    zenoh.KeyExpr(self.dialects[stream.stream_id].key),
                    allowed_destination=zenoh.Locality.REMOTE,
                )

    def ask(self, stream_id: int, held: HeldQuery) -> None:
        """Take a query to a remote server."""
        self._callers[stream_id].take(held)

    def close(self) -> None:
        """Stop asking the local network."""
        for server in self._servers.values():
            server.close()

    def _to_channel(self, stream: Stream, call: TakenCall) -> None:
        self._engine.give(stream.stream_id, call.value, call)

    def _to_program(self, stream: Stream, call: TakenCall) -> None:
        assert isinstance(call, EngineTakenCall)
        watched = self._watched.get(stream.stream_id)
        left_s = ns_to_seconds(call.deadline_at - self._clock())
        self._servers[stream.stream_id].give(
            call.value,
            call,
            limit_s=max(left_s, _LEAST_LIMIT_S),
            mark=self.dialects[stream.stream_id].question_mark(call.key),
            is_there=watched is not None and bool(watched.matching_status.matching),
        )
