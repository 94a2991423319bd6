"""Replay windows: every sealed frame is opened once, in whatever order frames arrive.

A window belongs to one `Way`: a source, a destination, a port, a strength. It keeps the *start* of
the source (`start_of`: the generation of its key, and its life), the highest counter that was
opened in it, and which of the 63 before that were. A frame of a former start, a counter that was
opened, or one further behind is refused.

A short head tells six bits of the counter. The window guesses the rest: of the 64 counters from 15
before its highest one on, the one with these bits; if that fails, the one 64 later. Where nothing
was opened yet of the present start of a source, and that start is known from another window, the
counters from 0 on are tried. Whoever has lost more than that in a row waits for a long head.

**Power cuts.** What a receiver has opened must not be opened again by its next life, and a write to
the disk for every frame would wear it out. So windows have two ways to be kept:

- *exact*: highest counter and what is open before it are on the disk before the frame is handed on.
  So are strong frames, and those that come rarely: after a power cut the next command is heard.
- *ahead*: the disk has a mark that is up to `AHEAD` above the highest. The next life refuses all up
  to the mark; it loses at most so many frames that it never had.

The newest start of each source is a floor for all its windows: a port on which a source was never
heard takes no frame of a start that is over.
"""

from collections.abc import Iterator
from typing import Final

import msgspec

from zacoustic.core.wire.seal import LAST_COUNTER, LOW_COUNTERS, LongHead, ShortHead

WINDOW: Final = 64
"""Counters that a window tells apart, the highest included."""
BEHIND: Final = 16
"""Counters of a short head begin so many before the next one that is expected."""
AHEAD: Final = 16
"""How far a mark runs ahead of what was opened."""

_ALL: Final = (1 << WINDOW) - 1
_LIFE_BITS: Final = 16


def start_of(generation: int, life: int) -> int:
    """Return a number that grows with each start of a node, also over a new key."""
    return generation << _LIFE_BITS | life


def life_of(start: int) -> int:
    """Return the life of a start."""
    return start & ((1 << _LIFE_BITS) - 1)


class Mark(msgspec.Struct, frozen=True, array_like=True):
    """What the disk knows of a window."""

    start: int
    highest: int
    seen: int = _ALL
    """Bit n: counter ``highest − n`` was opened."""

    def covers(self, window: "Window", more: int = 0) -> bool:
        """Tell whether a life that finds this refuses all that a window has opened.

        Args:
            window: What was opened.
            more: And so many counters after it.
        """
        if self.start != window.start or self.highest < min(window.highest + more, LAST_COUNTER):
            return False
        opened = window.seen << self.highest - window.highest
        return not opened & ~self.seen & _ALL


class Window:
    """What was opened of one way.

    Args:
        mark: What a former life of this node has kept; None: nothing was ever opened.
    """

    __slots__ = ("highest", "seen", "start")

    def __init__(self, mark: Mark | None = None) -> None:
        self.start = -1 if mark is None else mark.start
        self.highest = -1 if mark is None else mark.highest
        self.seen = 0 if mark is None else mark.seen

    @property
    def mark(self) -> Mark:
        """All of it, for the disk."""
        return Mark(self.start, self.highest, self.seen)

    def candidates(
        self, head: ShortHead | LongHead, generation: int, newest: int = -1
    ) -> Iterator[tuple[int, int]]:
        """Return the starts and counters that a frame may have: one, two or none.

        Args:
            head: Of the frame.
            generation: Of the key that it was sealed with, the whole number.
            newest: The newest start of its source that is known from any window; -1: none is.
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
        """Tell whether a frame can be one that was not opened before."""
        if start != self.start:
            return start > self.start
        behind = self.highest - counter
        return behind < 0 or (behind < WINDOW and not self.seen >> behind & 1)

    def note(self, start: int, counter: int) -> None:
        """Note that an authentic frame was opened, one that `is_new`."""
        if start != self.start:
            self.start, self.highest, self.seen = start, counter, 1
            return
        step = counter - self.highest
        if step > 0:
            self.seen = (self.seen << step | 1) & _ALL if step < WINDOW else 1
            self.highest = counter
        else:
            self.seen |= 1 << -step
