"""The publishers of a latched topic on the local network, by the numbers that cross.

In ROS each publisher keeps its own last samples for late joiners. Across the channel a sample has
the number of its publisher, so that the samples of one never displace those of another
(`/tf_static` has several publishers on most vehicles). A publisher that starts again is another one
to the network: it gets the number of one that has gone, and so replaces what that one had said.
"""

from collections.abc import Callable
from typing import Final

KEYS_LIMIT: Final = 4096
"""Keys whose publishers are remembered; the least recently used one makes room."""


class LocalPublishers:
    """The publishers of one topic; for the loop.

    Args:
        most: How many of a key are told apart.
        has_gone: Returns whether a publisher was seen and is there no more.
        tell: Reports that there are more, with one line of text.
        sees_them: Whether the network shows which publishers are there. Otherwise one that is new
            may be one that started again.
    """

    def __init__(
        self,
        most: int,
        has_gone: Callable[[bytes], bool],
        tell: Callable[[str], None],
        *,
        sees_them: bool,
    ) -> None:
        self._sees_them = sees_them
        self._most = most
        self._has_gone = has_gone
        self._tell = tell
        self._of: dict[str, dict[bytes, int]] = {}

    def number(self, key: str, publisher: bytes) -> int:
        """Return the number of the publisher of a sample.

        Args:
            key: The key.
            publisher: What the network calls it; empty: unknown.
        """
        numbers = self._of.pop(key, {})
        self._of[key] = numbers
        if len(self._of) > KEYS_LIMIT:
            del self._of[next(iter(self._of))]
        latest = next(reversed(numbers), publisher)
        is_shared = publisher in numbers and numbers[latest] == numbers[publisher]
        number = numbers.pop(publisher, None)
        if number is None:
            number = self._next(key, numbers)
        elif is_shared and latest != publisher and not self._sees_them:
            self._tell_of(key)  # two of them publish in turn under one number
        numbers[publisher] = number  # the latest is the last
        return number

    def numbers(self, key: str) -> list[int]:
        """Return the numbers in use under a key; 0 if there is none."""
        return sorted(set(self._of.get(key, {}).values())) or [0]

    # Below the methods above

    def _next(self, key: str, numbers: dict[bytes, int]) -> int:
        """Return the number of one that has gone, or an unused one, or the last one."""
        for former in numbers:
            if self._has_gone(former):
                return numbers.pop(former)
        if len(numbers) < self._most:
            return min(set(range(self._most)) - set(numbers.values()))
        if self._sees_them:
            self._tell_of(key)
        elif self._most > 1:
            return numbers.pop(next(iter(numbers)))
        return self._most - 1

    def _tell_of(self, key: str) -> None:
        self._tell(
            f"{key} has more than {self._most} publishers here: the depth counts for those beyond "
            f"together, and late joiners across the channel may lack the samples of one; "
            f"local_publishers: {self._most + 1} keeps them apart"
        )
