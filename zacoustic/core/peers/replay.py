"""Replay windows: every sealed frame is opened once, in whatever order frames arrive.

A window belongs to one `Way`: a source, a destination, a port, a strength. It stores the *start* of
the source (`start_of`: the generation of its key, and its life), the highest counter opened, and
which of the 63 counters before it were opened. It refuses a frame of an earlier start, a counter
that was opened, and one further behind.

A short head contains six bits of the counter, and the window guesses the rest: the matching one of
the 64 counters that begin 15 before the highest; if that fails, the one 64 later. If the window has
opened nothing of the current start of a source, and another window knows that start, it tries the
counters from 0. A receiver that lost more than that in a row waits for a long head.

**Power cuts.** The next life of a receiver must not open again what this one has opened, and a disk
write per frame would wear the disk out. So there are two ways to store windows:

- *exact*: the highest counter and the window behind it are on disk before the frame is handed on.
  This is for strong frames and rare ones: after a power cut the next command is heard.
- *ahead*: the disk has a mark up to `AHEAD` above the highest counter. The next life refuses
  everything up to the mark; it loses at most that many frames that were never opened. A sender
  whose node is silent goes on above such a mark: tries to a silent node are rare.

The newest start of each source is a floor for all its windows: a port that never heard a source
refuses frames of an earlier start.
"""

from collections.abc import Iterator
from typing import Final

import msgspec

from zacoustic.core.wire.seal import LAST_COUNTER, LOW_COUNTERS, LongHead, ShortHead

WINDOW: Final = 64
"""Counters that a window can tell apart, including the highest."""
BEHIND: Final = 16
"""Short heads cover counters from this many before the next expected one."""
AHEAD: Final = 16
"""How far a mark runs ahead of the opened counters."""

_ALL: Final = (1 << WINDOW) - 1
_LIFE_BITS: Final = 16


def start_of(generation: int, life: int) -> int:
    """Return a number that grows with each start of a node, also across keys."""
    return generation << _LIFE_BITS | life


def life_of(start: int) -> int:
    """Return the life of a start."""
    return start & ((1 << _LIFE_BITS) - 1)


class Mark(msgspec.Struct, frozen=True, array_like=True):
    """The part of a window that is on disk."""

    start: int
    highest: int
    seen: int = _ALL
    """Bit n: counter ``highest − n`` was opened."""

    def covers(self, window: "Window", more: int = 0) -> bool:
        """Return whether a life that reads this mark refuses all that a window has opened.

        Args:
            window: The window.
            more: Number of later counters that the mark has to cover as well.
        """
        if self.start != window.start or self.highest < min(window.highest + more, LAST_COUNTER):
            return False
        opened = window.seen << self.highest - window.highest
        return not opened & ~self.seen & _ALL


class Window:
    """The opened frames of one way.

    Args:
        mark: What an earlier life of this node stored; None: nothing was ever opened.
    """

    __slots__ = ("highest", "seen", "start")

    def __init__(self, mark: Mark | None = None) -> None:
        self.start = -1 if mark is None else mark.start
        self.highest = -1 if mark is None else mark.highest
        self.seen = 0 if mark is None else mark.seen

    @property
    def mark(self) -> Mark:
        """The exact mark, for the disk."""
        return Mark(self.start, self.highest, self.seen)

    def candidates(
        self, head: ShortHead | LongHead, generation: int, newest: int = -1
    ) -> Iterator[tuple[int, int]]:
        """Return the starts and counters that a frame may have: two, one or none.

        Args:
            head: Of the frame.
            generation: Complete generation of the key that sealed it.
            newest: The newest start of its source that any window knows; -1: none.
        """
        if isinstance(head, LongHead):
            yield start_of(generation, head.life), head.counter
        elif newest > self.start:
            if newest == start_of(generation, life_of(newest)):
                yield newest, head.low
                yield newest, head.low + LOW_COUNTERS
        elif self.start >= 0 and self.start == start_of(generation, life_of(self.start)):
            first = self.highest + 1 - BEHIND
            counter = first + (head.low - first) % LOW_COUNTERS
            for each in (counter, counter + LOW_COUNTERS):
                if 0 <= each <= LAST_COUNTER:
                    yield self.start, each

    def is_new(self, start: int, counter: int) -> bool:
        """Return whether a frame may be one that was not opened before."""
        if start != self.start:
            return start > self.start
        behind = self.highest - counter
        return behind < 0 or (behind < WINDOW and not self.seen >> behind & 1)

    def note(self, start: int, counter: int) -> None:
        """Note that an authentic frame was opened, after `is_new` has allowed it."""
        if start != self.start:
            self.start, self.highest, self.seen = start, counter, 1
            return
        step = counter - self.highest
        if step > 0:
            self.seen = (self.seen << step | 1) & _ALL if step < WINDOW else 1
            self.highest = counter
        else:
            self.seen |= 1 << -step
