"""Creates the endpoints of a node: publishers, subscriptions, clients, services, actions."""

import asyncio
import threading
from collections.abc import Coroutine
from typing import Any, TypeVar, overload

import msgspec

from zacoustic.core.base.qos import Qos
from zacoustic.errors import LocalError
from zacoustic.zenoh.node.api.action import (
    ActionClient,
    ActionServer,
    ActionType,
    Decide,
    DecideCancel,
    Execute,
)
from zacoustic.zenoh.node.api.catalogue import Catalogue
from zacoustic.zenoh.node.api.pubsub import Publisher, SampleCallback, Subscription
from zacoustic.zenoh.node.api.service import Client, Handler, Service, ServiceType
from zacoustic.zenoh.node.carrier import Carrier

Value = TypeVar("Value", bound=msgspec.Struct | bytes)
RequestValue = TypeVar("RequestValue", bound=msgspec.Struct | bytes)
ResponseValue = TypeVar("ResponseValue", bound=msgspec.Struct | bytes)
GoalValue = TypeVar("GoalValue", bound=msgspec.Struct | bytes)
FeedbackValue = TypeVar("FeedbackValue", bound=msgspec.Struct | bytes)
ResultValue = TypeVar("ResultValue", bound=msgspec.Struct | bytes)
Fields = dict[str, Any]
"""A value whose type is given by name, not as a class: field names to values."""


