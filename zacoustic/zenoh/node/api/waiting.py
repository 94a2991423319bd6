"""Blocking endpoints, for the blocking `Node`: each wraps an asyncio endpoint on its loop."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from typing import Generic, TypeVar

from zacoustic.core.engine.events import DeliveryOutcome
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.zenoh.node import delivery
from zacoustic.zenoh.node.api import pubsub, service
from zacoustic.zenoh.node.api.loopthread import LoopThread
from zacoustic.zenoh.node.api.pubsub import Sample

T = TypeVar("T")
Asked = TypeVar("Asked")
Answered = TypeVar("Answered")


class Publisher(Generic[T]):
    """Publishes one key; see `zacoustic.Publisher`."""

    def __init__(self, publisher: pubsub.Publisher[T], thread: LoopThread) -> None:
        self.key = publisher.key
        """The key, placeholders filled in."""
        self._publisher = publisher
        self._thread = thread

    def publish(self, value: T, *, encoding: str | None = None) -> "Delivery | None":
        """Publish a value; never waits for the channel, and works in callbacks, too."""
        made = self._thread.apply(lambda: self._publisher.publish(value, encoding=encoding))
        return None if made is None else Delivery(made, self._thread)

    def delete(self) -> "Delivery | None":
        """Tell the subscribers that the key is deleted; otherwise as `publish`."""
        made = self._thread.apply(self._publisher.delete)
        return None if made is None else Delivery(made, self._thread)

    def close(self) -> None:
        """Close the publisher."""
        self._thread.apply(self._publisher.close)


class Delivery:
    """The progress and the outcome of one reliable sample; see `zacoustic.Delivery`."""

    def __init__(self, delivery: delivery.Delivery, thread: LoopThread) -> None:
        self.key = delivery.key
        """The key of the sample."""
        self._delivery = delivery
        self._thread = thread

    @property
    def outcome(self) -> DeliveryOutcome | None:
        """The outcome; None: none yet."""
        return self._delivery.outcome

    @property
    def missing(self) -> tuple[int, ...]:
        """At the end: addresses of the subscribers that have not acknowledged the sample."""
        return self._delivery.missing

    @property
    def detail(self) -> str:
        """The reason, if the outcome does not say it."""
        return self._delivery.detail

    @property
    def progress(self) -> ObjectProgress | None:
        """The last known progress of a sample larger than a frame, or None."""
        return self._delivery.progress

    def cancel(self) -> None:
        """Cancel the delivery; raises the errors of `zacoustic.Delivery.cancel`."""
        self._thread.apply(self._delivery.cancel)

    def wait(self, *, timeout_s: float | None = None) -> DeliveryOutcome:
        """Wait for the outcome.

        Raises:
            TimeoutError: There is no outcome within `timeout_s`, s; the delivery goes on.
            LocalError, LinkClosedError: As for awaiting a `zacoustic.Delivery`, or in a callback.
        """

        async def wait() -> DeliveryOutcome:
            async with asyncio.timeout(timeout_s):
                return await self._delivery

        return self._thread.wait(wait())

    def stored(self, *, timeout_s: float | None = None) -> None:
        """Wait until the sample is in the journal; errors as for `zacoustic.Delivery.stored`.

        Raises:
            TimeoutError: Not within `timeout_s`, s.
        """

        async def stored() -> None:
            async with asyncio.timeout(timeout_s):
                await self._delivery.stored()

        self._thread.wait(stored())


class Subscription(Generic[T]):
    """Receives the samples of a topic; see `zacoustic.Subscription`."""

    def __init__(self, subscription: pubsub.Subscription[T], thread: LoopThread) -> None:
        self.name = subscription.name
        """The topic."""
        self._subscription = subscription
        self._thread = thread

    @property
    def dropped(self) -> int:
        """Samples that newer ones replaced before the application took them."""
        return self._subscription.dropped

    def __iter__(self) -> Iterator[Sample[T]]:
        return self

    def __next__(self) -> Sample[T]:
        sample = self._thread.wait(next_or_none(self._subscription))
        if sample is None:
            raise StopIteration
        return sample

    def receive(self, *, timeout_s: float | None = None) -> Sample[T]:
        """Wait for the next sample.

        Raises:
            TimeoutError: No sample came within `timeout_s`, s.
            LocalError: The subscription is closed, or this is a callback.
        """

        async def receive() -> Sample[T]:
            async with asyncio.timeout(timeout_s):
                return await self._subscription.receive()

        return self._thread.wait(receive())

    def close(self) -> None:
        """Unsubscribe."""
        self._thread.apply(self._subscription.close)


class Client(Generic[Asked, Answered]):
    """Calls one service; see `zacoustic.Client`."""

    def __init__(self, client: service.Client[Asked, Answered], thread: LoopThread) -> None:
        self.name = client.name
        """The service."""
        self._client = client
        self._thread = thread

    def call(self, request: Asked, *, timeout_s: float | None = None) -> Answered:
        """Call the service and wait for the answer; errors as for `zacoustic.Client.call`."""
        return self._thread.wait(self._client.call(request, timeout_s=timeout_s))

    def close(self) -> None:
        """Close the client."""
        self._thread.apply(self._client.close)


class Service(Generic[Asked, Answered]):
    """Serves one service; see `zacoustic.Service`."""

    def __init__(self, served: service.Service[Asked, Answered], thread: LoopThread) -> None:
        self.name = served.name
        """The service."""
        self._served = served
        self._thread = thread

    def close(self) -> None:
        """Stop serving."""
        self._thread.apply(self._served.close)


async def next_or_none(items: AsyncIterator[T]) -> T | None:
    """Return the next item; None at the end."""
    return await anext(items, None)
