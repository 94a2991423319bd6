"""Topics: publishers and subscriptions, with values in the application's form."""

import inspect
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any, Final, Generic, TypeVar

import msgspec

from zacoustic.core.base.linktypes import LinkMetrics
from zacoustic.errors import LocalError
from zacoustic.text.safetext import one_line
from zacoustic.zenoh.node.api.mailbox import Mailbox
from zacoustic.zenoh.node.carrier import Carrier, Incoming, Outlet
from zacoustic.zenoh.node.delivery import Delivery
from zacoustic.zenoh.node.routes import TopicRoute

DEFAULT_DEPTH: Final = 10
"""Samples of each key that wait in a subscription without QoS, as in ROS."""

_logger = logging.getLogger(__name__)

T = TypeVar("T")


class Sample(msgspec.Struct, Generic[T], frozen=True, kw_only=True):
    """One published value, as it arrived."""

    content: T | None
    """The value; None if the key was deleted. `value` raises instead."""
    key: str
    """The key of the sample, placeholders filled in."""
    source: int | None
    """Acoustic address of the publishing node; None: on this Zenoh network."""
    deleted: bool = False
    """The key was deleted; there is no value."""
    encoding: str
    """Encoding that the publisher used."""
    age_s: float | None = None
    """Age at `received_at`, s; 30 days: at least so old; None: unknown, or no stamp."""
    age_error_s: float | None = None
    """How wrong that may be, s; None: nothing bounds it."""
    received_at: int
    """Instant of arrival, ns on `time.monotonic_ns`."""
    metrics: LinkMetrics = LinkMetrics()
    """The modem's measurements of the frame; empty on Zenoh."""

    @property
    def value(self) -> T:
        """The value.

        Raises:
            LocalError: The key was deleted.
        """
        if self.content is None:
            raise LocalError(f"{self.key} was deleted: no value", hint="look at sample.deleted")
        return self.content


SampleCallback = Callable[[Sample[T]], Awaitable[None] | None]
"""Receives each sample, on the loop; may be a coroutine function."""


class Publisher(Generic[T]):
    """Publishes one key, from any thread. Created by `Node.create_publisher`.

    Args:
        route: Where samples go.
        outlet: The carrier's part.
    """

    def __init__(self, route: TopicRoute[T], outlet: Outlet) -> None:
        assert route.key is not None
        self.key: str = route.key
        """The key, placeholders filled in."""
        self._outlet = outlet
        self._is_closed = False

    def publish(self, value: T, *, encoding: str | None = None) -> Delivery | None:
        """Publish a value; never waits for the channel.

        On a link the sample waits as the stream's QoS says: a newer one may replace it, and it may
        expire. In a thread other than the loop's, limits that only the engine knows (size,
        permission) are logged, not raised.

        Args:
            value: A value of the publisher's type.
            encoding: Zenoh encoding, if it is not the stream's.

        Returns:
            The delivery, on a link and for a reliable topic. None for a best-effort topic, and on
            Zenoh, where the gateway has it (`@acoustic/…/streams`).

        Raises:
            PayloadInvalidError: The type does not allow the value.
            PayloadTooLargeError: The value fits no frame of this link.
            QueueFullError: In another thread: the loop is far behind.
            JournalUnavailableError: The topic is journalled, and the journal cannot be written.
            LocalError: The publisher is closed, or this node may not publish the topic.
        """
        self._check_open()
        return self._outlet.put(value, encoding, False)

    def delete(self) -> Delivery | None:
        """Tell the subscribers that the key is deleted; otherwise as `publish`."""
        self._check_open()
        return self._outlet.put(None, None, True)

    def close(self) -> None:
        """Close the publisher. May be called again."""
        self._is_closed = True
        self._outlet.close()

    def _check_open(self) -> None:
        if self._is_closed:
            raise LocalError(f"the publisher of {self.key} is closed")


class Subscription(Generic[T]):
    """Receives the samples of a topic. Created by `Node.create_subscription` and `Node.subscribe`.

    Without a callback it is an asynchronous iterator, which ends when the subscription or its node
    is closed. Of each key the latest samples wait, up to the depth of the QoS. A node does not
    receive its own samples.

    Args:
        route: Where samples come from.
        carrier: Delivers them.
        forget: Called on close.
    """

    def __init__(
        self,
        route: TopicRoute[T],
        carrier: Carrier,
        forget: "Callable[[Subscription[Any]], None]",
    ) -> None:
        self.name: str = route.name
        """The topic."""
        self._form = route.form
        self._carrier = carrier
        self._mailbox: Mailbox[Incoming] = Mailbox(route.qos.depth)
        self._unsubscribe = carrier.subscribe(route, self._deliver)
        self._forget = forget

    @property
    def dropped(self) -> int:
        """Samples that newer ones replaced before the application took them."""
        return self._mailbox.dropped

    def __aiter__(self) -> AsyncIterator[Sample[T]]:
        return self

    async def __anext__(self) -> Sample[T]:
        while (incoming := await self._mailbox.get()) is not None:
            sample = self._read(incoming)
            if sample is not None:
                return sample
        raise StopAsyncIteration

    async def receive(self) -> Sample[T]:
        """Wait for the next sample.

        `asyncio.timeout` sets a limit.

        Raises:
            LocalError: The subscription is closed.
            LinkClosedError: The node has failed.
        """
        try:
            return await self.__anext__()
        except StopAsyncIteration:
            raise LocalError(f"the subscription to {self.name} is closed") from None

    def close(self) -> None:
        """Unsubscribe; iteration ends after the samples that have arrived. May be called again."""
        self.fail(None)

    def fail(self, error: Exception | None) -> None:
        """Unsubscribe and end iteration with an error; for the node."""
        self._unsubscribe()
        self._mailbox.close(error)
        self._forget(self)

    async def feed(self, callback: SampleCallback[T]) -> None:
        """Pass each sample to the callback and log its exceptions; for the node."""
        async for sample in self:
            try:
                result = callback(sample)
                if inspect.isawaitable(result):
                    await result
            except Exception:  # the application's; its next sample still comes
                _logger.exception("the callback of %s failed", self.name)

    def _deliver(self, incoming: Incoming) -> None:
        self._mailbox.put(incoming, incoming.key)

    def _read(self, incoming: Incoming) -> Sample[T] | None:
        """Build the sample; if its class refuses the value, count and log that and return None."""
        content: T | None = None
        if not incoming.deleted:
            try:
                content = self._form.build(incoming.value)
            except (ValueError, TypeError) as error:  # from a check of the application's class
                self._carrier.stats.drop("refused_by_class")
                _logger.warning(
                    "%s: a sample is refused by its class: %s", one_line(incoming.key), error
                )
                return None
        return Sample(
            content=content,
            key=incoming.key,
            source=incoming.source,
            deleted=incoming.deleted,
            encoding=incoming.encoding,
            age_s=incoming.age_s,
            age_error_s=incoming.age_error_s,
            received_at=incoming.received_at,
            metrics=incoming.metrics,
        )