class EndpointMaker:
    """The part of a `Node` that creates its endpoints; for the loop."""

    def __init__(self, name: str) -> None:
        self.name = name
        """The node's name."""
        self._carrier: Carrier | None = None
        self._catalogue: Catalogue | None = None
        self._is_closed = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: int | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._subscriptions: set[Subscription[Any]] = set()

    # Topics

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
        self, sample_type: str, name: str, qos: Qos | None = None, *, stream_id: int | None = None
    ) -> Publisher[Fields]: ...
    def create_publisher(
        self,
        sample_type: type[Any] | str,
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Publisher[Any]:
        """Create a publisher.

        Args:
            sample_type: A `msgspec.Struct` class; `bytes`; or the name of a type of the
                configuration or of a ROS message: values are then dicts.
            name: The topic as in the configuration, or one of its keys; `{node}` is this node.
            qos: How samples wait here; None: as configured.
            stream_id: Direct mode: adds the topic under this id, 1…175, the same on all nodes.

        Raises:
            ConfigError: The code and the configuration do not agree.
            LocalError: There is no such topic, this node may not publish it, or the node is not
                open.
        """
        carrier, catalogue = self._maker()
        route = catalogue.publisher(sample_type, name, qos, stream_id)
        return Publisher(route, carrier.advertise(route))

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
        sample_type: type[Any] | str,
        name: str,
        callback: SampleCallback[Any] | None = None,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Subscription[Any]:
        """Create a subscription.

        Args:
            sample_type: As for `create_publisher`.
            name: The topic as in the configuration, or one of its keys.
            callback: Receives each sample, on the loop, one after the other; may be a coroutine
                function. None: iterate over the samples.
            qos: Its depth bounds the waiting samples of each key; None: 10.
            stream_id: As for `create_publisher`.

        Raises:
            ConfigError: The code and the configuration do not agree.
            LocalError: There is no such topic, this node may not subscribe to it, or the node is
                not open.
        """
        carrier, catalogue = self._maker()
        route = catalogue.subscription(sample_type, name, qos, stream_id)
        subscription = Subscription(route, carrier, self._subscriptions.discard)
        self._subscriptions.add(subscription)
        if callback is not None:
            self._spawn(subscription.feed(callback), f"callback of {name}")
        return subscription

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
        self, sample_type: str, name: str, qos: Qos | None = None, *, stream_id: int | None = None
    ) -> Subscription[Fields]: ...
    def subscribe(
        self,
        sample_type: type[Any] | str,
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Subscription[Any]:
        """Create a subscription to iterate over: ``async for sample in node.subscribe(…)``."""
        return self.create_subscription(sample_type, name, None, qos, stream_id=stream_id)

    # Services

    @overload
    def create_client(
        self,
        service_type: ServiceType[RequestValue, ResponseValue]
        | tuple[type[RequestValue], type[ResponseValue]],
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
        server: int | None = None,
    ) -> Client[RequestValue, ResponseValue]: ...
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
        """Create a client.

        Args:
            service_type: A class that contains the classes `Request` and `Response`; a pair of
                types, each as the `sample_type` of a publisher; or the name of a ROS service.
            name: The service.
            qos: Priority and linger of its requests; None: as configured.
            stream_id: Direct mode: adds the service under this id, 1…175, the same on all nodes.
            server: With `stream_id`: address of the node that serves.

        Raises:
            ConfigError: The code and the configuration do not agree.
            LocalError: There is no such service, this node is the server, or the node is not open.
        """
        carrier, catalogue = self._maker()
        route = catalogue.client(service_type, name, qos, stream_id=stream_id, server=server)
        return Client(route, carrier)

    @overload
    def create_service(
        self,
        service_type: ServiceType[RequestValue, ResponseValue]
        | tuple[type[RequestValue], type[ResponseValue]],
        name: str,
        handler: Handler[RequestValue, ResponseValue],
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
    ) -> Service[RequestValue, ResponseValue]: ...
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
        """Create a service.

        Args:
            service_type: As for `create_client`.
            name: The service.
            handler: Answers a request, on the loop: a function or a coroutine function that takes
                the request, and a `CallContext` if it has a second argument. The text of an
                exception reaches the caller.
            qos: Priority and linger of its answers; None: as configured.
            stream_id: As for `create_client`.

        Raises:
            ConfigError: The code and the configuration do not agree.
            LocalError: There is no such service, another node is the server, or the node is not
                open.
        """
        carrier, catalogue = self._maker()
        route = catalogue.server(service_type, name, qos, stream_id=stream_id)
        return Service(route, handler, carrier, self._spawn)

    # Actions

    @overload
    def create_action_client(
        self,
        action_type: ActionType[GoalValue, FeedbackValue, ResultValue]
        | tuple[type[GoalValue], type[FeedbackValue], type[ResultValue]],
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
        server: int | None = None,
    ) -> ActionClient[GoalValue, FeedbackValue, ResultValue]: ...
    @overload
    def create_action_client(
        self,
        action_type: str | tuple[type[Any] | str, type[Any] | str, type[Any] | str],
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
        server: int | None = None,
    ) -> ActionClient[Any, Any, Any]: ...
    def create_action_client(
        self,
        action_type: Any,
        name: str,
        qos: Qos | None = None,
        *,
        stream_id: int | None = None,
        server: int | None = None,
    ) -> ActionClient[Any, Any, Any]:
        """Create a client that sends goals.

        Args:
            action_type: A class that contains the classes `Goal`, `Feedback` and `Result`; three
                types, each as the `sample_type` of a publisher; or the name of a ROS action.
            name: The action.
            qos: Priority and linger of its goals; None: as configured.
            stream_id: Direct mode: adds the action under this id, 1…175, the same on all nodes.
            server: With `stream_id`: address of the node that serves.

        Raises:
            ConfigError: The code and the configuration do not agree.
            LocalError: There is no such action, this node is the server, or the node is not open.
        """
        carrier, catalogue = self._maker()
        route = catalogue.action_client(action_type, name, qos, stream_id=stream_id, server=server)
        return ActionClient(route, carrier, self._spawn)

    @overload
    def create_action_server(
        self,
        action_type: ActionType[GoalValue, FeedbackValue, ResultValue]
        | tuple[type[GoalValue], type[FeedbackValue], type[ResultValue]],
        name: str,
        execute_callback: Execute[GoalValue, FeedbackValue, ResultValue],
        qos: Qos | None = None,
        *,
        goal_callback: Decide[GoalValue] | None = None,
        cancel_callback: DecideCancel[GoalValue, FeedbackValue, ResultValue] | None = None,
        stream_id: int | None = None,
    ) -> ActionServer[GoalValue, FeedbackValue, ResultValue]: ...
    @overload
    def create_action_server(
        self,
        action_type: str | tuple[type[Any] | str, type[Any] | str, type[Any] | str],
        name: str,
        execute_callback: Execute[Any, Any, Any],
        qos: Qos | None = None,
        *,
        goal_callback: Decide[Any] | None = None,
        cancel_callback: DecideCancel[Any, Any, Any] | None = None,
        stream_id: int | None = None,
    ) -> ActionServer[Any, Any, Any]: ...
    def create_action_server(
        self,
        action_type: Any,
        name: str,
        execute_callback: Execute[Any, Any, Any],
        qos: Qos | None = None,
        *,
        goal_callback: Decide[Any] | None = None,
        cancel_callback: DecideCancel[Any, Any, Any] | None = None,
        stream_id: int | None = None,
    ) -> ActionServer[Any, Any, Any]:
        """Create an action server.

        Args:
            action_type: As for `create_action_client`.
            name: The action.
            execute_callback: Executes a goal in a separate task: a coroutine function that takes a
                `ServerGoalHandle`, sets the status there, and returns the result.
            qos: Priority and linger of feedback and results; None: as configured.
            goal_callback: Takes the goal and decides at once whether to accept it; None: accepts
                all. An exception rejects the goal, with its text.
            cancel_callback: Takes the `ServerGoalHandle` and decides at once whether the goal may
                be cancelled; None: always. `is_cancel_requested` then tells `execute_callback`.
            stream_id: As for `create_action_client`.

        Raises:
            ConfigError: The code and the configuration do not agree.
            LocalError: There is no such action, another node is the server, this node already
                serves it, or the node is not open.
        """
        carrier, catalogue = self._maker()
        route = catalogue.action_server(action_type, name, qos, stream_id=stream_id)
        return ActionServer(
            route,
            execute_callback,
            carrier,
            self._spawn,
            goal_callback=goal_callback,
            cancel_callback=cancel_callback,
        )

    def _opened(self) -> Carrier:
        if self._carrier is None:
            what = "closed" if self._is_closed else "not open"
            raise LocalError(f"node {self.name} is {what}", hint="use it in `async with Node(…)`")
        return self._carrier

    def _known(self) -> Catalogue:
        self._opened()
        assert self._catalogue is not None
        return self._catalogue

    def _maker(self) -> tuple[Carrier, Catalogue]:
        """Return the catalogue and the carrier; raise first if called from another thread."""
        carrier, catalogue = self._opened(), self._known()
        if threading.get_ident() != self._thread:
            raise LocalError(
                f"node {self.name}: endpoints are made in the thread of its loop",
                hint="loop.call_soon_threadsafe brings a call there; or use zacoustic.blocking",
            )
        return carrier, catalogue

    def _spawn(self, coroutine: Coroutine[Any, Any, None], name: str) -> asyncio.Task[None]:
        assert self._loop is not None
        task = self._loop.create_task(coroutine, name=name)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task
