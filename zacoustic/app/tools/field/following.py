"""Following a reliable sample from the command line: its progress and its outcome.

On a link its `Delivery` reports them. On Zenoh the health report of the forwarding gateway does:
its count of published samples rises by one, and later its count of samples being delivered falls to
0; the outcome counted since is that of the sample.
"""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from typing import Final

import msgspec
from msgspec import UNSET

from zacoustic.app.tools.watch.views import GatewayView, StreamView
from zacoustic.app.tools.watch.watching import Watch
from zacoustic.errors import DeliveryError
from zacoustic.zenoh.node.delivery import Delivery

TICK_S: Final = 0.25
"""Period of looking at a delivery, s."""


class Step(msgspec.Struct, frozen=True, kw_only=True):
    """The progress of a large sample."""

    sent_bytes: int
    """Bytes transmitted at least once."""
    done_bytes: int
    """Bytes that all subscribers have, as far as known."""
    total_bytes: int
    """Its size."""


class End(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a sample."""

    outcome: str
    """``delivered``, ``superseded``, ``expired``, ``refused`` or ``cancelled``."""
    missing: tuple[int, ...] | None = None
    """Addresses of the subscribers that lack it; None: unknown."""
    detail: str = ""
    """The reason, if the outcome does not tell it."""


Show = Callable[[Step], None]
"""Takes each new step."""


async def end_of(delivery: Delivery) -> End:
    """Wait for the outcome of a sample on a link."""
    outcome = await delivery
    return End(outcome=outcome.value, missing=delivery.missing, detail=delivery.detail)


@contextlib.asynccontextmanager
async def shown(delivery: Delivery | None, show: Show) -> AsyncIterator[None]:
    """Show the progress of a sample on a link, while something else is awaited."""

    async def look() -> None:
        told: Step | None = None
        while delivery is not None:
            step = _step_of(delivery)
            if step is not None and step != told:
                show(step)
                told = step
            await asyncio.sleep(TICK_S)

    looking = asyncio.create_task(look())
    try:
        yield
    finally:
        looking.cancel()
        await asyncio.gather(looking, return_exceptions=True)
        if delivery is not None and (last := _step_of(delivery)) is not None:
            show(last)


def _step_of(delivery: Delivery) -> Step | None:
    progress = delivery.progress
    if progress is None or progress.total_bytes is None:
        return None
    return Step(
        sent_bytes=progress.sent_bytes or 0,
        done_bytes=progress.done_bytes,
        total_bytes=progress.total_bytes,
    )


class GatewayFollower:
    """Follows the samples of one topic that a gateway forwards.

    Args:
        watch: An open watch on its network.
        name: Name of the topic's stream.

    Raises:
        DeliveryError: No gateway there forwards it, or it is not reliable.
    """

    def __init__(self, watch: Watch, name: str) -> None:
        self._watch = watch
        self._name = name
        forwarding = [
            (view.address, stream)
            for view in watch.board.views()
            for stream in view.streams
            if stream.name == name and "forward" in stream.jobs
        ]
        if not forwarding:
            raise DeliveryError(f"no gateway on this network forwards {name}")
        self._address, self._before = forwarding[0]
        if self._before.delivering is UNSET:
            raise DeliveryError(
                f"{name} is not reliable: nobody learns whether it has arrived",
                hint='reliability: "reliable" in its stream',
            )

    async def end(self, show: Show) -> End:
        """Wait for the outcome of samples published since, and show the progress."""
        told: Step | None = None
        while True:
            self._watch.changed.clear()
            view = self._watch.board.view(self._address)
            step = self._step(view)
            if step is not None and step != told:
                show(step)
                told = step
            end = self._end(next(each for each in view.streams if each.id == self._before.id))
            if end is not None:
                return end
            await self._watch.changed.wait()

    def _step(self, view: GatewayView) -> Step | None:
        for each in view.transfers:
            is_ours = each.stream == self._name and each.direction == "to"
            if is_ours and each.outcome is None and each.total_bytes is not None:
                return Step(
                    sent_bytes=each.sent_bytes or 0,
                    done_bytes=each.done_bytes,
                    total_bytes=each.total_bytes,
                )
        return None

    def _end(self, now: StreamView) -> End | None:
        if now.published <= self._before.published or now.delivering:
            return None
        ended = [
            outcome
            for outcome, count in now.outcomes.items()
            if count > self._before.outcomes.get(outcome, 0)
        ]
        worst = [outcome for outcome in ended if outcome != "delivered"]
        return End(outcome=(worst or ended)[0]) if ended else None
