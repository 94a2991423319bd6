"""Back-off: a random wait; its window doubles with each failure and shrinks after a success.

Nodes that collided would collide again, so each draws its own wait. The window is bounded, so a
node that failed often still tries.
"""

import random
from typing import Final

_LARGEST_WINDOW_SLOTS: Final = 32


class BackOff:
    """The window, and waits drawn from it.

    Args:
        slot_ns: Length of the smallest window, ns.
        rng: Draws the waits.
    """

    def __init__(self, slot_ns: int, rng: random.Random) -> None:
        self._slot_ns = slot_ns
        self._rng = rng
        self._window_slots = 1

    def draw(self) -> int:
        """Return a wait, ns: uniform in the window."""
        return self._rng.randrange(self._window_slots * self._slot_ns + 1)

    def grow(self) -> None:
        """Double the window."""
        self._window_slots = min(2 * self._window_slots, _LARGEST_WINDOW_SLOTS)

    def shrink(self) -> None:
        """Halve the window."""
        self._window_slots = max(1, self._window_slots // 2)

    @property
    def is_wide(self) -> bool:
        """Whether the window is larger than the smallest one."""
        return self._window_slots > 1

    def reset(self) -> None:
        """Return to the smallest window."""
        self._window_slots = 1
