"""The Node API without asyncio, for scripts and notebooks: the same names, blocking calls.

A `Node` here runs the asyncio `zacoustic.Node` on a loop in a thread of its own, which it starts
and ends; it has no other logic. Callbacks and handlers run in that thread, one at a time. They must
not block, because the modem waits meanwhile. They may call `Publisher.publish`; every call that
waits raises `LocalError` there. Other threads may make any call.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar, cast, overload

from zacoustic.config import Config
from zacoustic.core.base.qos import Qos
from zacoustic.core.base.stats import EngineStats, LedgerEntry
from zacoustic.core.peers.measurements import Range
from zacoustic.core.streams.commands import CommandState, RemoteCommand
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.errors import LocalError
from zacoustic.link.contract import Link
from zacoustic.run.journal import Journal
from zacoustic.zenoh.node.api import node as asynchronous
from zacoustic.zenoh.node.api.action import ActionType
from zacoustic.zenoh.node.api.endpoints import Fields, Request, Response, Value
from zacoustic.zenoh.node.api.loopthread import LoopThread
from zacoustic.zenoh.node.api.pubsub import Sample
from zacoustic.zenoh.node.api.service import CallContext, ServiceType
from zacoustic.zenoh.node.api.waiting import (
    Client,
    Delivery,
    Publisher,
    Service,
    Subscription,
)
from zacoustic.zenoh.node.api.waitingactions import (
    ActionClient,
    ActionServer,
    Execute,
    GoalHandle,
    ServerGoalHandle,
    in_thread,
)
from zacoustic.zenoh.node.carrier import NodeEvent

__all__ = [
    "ActionClient",
    "ActionServer",
    "Client",
    "Delivery",
    "GoalHandle",
    "Node",
    "Publisher",
    "ServerGoalHandle",
    "Service",
    "Subscription",
]

T = TypeVar("T")
Made = TypeVar("Made")
Goal = TypeVar("Goal")
Feedback = TypeVar("Feedback")
Result = TypeVar("Result")
Asked = TypeVar("Asked")
Answered = TypeVar("Answered")

SampleCallback = Callable[[Sample[T]], None]
"""Receives each sample, in the loop's thread."""
Handler = Callable[[Asked], Answered] | Callable[[Asked, CallContext], Answered]
"""Answers a request, in the loop's thread; may take the context."""


