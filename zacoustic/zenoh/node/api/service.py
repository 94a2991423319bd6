"""Services: clients that call, and services that answer with a function of the application."""

import asyncio
import functools
import inspect
import logging
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any, Generic, Protocol, TypeVar, cast

import msgspec

from zacoustic.core.engine.events import CallFailure
from zacoustic.errors import DeliveryError, LocalError, ZacousticError
from zacoustic.zenoh.ends.calls import TakenCall
from zacoustic.zenoh.node.calls import CLOSED_TEXT
from zacoustic.zenoh.node.carrier import Carrier
from zacoustic.zenoh.node.routes import ServiceRoute

_logger = logging.getLogger(__name__)

Request = TypeVar("Request")
Response = TypeVar("Response")
RequestType = TypeVar("RequestType", covariant=True)
ResponseType = TypeVar("ResponseType", covariant=True)

Spawn = Callable[[Coroutine[Any, Any, None], str], "asyncio.Task[None]"]
"""Starts a task of the node: its coroutine and name."""


class ServiceType(Protocol[RequestType, ResponseType]):
    """Names the two types of a service, as in ROS: a class with two classes inside.

    ``class Arm:``, and in it ``class Request(msgspec.Struct)``, ``class Response(msgspec.Struct)``.
    """

    # Methods, because a type checker sees a class inside a class as one.
    def Request(self, *args: Any, **kwargs: Any) -> RequestType:  # noqa: ANN401, N802
        """Make a request."""
        ...

    def Response(self, *args: Any, **kwargs: Any) -> ResponseType:  # noqa: ANN401, N802
        """Make a response."""
        ...


class CallContext(msgspec.Struct, frozen=True, kw_only=True):
    """The caller of a request, the call's id, and the deadline of an answer."""

    service: str
    """Name of the service."""
    client: int | None
    """Acoustic address of the caller; None: on this Zenoh network."""
    call_id: str | None
    """Stays the same if a call comes again, which happens only after a restart of a server without
    a journal. Another call gets the same id after 64 calls of that client at the earliest, so
    remembering it for twice the service's timeout is enough. None: the caller is on this Zenoh
    network."""
    deadline_at: int
    """Instant after which an answer is dropped, ns on `time.monotonic_ns`."""


Handler = (
    Callable[[Request], Response | Awaitable[Response]]
    | Callable[[Request, CallContext], Response | Awaitable[Response]]
)
"""Answers a request, on the loop; may be a coroutine function, and may take the context."""


class Client(Generic[Request, Response]):
    """Calls one service. Created by `Node.create_client`.

    Args:
        route: Where calls go.
        carrier: Carries them.
    """

    def __init__(self, route: ServiceRoute[Request, Response], carrier: Carrier) -> None:
        self.name: str = route.name
        """The service."""
        self._route = route
        self._carrier = carrier
        self._is_closed = False

    async def call(self, request: Request, *, timeout_s: float | None = None) -> Response:
        """Call the service and wait for the answer.

        Cancelling withdraws a request that has not left yet.

        Args:
            request: A value of the client's type.
            timeout_s: Time limit for the answer, s, > 0; None: the service's own.

        Raises:
            ServiceError: The handler failed, with its text.
            CallTimeoutError: No answer came in time; whether the service ran is unknown.
            OutcomeUnknownError: The server ended without an answer, perhaps after it had done the
                work.
            DeliveryError: The service has no server, or the two ends define its stream differently.
            PayloadInvalidError: The type does not allow the request.
            PayloadTooLargeError: The request fits no frame of this link.
            QueueFullError: Too many calls are under way.
            LocalError: The client is closed, or this node is the server itself.
        """
        if self._is_closed:
            raise LocalError(f"the client of {self.name} is closed")
        if timeout_s is not None and not 0 < timeout_s < float("inf"):
            raise LocalError(f"timeout_s is {timeout_s}; allowed: above 0")
        value = await self._carrier.call(self._route, request, timeout_s)
        try:
            return self._route.response.build(value)
        except (ValueError, TypeError) as error:  # from a check of the application's class
            raise DeliveryError(f"{self.name}: the response is refused: {error}") from error

    def close(self) -> None:
        """Close the client. May be called again."""
        self._is_closed = True


class Service(Generic[Request, Response]):
    """Serves one service. Created by `Node.create_service`.

    Each request runs in a separate task. An error of the handler is logged here and reaches the
    caller as a `ServiceError` with its text.

    Args:
        route: Where calls come from.
        handler: Answers them.
        carrier: Carries them.
        spawn: Starts the tasks.
    """

    def __init__(
        self,
        route: ServiceRoute[Request, Response],
        handler: Handler[Request, Response],
        carrier: Carrier,
        spawn: Spawn,
    ) -> None:
        self.name: str = route.name
        """The service."""
        self._route = route
        self._handler = _with_context(handler)
        self._spawn = spawn
        self._tasks: set[asyncio.Task[None]] = set()
        self._at_work: set[TakenCall] = set()
        self._stop = carrier.serve(route, self._take)

    def close(self) -> None:
        """Stop serving, cancel calls under way and inform their callers. May be called again."""
        self._stop()
        for task in self._tasks:
            task.cancel()

    def _take(self, call: TakenCall) -> None:
        task = self._spawn(self._answer(call), f"call of {self.name}")
        self._tasks.add(task)
        task.add_done_callback(functools.partial(self._finish, call))

    def _finish(self, call: TakenCall, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        had_begun = call in self._at_work
        self._at_work.discard(call)
        if task.cancelled():  # perhaps before it began: nothing else informs the caller
            failure = CallFailure.UNKNOWN if had_begun else CallFailure.NO_SERVER
            call.fail(failure, CLOSED_TEXT)

    async def _answer(self, call: TakenCall) -> None:
        try:
            request = self._route.request.build(call.value)
        except (ValueError, TypeError) as error:  # from a check of the application's class
            call.fail(CallFailure.BAD_REQUEST, str(error))
            return
        context = CallContext(
            service=self.name,
            client=call.client,
            call_id=call.call_id,
            deadline_at=call.deadline_at,
        )
        self._at_work.add(call)
        try:
            response = self._handler(request, context)
            if inspect.isawaitable(response):
                response = await response
        except Exception as error:  # the application's; its caller learns of it
            _logger.warning("%s: the handler failed", self.name, exc_info=error)
            call.fail(CallFailure.HANDLER, _text_of(error))
            return
        try:
            if not call.reply(response):
                _logger.warning("%s: the answer comes after the caller's deadline", self.name)
        except ZacousticError as error:
            _logger.warning("%s: the answer cannot be sent: %s", self.name, error)
            call.fail(CallFailure.HANDLER, str(error))


def _text_of(error: Exception) -> str:
    message = error.args[0] if isinstance(error, ZacousticError) and error.args else error
    return " ".join(str(message).split()) or type(error).__name__


def _with_context(
    handler: Handler[Request, Response],
) -> Callable[[Request, CallContext], Response | Awaitable[Response]]:
    """Return a handler that takes the context: the same one if it requires two arguments."""
    try:
        parameters = inspect.signature(handler).parameters.values()
    except ValueError:  # a built-in function without a signature
        parameters = {}.values()
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    asked = [each for each in parameters if each.kind in positional and each.default is each.empty]
    if len(asked) >= 2:
        return cast("Callable[[Request, CallContext], Response | Awaitable[Response]]", handler)
    alone = cast("Callable[[Request], Response | Awaitable[Response]]", handler)
    return lambda request, _: alone(request)
