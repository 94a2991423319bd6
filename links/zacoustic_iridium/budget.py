"""What may be paid for: nothing is transmitted beyond it, and what was spent is counted."""

from collections import deque
from typing import Final

from zacoustic.core.clock import NS_PER_S

_DAY_NS: Final = 86_400 * NS_PER_S


class Budget:
    """Quanta of 24 hours, whenever these begin.

    Args:
        most_bytes: How many bytes may be paid for in 24 h.
        quantum_bytes: A message costs a multiple of this.
    """

    def __init__(self, most_bytes: int, quantum_bytes: int) -> None:
        self._most_bytes = most_bytes
        self._quantum_bytes = quantum_bytes
        self._spent: deque[tuple[int, int]] = deque()
        self.spent_bytes = 0
        """What was paid for since the start, bytes."""

    def cost_bytes(self, size_bytes: int) -> int:
        """Return what a message costs, bytes; a session without one costs a quantum."""
        return max(1, -(-size_bytes // self._quantum_bytes)) * self._quantum_bytes

    def allows(self, size_bytes: int, now: int) -> bool:
        """Return whether a message may be transmitted now."""
        while self._spent and now - self._spent[0][0] >= _DAY_NS:
            self._spent.popleft()
        spent_bytes = sum(cost for _, cost in self._spent)
        return spent_bytes + self.cost_bytes(size_bytes) <= self._most_bytes

    def spend(self, size_bytes: int, now: int) -> None:
        """Pay for a message."""
        cost = self.cost_bytes(size_bytes)
        self._spent.append((now, cost))
        self.spent_bytes += cost
