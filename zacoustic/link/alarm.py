"""`Alarm`: the one timer of something that is driven by the loop, such as an engine or a medium."""

import asyncio
from collections.abc import Callable
from typing import Final

from zacoustic.core.base.clock import Clock, ns_to_seconds

# Expiries in a row after which the timer is due again at once. A sound engine has none.
_STUCK_LIMIT: Final = 1000


class Alarm:
    """Goes off at an instant; only one is set at a time.

    Args:
        clock: Where instants come from. Only differences are given to the loop: its clock need not
            be this one.
        expire: Called with the instant that it was set to. The loop may be early by its resolution:
            then it is that instant which counts.
        time_scale: How many times faster than the loop's the clock goes.
    """

    def __init__(
        self, clock: Clock, expire: Callable[[int], None], *, time_scale: float = 1.0
    ) -> None:
        self._clock = clock
        self._time_scale = time_scale
        self._expire = expire
        self._timer: asyncio.Handle | None = None
        self._due_at = 0
        self._stuck = 0

    def set(self, due_at: int | None) -> None:
        """Go off at that instant, ns, and at no other; None: not at all. At once if it is over."""
        if self._timer is not None and due_at == self._due_at:
            return
        self.stop()
        if due_at is None:
            return
        self._due_at = due_at
        loop, delay_ns = asyncio.get_running_loop(), due_at - self._clock()
        if delay_ns > 0:
            self._timer = loop.call_later(ns_to_seconds(delay_ns) / self._time_scale, self._go_off)
        else:
            self._timer = loop.call_soon(self._go_off)

    def stop(self) -> None:
        """Do not go off."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def see_progress(self, due_at: int | None, now: int) -> None:
        """Report an engine whose timer would spin for ever.

        Args:
            due_at: What it waits for, after it has had `now`, ns.
            now: The instant, ns.

        Raises:
            RuntimeError: It would.
        """
        self._stuck = self._stuck + 1 if due_at is not None and due_at <= now else 0
        if self._stuck > _STUCK_LIMIT:
            self._stuck = 0
            raise RuntimeError(f"the engine asks for the instant {due_at} again and again")

    def _go_off(self) -> None:
        self._timer = None
        self._expire(self._due_at)
