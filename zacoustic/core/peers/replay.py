"""Replay windows: every sealed frame is opened once, in whatever order frames arrive.

A window belongs to one `Way`: a source, a destination, a port, a strength. It keeps the life of the
source, the highest counter that was opened in it, and which of the 63 before that were. A frame of
a former life, a counter that was opened, or one further behind is refused.

A short head tells six bits of the counter. The window guesses the rest: of the 64 counters from 15
before its highest one on, the one with these bits; if that fails, the one 64 later. Whoever has
lost more than that in a row waits for a long head.

**Power cuts.** What a receiver has opened must not be opened again by its next life, and a write to
the disk for every frame would wear it out. So windows have two ways to be kept:

- *exact*: highest counter and what is open before it are on the disk before the frame is handed on.
  So are strong frames, and all that is acted on: after a power cut the next command is heard.
- *ahead*: the disk has a mark that is up to `AHEAD` above the highest. The next life refuses all up
  to the mark; it loses at most so many frames that it never had.

The newest life of each source is a floor for all its windows: a port on which a source was never
heard takes no frame of a life that is over.
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


class Mark(msgspec.Struct, frozen=True, array_like=True):
    """What the disk knows of a window."""

    life: int
    highest: int
    seen: int = _ALL
    """Bit n: counter ``highest − n`` was opened."""

    def covers(self, window: "Window", more: int = 0) -> bool:
        """Tell whether a life that finds this refuses all that a window has opened.

        Args:
            window: What was opened.
            more: And so many counters after it.
        """
        return self.life == window.life and self.highest >= min(window.highest + more, LAST_COUNTER)


class Window:
    """What was opened of one way.

    Args:
        mark: What a former life of this node has kept; None: nothing was ever opened.
    """

    __slots__ = ("highest", "life", "seen")

    def __init__(self, mark: Mark | None = None) -> None:
        self.life = -1 if mark is None else mark.life
        self.highest = -1 if mark is None else mark.highest
        self.seen = 0 if mark is None else mark.seen

    @property
    def mark(self) -> Mark:
        """All of it, for the disk."""
        return Mark(self.life, self.highest, self.seen)

    def candidates(self, head: ShortHead | LongHead) -> Iterator[tuple[int, int]]:
        """Return the lives and counters that a frame may have: one, two or none."""
        if isinstance(head, LongHead):
            yield head.life, head.counter
        elif self.life >= 0:
            first = self.highest + 1 - BEHIND
            counter = first + (head.low - first) % LOW_COUNTERS
            for each in (counter, counter + LOW_COUNTERS):
                if 0 <= each <= LAST_COUNTER:
                    yield self.life, each

    def is_new(self, life: int, counter: int) -> bool:
        """Tell whether a frame can be one that was not opened before."""
        if life != self.life:
            return life > self.life
        behind = self.highest - counter
        return behind < 0 or (behind < WINDOW and not self.seen >> behind & 1)

    def note(self, life: int, counter: int) -> None:
        """Note that an authentic frame was opened, one that `is_new`."""
        if life != self.life:
            self.life, self.highest, self.seen = life, counter, 1
            return
        step = counter - self.highest
        if step > 0:
            self.seen = (self.seen << step | 1) & _ALL if step < WINDOW else 1
            self.highest = counter
        else:
            self.seen |= 1 << -step
