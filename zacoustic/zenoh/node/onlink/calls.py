"""Calls over a link: those that a local program makes, and those that it serves."""

from collections.abc import Callable
from typing import Any

from zacoustic.core.engine.events import CallFailed, CallFailure, RequestReceived
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import LocalError
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.node.carrier import IncomingCall, call_error
from zacoustic.zenoh.node.onlink.callers import Callers
from zacoustic.zenoh.node.routes import ServiceRoute


class LinkCalls:
    """The calls of one node.

    Args:
        table: The streams.
        callers: Those who wait for answers.
    """

    def __init__(self, table: StreamTable, callers: Callers) -> None:
        self._runner = callers.context.runner
        self._table = table
        self._servers: dict[int, Callable[[IncomingCall], None]] = {}
        self._callers = callers

    async def call(
        self, route: ServiceRoute[Any, Any], value: object, timeout_s: float | None
    ) -> object:
        """Call a service and wait for the answer; cancelling gives up."""
        stream = route.known_stream
        end = await self._callers.outcome(
            self._callers.context.ends,
            lambda engine, now: engine.call(stream.stream_id, value, now, timeout_s=timeout_s),
            lambda engine, call_id, now: engine.cancel(call_id, now),
        )
        if isinstance(end, CallFailed):
            raise call_error(stream.name, end.failure, end.text)
        return end.value

    def serve(
        self, route: ServiceRoute[Any, Any], handle: Callable[[IncomingCall], None]
    ) -> Callable[[], None]:
        """Pass on the requests of a service.

        Raises:
            LocalError: This node already serves the service.
        """
        stream_id = route.known_stream.stream_id
        if stream_id in self._servers:
            raise LocalError(f"{route.name} is served by this node already")
        self._servers[stream_id] = handle

        def remove() -> None:
            if self._servers.get(stream_id) is handle:
                del self._servers[stream_id]

        return remove

    def requested(self, event: RequestReceived) -> None:
        """Pass a request to the program that serves it."""
        call = LinkCall(self._runner, event)
        handle = self._servers.get(event.call.stream_id)
        if handle is None:
            name = self._table.by_id(event.call.stream_id).name
            call.fail(CallFailure.NO_SERVER, f"no program serves {name}")
        else:
            handle(call)


class LinkCall:
    """A request that arrived over the link.

    Args:
        runner: Drives the engine that answers it.
        event: The request.
    """

    def __init__(self, runner: LinkRunner, event: RequestReceived) -> None:
        self.value: Any = event.value
        self.client: int | None = event.call.client
        self.call_id: str | None = str(event.call)
        self.deadline_at = event.deadline_at
        self._runner = runner
        self._call = event.call

    def reply(self, value: object) -> bool:
        """Answer."""
        return self._runner.apply(lambda engine, now: engine.reply(self._call, value, now))

    def fail(self, failure: CallFailure, text: str) -> bool:
        """Answer with an error."""
        return bool(
            self._runner.try_apply(
                lambda engine, now: engine.reply_error(self._call, failure, text, now)
            )
        )
