"""A bounded mailbox for arrivals that the application has not taken yet; it keeps the newest.

Arrivals never wait for their reader. A mailbox keeps the newest `depth` items of each key, so that
a talkative node does not replace the items of a quiet one, and returns them in the order of their
arrival. It belongs to one loop and is not thread-safe.
"""

import asyncio
from collections import OrderedDict, deque
from typing import Generic, TypeVar

T = TypeVar("T")


class Mailbox(Generic[T]):
    """Items of one endpoint, from the carrier to the application.

    Args:
        depth: Items kept of each key, ≥ 1.
    """

    def __init__(self, depth: int) -> None:
        self.dropped = 0
        """Items that newer ones of the same key replaced."""
        self._depth = depth
        self._items: OrderedDict[int, tuple[str, T]] = OrderedDict()
        self._by_key: dict[str, deque[int]] = {}
        self._next_number = 0
        self._is_closed = False
        self._error: Exception | None = None
        self._changed = asyncio.Event()

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: T, key: str = "") -> None:
        """Add an item; drop the oldest of its key if there are already `depth` of them."""
        if self._is_closed:
            return
        numbers = self._by_key.setdefault(key, deque())
        if len(numbers) == self._depth:
            del self._items[numbers.popleft()]
            self.dropped += 1
        numbers.append(self._next_number)
        self._items[self._next_number] = (key, item)
        self._next_number += 1
        self._changed.set()

    async def get(self) -> T | None:
        """Wait for the next item; None: the mailbox was closed and is empty.

        Raises:
            Exception: The error passed to `close`, once the mailbox is empty.
        """
        while not self._items:
            if self._error is not None:
                raise self._error
            if self._is_closed:
                return None
            self._changed.clear()
            await self._changed.wait()
        number, (key, item) = self._items.popitem(last=False)
        numbers = self._by_key[key]
        assert numbers[0] == number
        numbers.popleft()
        if not numbers:
            del self._by_key[key]
        return item

    def close(self, error: Exception | None = None) -> None:
        """Accept no more items; those present can still be taken. May be called again."""
        if not self._is_closed:
            self._is_closed, self._error = True, error
            self._changed.set()
