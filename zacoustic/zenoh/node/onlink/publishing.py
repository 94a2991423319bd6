"""Publishing on a link: the way of a sample to the engine, and its delivery."""

import threading
import time
from collections.abc import Callable
from typing import Any

from zacoustic.core.base.qos import Reliability
from zacoustic.core.engine.engine import Engine
from zacoustic.errors import LocalError, QueueFullError
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.node.delivery import Deliveries, Delivery
from zacoustic.zenoh.node.routes import TopicRoute


class LinkPublishing:
    """The samples of one node; created on the loop, for any thread.

    Args:
        runner: Drives the engine that takes them.
    """

    def __init__(self, runner: LinkRunner) -> None:
        self._runner = runner
        self._thread = threading.get_ident()
        self.deliveries = Deliveries()
        """The reliable samples under way."""

    def publish(
        self, route: TopicRoute[Any], value: object, encoding: str | None, delete: bool
    ) -> Delivery | None:
        """Queue a sample, or that a key is deleted; see `Outlet.put`."""
        stream, instance = route.known_stream, route.instance
        made_at = time.monotonic_ns()
        delivery: Delivery | None = None
        if stream.qos.reliability is Reliability.RELIABLE:
            delivery = Delivery(
                route.key or route.name, is_journalled=stream.spec.journal, cancel=self._cancel
            )

        def put(engine: Engine, now: int) -> None:
            try:
                delivery_id = engine.publish(
                    stream.stream_id,
                    value,
                    now,
                    instance=instance,
                    encoding=encoding,
                    delete=delete,
                    queued_at=made_at,
                )
            except LocalError as error:
                if delivery is not None:
                    delivery.fail(error)
                raise
            if delivery is not None:  # before the events of the engine are polled
                self.deliveries.add(delivery_id, delivery)

        if not delete and threading.get_ident() != self._thread:
            stream.codec.encode(value)  # raises here an error that the loop could only log
        self._command(put, route.name)
        return delivery

    def _cancel(self, delivery: Delivery) -> None:
        """Cancel a delivery."""

        def cancel(engine: Engine, now: int) -> None:
            delivery_id = self.deliveries.id_of(delivery)
            if delivery_id is not None:
                engine.cancel_delivery(delivery_id, now)

        self._command(cancel, delivery.key)

    def _command(self, command: Callable[[Engine, int], None], name: str) -> None:
        """Run a command of the engine; on the loop, its errors are raised."""
        if threading.get_ident() == self._thread:
            self._runner.apply(command)
        elif not self._runner.submit(command):
            raise QueueFullError(f"{name}: the loop of the node is far behind, or has ended")
