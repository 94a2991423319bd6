"""Blocking endpoints, for the blocking `Node`: each wraps an asyncio endpoint on its loop."""

from collections.abc import Iterator
from typing import TypeVar

from zacoustic.core.engine.events import DeliveryOutcome
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.zenoh.node import delivery
from zacoustic.zenoh.node.api import pubsub, service
from zacoustic.zenoh.node.api.loopthread import OnLoop
from zacoustic.zenoh.node.api.pubsub import Sample

T = TypeVar("T")
Asked = TypeVar("Asked")
Answered = TypeVar("Answered")


class Publisher(OnLoop[pubsub.Publisher[T]]):
    """Publishes one key; see `zacoustic.Publisher`."""

    @property
    def key(self) -> str:
        """The key, placeholders filled in."""
        return self._endpoint.key

    def publish(self, value: T, *, encoding: str | None = None) -> "Delivery | None":
        """Publish a value; never waits for the channel, and works in callbacks, too."""
        made = self._thread.apply(lambda: self._endpoint.publish(value, encoding=encoding))
        return None if made is None else Delivery(made, self._thread)

    def delete(self) -> "Delivery | None":
        """Tell the subscribers that the key is deleted; otherwise as `publish`."""
        made = self._thread.apply(self._endpoint.delete)
        return None if made is None else Delivery(made, self._thread)

    def close(self) -> None:
        """Close the publisher."""
        self._thread.apply(self._endpoint.close)


class Delivery(OnLoop[delivery.Delivery]):
    """The progress and the outcome of one reliable sample; see `zacoustic.Delivery`."""

    @property
    def key(self) -> str:
        """The key of the sample."""
        return self._endpoint.key

    @property
    def outcome(self) -> DeliveryOutcome | None:
        """The outcome; None: none yet."""
        return self._endpoint.outcome

    @property
    def missing(self) -> tuple[int, ...]:
        """At the end: addresses of the subscribers that have not acknowledged the sample."""
        return self._endpoint.missing

    @property
    def detail(self) -> str:
        """The reason, if the outcome does not say it."""
        return self._endpoint.detail

    @property
    def progress(self) -> ObjectProgress | None:
        """The last known progress of a sample larger than a frame, or None."""
        return self._endpoint.progress

    def cancel(self) -> None:
        """Cancel the delivery; raises the errors of `zacoustic.Delivery.cancel`."""
        self._thread.apply(self._endpoint.cancel)

    def wait(self, *, timeout_s: float | None = None) -> DeliveryOutcome:
        """Wait for the outcome.

        Raises:
            TimeoutError: There is no outcome within `timeout_s`, s; the delivery goes on.
            LocalError, LinkClosedError: As for awaiting a `zacoustic.Delivery`, or in a callback.
        """
        return self._thread.wait(lambda: self._endpoint, timeout_s=timeout_s)

    def stored(self, *, timeout_s: float | None = None) -> None:
        """Wait until the sample is in the journal; errors as for `zacoustic.Delivery.stored`.

        Raises:
            TimeoutError: Not within `timeout_s`, s.
        """
        self._thread.wait(self._endpoint.stored, timeout_s=timeout_s)


class Subscription(OnLoop[pubsub.Subscription[T]]):
    """Receives the samples of a topic; see `zacoustic.Subscription`."""

    @property
    def name(self) -> str:
        """The topic."""
        return self._endpoint.name

    @property
    def dropped(self) -> int:
        """Samples that newer ones replaced before the application took them."""
        return self._endpoint.dropped

    def __iter__(self) -> Iterator[Sample[T]]:
        return self

    def __next__(self) -> Sample[T]:
        sample = self._thread.wait(lambda: anext(self._endpoint, None))
        if sample is None:
            raise StopIteration
        return sample

    def receive(self, *, timeout_s: float | None = None) -> Sample[T]:
        """Wait for the next sample.

        Raises:
            TimeoutError: No sample came within `timeout_s`, s.
            LocalError: The subscription is closed, or this is a callback.
        """
        return self._thread.wait(self._endpoint.receive, timeout_s=timeout_s)

    def close(self) -> None:
        """Unsubscribe."""
        self._thread.apply(self._endpoint.close)


class Client(OnLoop[service.Client[Asked, Answered]]):
    """Calls one service; see `zacoustic.Client`."""

    @property
    def name(self) -> str:
        """The service."""
        return self._endpoint.name

    def call(self, request: Asked, *, timeout_s: float | None = None) -> Answered:
        """Call the service and wait for the answer; errors as for `zacoustic.Client.call`."""
        return self._thread.wait(lambda: self._endpoint.call(request, timeout_s=timeout_s))

    def close(self) -> None:
        """Close the client."""
        self._thread.apply(self._endpoint.close)


class Service(OnLoop[service.Service[Asked, Answered]]):
    """Serves one service; see `zacoustic.Service`."""

    @property
    def name(self) -> str:
        """The service."""
        return self._endpoint.name

    def close(self) -> None:
        """Stop serving."""
        self._thread.apply(self._endpoint.close)
