"""`Node`: one participant, and what makes its endpoints."""

import asyncio
from collections.abc import AsyncIterator, Coroutine, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar, overload

import msgspec

from zacoustic.config import Config
from zacoustic.core.qos import Qos
from zacoustic.core.stats import EngineStats, LedgerEntry
from zacoustic.core.streams import Stream, StreamTable
from zacoustic.errors import ConfigError, LocalError
from zacoustic.journal import Journal
from zacoustic.link import Link
from zacoustic.node.carrier import Carrier, NodeEvent
from zacoustic.node.catalogue import Catalogue
from zacoustic.node.eventlog import EventLog
from zacoustic.node.identity import identify
from zacoustic.node.pubsub import Publisher, SampleCallback, Subscription
from zacoustic.node.service import Client, Handler, Service, ServiceType

Value = TypeVar("Value", bound=msgspec.Struct | bytes)
Request = TypeVar("Request", bound=msgspec.Struct | bytes)
Response = TypeVar("Response", bound=msgspec.Struct | bytes)
Fields = dict[str, Any]
"""A value whose type is named, not given as a class: field names to values."""


class Node:
    """One participant: on a link of its own, or on the Zenoh network of its island.

    An asynchronous context manager; `open` and `close` are the same by hand. Everything here and
    on the endpoints is for the loop it was opened on; `Publisher.publish` is for any thread.

    Args:
        name_or_address: A name, which the configuration may list, or an acoustic address.
        config: The file with the section `plugins.acoustic`, or what `read_config` made of it.
        link: *Direct mode*: a locator (``evologics/serial:/dev/ttyUSB0``), or a link that is not
            open yet; then there is no Zenoh. None: a Zenoh session.
        connect: Zenoh endpoints to connect to; None: the router that `config` describes, or
            whoever is found.
        address: Acoustic address, where neither name nor config tells it.
        journal: Direct mode: what the node remembers across restarts; None: nothing.
    """

    def __init__(
        self,
        name_or_address: str | int,
        *,
        config: str | Path | Config | None = None,
        link: str | Link | None = None,
        connect: str | Sequence[str] | None = None,
        address: int | None = None,
        journal: Journal | None = None,
    ) -> None:
        self._arguments = (name_or_address, config, address)
        self._link = link
        self._connect = connect
        self._journal = journal
        self._carrier: Carrier | None = None
        self._catalogue: Catalogue | None = None
        self._is_closed = False
        self._tasks: set[asyncio.Task[None]] = set()
        self._subscriptions: set[Subscription[Any]] = set()
        self._events = EventLog()
        self.name = str(name_or_address)
        """What it is called."""
        self.address: int | None = None
        """Its acoustic address, known when it is open."""

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    async def open(self) -> None:
        """Open the link or the session.

        Raises:
            ConfigError: The configuration or an argument is wrong.
            LinkUnavailableError, LinkOpenError: The link cannot be opened.
            SessionError: No Zenoh router is reached.
        """
        if self._carrier is not None or self._is_closed:
            raise LocalError(f"node {self.name} was opened already", hint="make a new Node")
        name_or_address, config, address = self._arguments
        identity = identify(name_or_address, config=config, address=address)
        table = identity.table()
        carrier = self._make_carrier(identity.config, identity.address, table)
        await carrier.open()
        self.name, self.address = identity.name, identity.address
        self._carrier = carrier
        self._catalogue = Catalogue(identity, table, carrier)

    async def close(self) -> None:
        """Close all endpoints, then the link or the session. May be called again.

        What is still queued for the water is lost: `flush` before, where that matters.
        """
        self._is_closed = True
        carrier, self._carrier = self._carrier, None
        if carrier is None:
            return
        for subscription in tuple(self._subscriptions):
            subscription.close()
        tasks = self._tasks - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        try:
            if tasks:
                await asyncio.wait(tasks)
        finally:
            await carrier.close()
            self._events.close()

    async def flush(self, *, timeout_s: float | None = None) -> None:
        """Wait until everything that was published has left this node.

        On a link: nothing is queued, and the last transmission has ended. That says nothing about
        whether it arrived.

        Args:
            timeout_s: How long to wait, s; None: for ever, such as on a link that stays down.

        Raises:
            TimeoutError: It has not left in time.
            LinkClosedError: The node has failed.
        """
        async with asyncio.timeout(timeout_s):
            await self._opened().flush()

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
        """Make a publisher.

        Args:
            sample_type: A `msgspec.Struct` class; the name of a type of the configuration, then
                values are dicts; or `bytes`.
            name: The topic, as the configuration or as a key; `{node}` is this node.
            qos: How samples wait here; None: as the configuration says.
            stream_id: Direct mode: adds the topic under this id, 1…175, the same on all nodes.

        Raises:
            ConfigError: What the code says and the configuration do not agree.
            LocalError: No such topic, this node may not publish it, or the node is not open.
        """
        carrier, catalogue = self._opened(), self._known()
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
        """Make a subscription.

        Args:
            sample_type: As for `create_publisher`.
            name: The topic, as the configuration, or one key of it.
            callback: Takes each sample, on the loop, one after the other; may be a coroutine
                function. None: the samples are taken by iteration.
            qos: Its depth bounds the samples that wait, of each key; None: 10.
            stream_id: As for `create_publisher`.

        Raises:
            ConfigError: What the code says and the configuration do not agree.
            LocalError: No such topic, this node may not listen to it, or the node is not open.
        """
        carrier, catalogue = self._opened(), self._known()
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
        """Make a subscription to iterate over: ``async for sample in node.subscribe(…)``."""
        return self.create_subscription(sample_type, name, None, qos, stream_id=stream_id)

    # Services

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
        service_type: tuple[type[Any] | str, type[Any] | str],
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
        """Make a client.

        Args:
            service_type: A class with the classes `Request` and `Response` in it, or the pair of
                them; each as the `sample_type` of a publisher.
            name: The service.
            qos: Priority and linger of its requests; None: as the configuration says.
            stream_id: Direct mode: adds the service under this id, 1…175, the same on all nodes.
            server: With `stream_id`: address of the node that serves.

        Raises:
            ConfigError: What the code says and the configuration do not agree.
            LocalError: No such service, this node is the server, or the node is not open.
        """
        carrier, catalogue = self._opened(), self._known()
        route = catalogue.client(service_type, name, qos, stream_id=stream_id, server=server)
        return Client(route, carrier)

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
        service_type: tuple[type[Any] | str, type[Any] | str],
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
        """Serve a service.

        Args:
            service_type: As for `create_client`.
            name: The service.
            handler: Answers a request, on the loop; a function or a coroutine function, with one
                argument, the request, or two, the request and a `CallContext`. What it raises
                reaches the caller with its text.
            qos: Priority and linger of its answers; None: as the configuration says.
            stream_id: As for `create_client`.

        Raises:
            ConfigError: What the code says and the configuration do not agree.
            LocalError: No such service, another node is the server, or the node is not open.
        """
        carrier, catalogue = self._opened(), self._known()
        route = catalogue.server(service_type, name, qos, stream_id=stream_id)
        return Service(route, handler, carrier, self._spawn)

    # What the node knows

    def events(self) -> AsyncIterator[NodeEvent]:
        """Iterate over what happens beside samples and calls, the last ones first.

        The link goes up or down; a peer is seen, or restarts; a peer defines a stream in another
        way. On Zenoh only the first: the connection to the router. Ends with the node.
        """
        return self._events.read()

    def topics(self) -> list[str]:
        """Return the names of the topics that this node may listen to; none without streams."""
        return self._known().topics()

    def find_stream(self, name: str) -> Stream | None:
        """Find the stream of a name or of a key; None: on Zenoh without a configuration.

        Raises:
            LocalError: There is none of that name.
        """
        return self._known().find(name)

    @property
    def stats(self) -> EngineStats:
        """What was counted; on Zenoh no frames, they are the gateway's."""
        return self._opened().stats

    def ledger(self) -> list[LedgerEntry]:
        """Return every byte given to the link, by stream and cause; on Zenoh nothing."""
        return self._opened().ledger()

    # Below the methods above

    def _make_carrier(
        self, config: Config | None, address: int | None, table: StreamTable
    ) -> Carrier:
        if self._link is None:
            from zacoustic.node.onzenoh import ZenohCarrier

            return ZenohCarrier(config, self._connect, report=self._events.add)
        from zacoustic import registry
        from zacoustic.node.onlink import LinkCarrier

        if self._connect is not None:
            raise ConfigError("connect is given beside link; allowed: one of the two")
        if address is None:
            raise ConfigError(
                f"node {self.name} has no address", hint="give address=1..254, or config=FILE"
            )
        link = self._link
        return LinkCarrier(
            registry.create(link, address) if isinstance(link, str) else link,
            address,
            table,
            journal=self._journal,
            report=self._events.add,
            fail=self._fail,
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

    def _spawn(self, coroutine: Coroutine[Any, Any, None], name: str) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(coroutine, name=name)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    def _fail(self, error: Exception) -> None:
        for subscription in tuple(self._subscriptions):
            subscription.fail(error)
        self._events.close(error)
