"""`Alarm`: the single timer of something that the loop drives, such as an engine or a medium."""

import asyncio
from collections.abc import Callable
from typing import Final

from zacoustic.core.base.clock import Clock, ns_to_seconds

# Expiries in a row after which the timer was due again at once. A sound engine has none.
_STUCK_LIMIT: Final = 1000


class Alarm:
    """Goes off at an instant; only one instant is set at a time.

    Args:
        clock: Source of instants. The loop gets only differences, so its clock may be another.
        expire: Called with the instant that was set, even if the loop is early by its resolution.
        time_scale: How many times faster than the loop's clock `clock` runs.
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
        """Go off only at that instant, ns, at once if it is past; None: not at all."""
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
        """Cancel the alarm."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def see_progress(self, due_at: int | None, now: int) -> None:
        """Detect an engine whose timer would fire for ever without progress.

        Args:
            due_at: The engine's next deadline after it has handled `now`, ns.
            now: The instant, ns.

        Raises:
            RuntimeError: The timer would fire for ever.
        """
        self._stuck = self._stuck + 1 if due_at is not None and due_at <= now else 0
        if self._stuck > _STUCK_LIMIT:
            self._stuck = 0
            raise RuntimeError(f"the engine asks for the instant {due_at} again and again")

    def _go_off(self) -> None:
        self._timer = None
        self._expire(self._due_at)
