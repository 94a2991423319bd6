"""`Delivery`: the progress and the outcome of one reliable sample, for its publisher.

It may be made in any thread, before the engine has seen the sample; it is updated and awaited on
the loop.
"""

import asyncio
from collections.abc import Callable, Generator

from zacoustic.core.engine.events import DeliveryEnded, DeliveryOutcome, DeliveryStored
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.errors import DeliveryError, LocalError


class Delivery:
    """The progress and the outcome of one reliable sample.

    ::

        delivery = publisher.publish(order)
        outcome = await delivery          # DELIVERED, SUPERSEDED, EXPIRED, …

    To wait for it is optional, and nothing is lost with it.

    Args:
        key: What the sample was published under.
        is_journalled: The journal keeps it.
        cancel: Gives it up.
    """

    def __init__(
        self, key: str, *, is_journalled: bool, cancel: "Callable[[Delivery], None]"
    ) -> None:
        self.key = key
        """What the sample was published under."""
        self.outcome: DeliveryOutcome | None = None
        """Its outcome; None: it has none yet."""
        self.missing: tuple[int, ...] = ()
        """Addresses of the subscribers that have not acknowledged it, when it has ended."""
        self.detail = ""
        """The reason, if the outcome does not say it."""
        self.progress: ObjectProgress | None = None
        """Its last known progress, if it is larger than a frame; None: it is not, or nothing
        is known yet."""
        self._is_journalled = is_journalled
        self._cancel = cancel
        self._is_stored = False
        self._error: Exception | None = None
        self._waiters: set[asyncio.Future[None]] = set()

    def __await__(self) -> Generator[object, None, DeliveryOutcome]:
        """Wait for its end; `asyncio.timeout` limits how long.

        Returns:
            How it ended.

        Raises:
            LocalError: It was refused, after `publish` had returned in another thread.
            LinkClosedError: The node was closed, or has failed; a journalled sample goes on after a
                restart.
        """
        return self._wait().__await__()

    async def stored(self) -> None:
        """Wait until the journal has it: from then on it survives a restart of this node.

        Raises:
            LocalError: The topic is not journalled, or as for awaiting the delivery.
            LinkClosedError: As for awaiting the delivery.
            DeliveryError: It ended before, without being delivered.
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
        """Give it up; from any thread. It ends as CANCELLED, unless it has ended.

        Raises:
            QueueFullError: From another thread: the loop is far behind.
            LinkClosedError: The node was closed, or has failed.
        """
        self._cancel(self)

    # For the carrier

    def note_progress(self, event: ObjectProgress) -> None:
        """It has progressed."""
        self.progress = event

    def note_stored(self) -> None:
        """The journal has it."""
        self._is_stored = True
        self._wake()

    def end(self, event: DeliveryEnded) -> None:
        """It has ended."""
        self.outcome, self.missing, self.detail = event.outcome, event.missing, event.detail
        self._wake()

    def fail(self, error: Exception) -> None:
        """Its outcome will not be known here."""
        if self.outcome is None and self._error is None:
            self._error = error
            self._wake()

    # Below the methods above

    async def _wait(self) -> DeliveryOutcome:
        while self.outcome is None:
            await self._progress()
        return self.outcome

    async def _progress(self) -> None:
        """Wait until something happens to it."""
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
        """Note which one the engine means by an id."""
        self._deliveries[delivery_id] = delivery

    def id_of(self, delivery: Delivery) -> int | None:
        """Return what the engine calls a delivery; None: it has ended."""
        known = (each for each, other in self._deliveries.items() if other is delivery)
        return next(known, None)

    def progressed(self, event: ObjectProgress) -> None:
        """Update the progress of a large sample's delivery."""
        delivery = self._deliveries.get(event.object_id or 0)
        if delivery is not None:
            delivery.note_progress(event)

    def stored(self, event: DeliveryStored) -> None:
        """Note that the delivery is in the journal."""
        delivery = self._deliveries.get(event.delivery_id)
        if delivery is not None:
            delivery.note_stored()

    def ended(self, event: DeliveryEnded) -> bool:
        """Give the delivery its outcome; False if it is of another boot epoch."""
        delivery = self._deliveries.pop(event.delivery_id, None)
        if delivery is not None:
            delivery.end(event)
        return delivery is not None

    def fail(self, error: Exception) -> None:
        """End all without an outcome."""
        for delivery in self._deliveries.values():
            delivery.fail(error)
        self._deliveries.clear()