class Node:
    """One participant; arguments and errors are those of `zacoustic.Node`. A context manager."""

    def __init__(
        self,
        name_or_address: str | int,
        *,
        config: str | Path | Config | None = None,
        link: str | Link | None = None,
        connect: str | Sequence[str] | None = None,
        address: int | None = None,
        journal: Journal | str | Path | None = None,
        record: str | Path | None = None,
    ) -> None:
        self.name = str(name_or_address)
        """The node's name."""
        self._thread: LoopThread | None = None
        self._node = asynchronous.Node(
            name_or_address,
            config=config,
            link=link,
            connect=connect,
            address=address,
            journal=journal,
            record=record,
        )

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def address(self) -> int | None:
        """The node's acoustic address; None before `open`."""
        return self._node.address

    def open(self) -> None:
        """Start the thread, and open the link or the session."""
        thread = LoopThread(f"node {self.name}")
        try:
            thread.wait(self._node.open)
        except BaseException:
            thread.stop()
            raise
        self._thread = thread

    def close(self) -> None:
        """Close everything, and end the thread. May be called again."""
        if self._thread is None:
            return
        try:
            self._thread.wait(self._node.close)
        finally:
            if not self._thread.is_current:
                thread, self._thread = self._thread, None
                thread.stop()

    def flush(self, *, timeout_s: float | None = None) -> None:
        """Wait until all published samples have left this node."""
        self._running().wait(lambda: self._node.flush(timeout_s=timeout_s))

    def range(self, peer: int | str, *, timeout_s: float = 30.0) -> Range:
        """Measure the range of another node; see `zacoustic.Node.range`."""
        return self._running().wait(lambda: self._node.range(peer, timeout_s=timeout_s))

    def command(
        self,
        peer: int | str,
        command: RemoteCommand,
        *,
        timeout_s: float = asynchronous.COMMAND_TIMEOUT_S,
    ) -> CommandState:
        """Send a command to a node and wait for the answer; see `zacoustic.Node.command`."""
        return self._running().wait(lambda: self._node.command(peer, command, timeout_s=timeout_s))

    def refuse(self, progress: ObjectProgress) -> bool:
        """Refuse the rest of an incoming large sample; see `zacoustic.Node.refuse`."""
        thread = self._running()
        return thread.apply(lambda: self._node.refuse(progress))

    @overload
    def create_publisher(
        self,
        sample_type: type[Value],
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Publisher[Value]: ...
    @overload
    def create_publisher(
        self,
        sample_type: str,
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Publisher[Fields]: ...
    def create_publisher(
        self,
        sample_type: Any,
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Publisher[Any]:
        """Create a publisher."""
        return self._make(
            Publisher,
            lambda: self._node.create_publisher(sample_type, name, qos, stream_id=stream_id),
        )

    @overload
    def create_subscription(
        self,
        sample_type: type[Value],
        name: str,
        callback: SampleCallback[Value] | None = None,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Subscription[Value]: ...
    @overload
    def create_subscription(
        self,
        sample_type: str,
        name: str,
        callback: SampleCallback[Fields] | None = None,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Subscription[Fields]: ...
    def create_subscription(
        self,
        sample_type: Any,
        name: str,
        callback: SampleCallback[Any] | None = None,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Subscription[Any]:
        """Create a subscription; without a callback it is an iterator."""
        return self._make(
            Subscription,
            lambda: self._node.create_subscription(
                sample_type, name, callback, qos, stream_id=stream_id
            ),
        )

    @overload
    def subscribe(
        self,
        sample_type: type[Value],
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Subscription[Value]: ...
    @overload
    def subscribe(
        self,
        sample_type: str,
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Subscription[Fields]: ...
    def subscribe(
        self,
        sample_type: Any,
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Subscription[Any]:
        """Create a subscription to iterate over: ``for sample in node.subscribe(…)``."""
        made: Subscription[Any] = self.create_subscription(
            sample_type, name, None, qos, stream_id=stream_id
        )
        return made

    @overload
    def create_client(
        self,
        service_type: ServiceType[Request, Response] | tuple[type[Request], type[Response]],
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
        server: int | None = None,
    ) -> Client[Request, Response]: ...
    @overload
    def create_client(
        self,
        service_type: str | tuple[type[Any] | str, type[Any] | str],
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
        server: int | None = None,
    ) -> Client[Any, Any]: ...
    def create_client(
        self,
        service_type: Any,
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
        server: int | None = None,
    ) -> Client[Any, Any]:
        """Create a client."""
        return self._make(
            Client,
            lambda: self._node.create_client(
                service_type, name, qos, stream_id=stream_id, server=server
            ),
        )

    @overload
    def create_service(
        self,
        service_type: ServiceType[Request, Response] | tuple[type[Request], type[Response]],
        name: str,
        handler: Handler[Request, Response],
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Service[Request, Response]: ...
    @overload
    def create_service(
        self,
        service_type: str | tuple[type[Any] | str, type[Any] | str],
        name: str,
        handler: Handler[Any, Any],
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Service[Any, Any]: ...
    def create_service(
        self,
        service_type: Any,
        name: str,
        handler: Handler[Any, Any],
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Service[Any, Any]:
        """Create a service; the handler runs in the loop's thread."""
        return self._make(
            Service,
            lambda: self._node.create_service(
                service_type, name, handler, qos, stream_id=stream_id
            ),
        )

    def create_action_client(
        self,
        action_type: ActionType[Goal, Feedback, Result] | tuple[Any, Any, Any],
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
        server: int | None = None,
    ) -> ActionClient[Goal, Feedback, Result]:
        """Create a client that sends goals; see `zacoustic.Node.create_action_client`."""
        return self._make(
            ActionClient,
            lambda: self._node.create_action_client(
                cast("Any", action_type), name, qos, stream_id=stream_id, server=server
            ),
        )

    def create_action_server(
        self,
        action_type: ActionType[Goal, Feedback, Result] | tuple[Any, Any, Any],
        name: str,
        execute_callback: Execute[Goal, Feedback, Result],
        qos: Qos | None = None,
        *,
        goal_callback: Callable[[Goal], bool] | None = None,
        cancel_callback: Callable[[Any], bool] | None = None,
        stream_id: int | None = None,
    ) -> ActionServer[Goal, Feedback, Result]:
        """Create an action server; `execute_callback` runs in a separate thread for each goal.

        The other callbacks run in the loop's thread. See `zacoustic.Node.create_action_server`.
        """
        execute = in_thread(execute_callback, self._running())
        return self._make(
            ActionServer,
            lambda: self._node.create_action_server(
                cast("Any", action_type),
                name,
                execute,
                qos,
                goal_callback=goal_callback,
                cancel_callback=cancel_callback,
                stream_id=stream_id,
            ),
        )

    def events(self) -> Iterator[NodeEvent]:
        """Iterate over events other than samples and calls; see `zacoustic.Node.events`."""
        thread, events = self._running(), self._node.events()
        while (event := thread.wait(lambda: anext(events, None))) is not None:
            yield event

    @property
    def stats(self) -> EngineStats:
        """The counters of the engine; they keep counting."""
        return self._node.stats

    def expired(self) -> dict[int, int]:
        """Return how many samples and calls expired unsent, by stream id."""
        return self._running().apply(self._node.expired)

    def ledger(self) -> list[LedgerEntry]:
        """Return all bytes given to the link, by stream and cause."""
        return self._running().apply(self._node.ledger)

    def _running(self) -> LoopThread:
        if self._thread is None:
            raise LocalError(f"node {self.name} is not open", hint="use it in `with Node(…)`")
        return self._thread

    def _make(self, wrapper: Callable[[T, LoopThread], Made], make: Callable[[], T]) -> Made:
        """Create an endpoint on the loop; callbacks cannot: that is a waiting call."""
        thread = self._running()
        return wrapper(thread.make(make), thread)
