"""Calls at the engine: those of remote clients, and those to remote servers."""

from collections.abc import Callable
from functools import partial
from typing import Final, TypeVar

from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailed, CallFailure, RequestReceived
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.errors import LocalError, PayloadInvalidError, ZacousticError
from zacoustic.run.pending import CallEnd, Pending
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.ends.calls import CallClient, CancelCall, TakeCall, TakenCall

T = TypeVar("T")

# Failures that a server can name; anything else is text of its handler.
_SAID_BY_SERVERS: Final = (
    CallFailure.NO_SERVER,
    CallFailure.BAD_REQUEST,
    CallFailure.UNKNOWN,
)


class EngineCalls:
    """The calls of one node at its engine.

    Args:
        runner: Drives the engine.
        table: The streams.
        ends: The calls that wait for their end.
    """

    def __init__(self, runner: LinkRunner, table: StreamTable, ends: Pending[CallEnd]) -> None:
        self._runner = runner
        self._table = table
        self._ends = ends
        self._servers: dict[int, TakeCall] = {}

    def give(
        self, stream_id: int, value: object, client: CallClient, *, timeout_s: float | None = None
    ) -> CancelCall:
        """Send a call to its remote server.

        Args:
            stream_id: The service.
            value: The request.
            client: Hears the outcome.
            timeout_s: Time limit for the answer, s; None: the service's own.

        Raises:
            LocalError: It cannot be sent.
        """

        def call(engine: Engine, now: int) -> int:
            call_id = engine.call(stream_id, value, now, timeout_s=timeout_s)
            self._ends.add(call_id, partial(_end, client))
            return call_id  # before the events of the engine are polled

        return partial(self._cancel, self._runner.apply(call))

    def serve(self, stream_id: int, take: TakeCall) -> Callable[[], None]:
        """Pass on the calls of a service; return the function that ends it.

        Raises:
            LocalError: This node already serves the service.
        """
        return add_server(self._servers, self._table.by_id(stream_id), take)

    def deliver(self, event: RequestReceived) -> None:
        """Pass a call to the program that serves it."""
        call = EngineTakenCall(self._runner, event)
        take = self._servers.get(event.call.stream_id)
        if take is None:
            name = self._table.by_id(event.call.stream_id).name
            call.fail(CallFailure.NO_SERVER, f"no program serves {name}")
            return
        try:
            take(call)
        except ZacousticError as error:
            call.fail(CallFailure.BAD_REQUEST, str(error))

    def _cancel(self, call_id: int) -> None:
        if self._ends.drop(call_id):
            self._runner.try_apply(lambda engine, now: engine.cancel(call_id, now))


class EngineTakenCall(TakenCall):
    """A call of a remote client."""

    def __init__(self, runner: LinkRunner, event: RequestReceived) -> None:
        super().__init__(
            event.value,
            client=event.call.client,
            call_id=str(event.call),
            deadline_at=event.deadline_at,
        )
        self.key = event.call
        """The call on the channel."""
        self._runner = runner

    def reply(self, value: object) -> bool:
        """Answer; if the answer cannot be sent, the engine informs the caller."""
        return bool(self._runner.try_apply(lambda engine, now: engine.reply(self.key, value, now)))

    def fail(self, failure: CallFailure, text: str) -> bool:
        """Answer with an error."""
        if failure is CallFailure.BAD_RESPONSE:
            text = f"bad response: {text}"
        said = failure if failure in _SAID_BY_SERVERS else CallFailure.HANDLER
        return bool(
            self._runner.try_apply(
                lambda engine, now: engine.reply_error(self.key, said, text, now)
            )
        )


def add_server(servers: dict[int, T], stream: Stream, server: T) -> Callable[[], None]:
    """Add the server of a stream; return the function that removes it.

    Raises:
        LocalError: It has one.
    """
    if stream.stream_id in servers:
        raise LocalError(f"{stream.name} is served by this node already")
    servers[stream.stream_id] = server

    def remove() -> None:
        if servers.get(stream.stream_id) is server:
            del servers[stream.stream_id]

    return remove


def _end(client: CallClient, end: CallEnd) -> None:
    if isinstance(end, CallFailed):
        client.fail(end.failure, end.text)
        return
    try:
        client.reply(end.value)
    except PayloadInvalidError as error:
        client.fail(CallFailure.BAD_RESPONSE, str(error))
