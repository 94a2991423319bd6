"""`Delivery`: the progress and the outcome of one reliable sample, for its publisher.

Any thread may create one, before the engine has seen the sample; the loop updates and awaits it.
"""

import asyncio
from collections.abc import Callable, Generator

from zacoustic.core.engine.events import (
    CustodyChanged,
    DeliveryEnded,
    DeliveryOutcome,
    DeliveryStored,
)
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.errors import DeliveryError, LocalError


class Delivery:
    """The progress and the outcome of one reliable sample.

    ::

        delivery = publisher.publish(order)
        outcome = await delivery          # DELIVERED, SUPERSEDED, EXPIRED, …

    Waiting is optional; a delivery that nobody awaits loses nothing.

    Args:
        key: Key of the sample.
        is_journalled: Whether the journal keeps the sample.
        cancel: Cancels the delivery.
    """

    def __init__(
        self, key: str, *, is_journalled: bool, cancel: "Callable[[Delivery], None]"
    ) -> None:
        self.key = key
        """The key of the sample."""
        self.outcome: DeliveryOutcome | None = None
        """The outcome; None: none yet."""
        self.missing: tuple[int, ...] = ()
        """At the end: addresses of the subscribers that have not acknowledged the sample."""
        self.detail: str = ""
        """The reason, if the outcome does not say it."""
        self.progress: ObjectProgress | None = None
        """Last known progress of a sample larger than a frame; None: it is not larger, or no
        progress is known yet."""
        self.custodians: dict[int, int] = {}
        """On a carried topic: subscriber that lacks the sample → node that has taken it along."""
        self._is_journalled = is_journalled
        self._cancel = cancel
        self._is_stored = False
        self._error: Exception | None = None
        self._waiters: set[asyncio.Future[None]] = set()

    def __await__(self) -> Generator[object, None, DeliveryOutcome]:
        """Wait for the outcome.

        `asyncio.timeout` sets a limit.

        Returns:
            The outcome.

        Raises:
            LocalError: The sample was refused after `publish` had returned in another thread.
            LinkClosedError: The node was closed, or has failed; a journalled sample goes on after a
                restart.
        """
        return self._wait().__await__()

    async def stored(self) -> None:
        """Wait until the sample is in the journal; from then on it survives a restart of this node.

        Raises:
            LocalError: The topic is not journalled, or as for awaiting the delivery.
            LinkClosedError: As for awaiting the delivery.
            DeliveryError: The delivery ended before that, and not as DELIVERED.
        """
        if not self._is_journalled:
            raise LocalError(
                f"{self.key} is not journalled", hint="say journal: true in its stream"
            )
        while not self._is_stored:
            if self.outcome is DeliveryOutcome.DELIVERED:
                return
            if self.outcome is not None:
                raise DeliveryError(f"{self.key}: {self.outcome.value} before it was stored")
            await self._progress()

    def cancel(self) -> None:
        """Cancel the delivery, from any thread. It ends as CANCELLED, unless it has ended.

        Raises:
            QueueFullError: In another thread: the loop is far behind.
            LinkClosedError: The node was closed, or has failed.
        """
        self._cancel(self)

    # For the carrier

    def note_progress(self, event: ObjectProgress) -> None:
        """Note progress."""
        self.progress = event

    def note_custody(self, event: CustodyChanged) -> None:
        """Note who takes the sample along."""
        self.custodians.pop(event.subscriber, None)
        if event.custodian is not None:
            self.custodians[event.subscriber] = event.custodian

    def note_stored(self) -> None:
        """Note that the sample is in the journal."""
        self._is_stored = True
        self._wake()

    def end(self, event: DeliveryEnded) -> None:
        """Note the outcome."""
        self.outcome, self.missing, self.detail = event.outcome, event.missing, event.detail
        self._wake()

    def fail(self, error: Exception) -> None:
        """Note that the outcome will not be known here."""
        if self.outcome is None and self._error is None:
            self._error = error
            self._wake()

    # Below the methods above

    async def _wait(self) -> DeliveryOutcome:
        while self.outcome is None:
            await self._progress()
        return self.outcome

    async def _progress(self) -> None:
        """Wait for the next change."""
        if self._error is not None:
            raise self._error
        waiter: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiters.add(waiter)
        try:
            await waiter
        finally:
            self._waiters.discard(waiter)

    def _wake(self) -> None:
        for waiter in tuple(self._waiters):
            if not waiter.done():
                waiter.set_result(None)


class Deliveries:
    """The deliveries of one engine that have not ended; for the loop."""

    def __init__(self) -> None:
        self._deliveries: dict[int, Delivery] = {}

    def add(self, delivery_id: int, delivery: Delivery) -> None:
        """Note the engine's id of a delivery."""
        self._deliveries[delivery_id] = delivery

    def id_of(self, delivery: Delivery) -> int | None:
        """Return the engine's id of a delivery; None: it has ended."""
        known = (each for each, other in self._deliveries.items() if other is delivery)
        return next(known, None)

    def progressed(self, event: ObjectProgress) -> None:
        """Update the progress of a large sample's delivery."""
        delivery = self._deliveries.get(event.object_id or 0)
        if delivery is not None:
            delivery.note_progress(event)

    def carried(self, event: CustodyChanged) -> None:
        """Note who takes a sample along."""
        delivery = self._deliveries.get(event.delivery_id)
        if delivery is not None:
            delivery.note_custody(event)

    def stored(self, event: DeliveryStored) -> None:
        """Note that the sample is in the journal."""
        delivery = self._deliveries.get(event.delivery_id)
        if delivery is not None:
            delivery.note_stored()

    def ended(self, event: DeliveryEnded) -> bool:
        """Set the outcome of a delivery; False: it is of another boot epoch."""
        delivery = self._deliveries.pop(event.delivery_id, None)
        if delivery is not None:
            delivery.end(event)
        return delivery is not None

    def fail(self, error: Exception) -> None:
        """End all without an outcome."""
        for delivery in self._deliveries.values():
            delivery.fail(error)
        self._deliveries.clear()
