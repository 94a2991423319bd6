"""What a publisher and the server of a call hold of a node on a link."""

from typing import Any, Protocol

from zacoustic.core.engine.events import CallFailure, RequestReceived
from zacoustic.zenoh.node.delivery import Delivery
from zacoustic.zenoh.node.routes import TopicRoute


class Carrier(Protocol):
    """What these ends need of the node that makes them."""

    def publish(
        self, route: TopicRoute[Any], value: object, *, encoding: str | None, delete: bool
    ) -> Delivery | None:
        """Queue a sample, from any thread."""

    def reply(self, request: RequestReceived, value: object) -> bool:
        """Answer a request."""

    def reply_error(self, request: RequestReceived, failure: CallFailure, text: str) -> bool:
        """Answer a request with an error."""


class LinkOutlet:
    """Where one publisher puts its samples.

    Args:
        carrier: Of the node.
        route: Where they go.
    """

    def __init__(self, carrier: Carrier, route: TopicRoute[Any]) -> None:
        self._carrier = carrier
        self._route = route

    def put(self, value: object, encoding: str | None) -> Delivery | None:
        """Queue a sample."""
        return self._carrier.publish(self._route, value, encoding=encoding, delete=False)

    def delete(self) -> Delivery | None:
        """Queue a delete."""
        return self._carrier.publish(self._route, None, encoding=None, delete=True)

    def close(self) -> None:
        """Nothing to withdraw: a link knows no publishers."""


class LinkCall:
    """A request that came over the link.

    Args:
        carrier: Of the node.
        event: The request.
    """

    def __init__(self, carrier: Carrier, event: RequestReceived) -> None:
        self.value: Any = event.value
        self.client: int | None = event.call.client
        self.call_id: str | None = str(event.call)
        self.deadline_at = event.deadline_at
        self._carrier = carrier
        self._event = event

    def reply(self, value: object) -> bool:
        """Answer it."""
        return self._carrier.reply(self._event, value)

    def fail(self, failure: CallFailure, text: str) -> bool:
        """Answer it with an error."""
        return self._carrier.reply_error(self._event, failure, text)
