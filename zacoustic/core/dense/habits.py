"""What a source's frames usually hold: which streams, how many samples, how far apart.

A frame says for each stream whether it has samples of it, and after each sample whether another one
follows. A vehicle that sends the same every ten seconds should pay nothing for that, so the chances
follow what was, along the same chain of references as everything else.
"""

from typing import Final

from zacoustic.core.dense.adaptation import LONGEST_STEPS
from zacoustic.core.dense.arithmetic import Coder
from zacoustic.core.dense.prior import StreamPrior

MOST_SAMPLES: Final = 255
"""Most samples of a stream in a frame."""

_COUNTED: Final = 12  # after so many samples, all are alike
_SHIFT: Final = 2
_LEAST: Final = 1 << 9
_MOST: Final = (1 << 16) - _LEAST
_EVEN: Final = 1 << 15
_OFTEN: Final = 7 << 13


class Habit:
    """What the frames of a source usually hold of one stream.

    Attributes:
        present: How often there is something, 2**-16.
        more: How often there is another sample after the first, second …, 2**-16.
        paced: How often the steps from the reference are those that were expected, 2**-16.
        regular: How often a sample is one step behind the one before it in the frame, 2**-16.
    """

    __slots__ = ("more", "paced", "present", "regular")

    def __init__(self, present: int, more: list[int], paced: int, regular: int) -> None:
        self.present = present
        self.more = more
        self.paced = paced
        self.regular = regular

    def copy(self) -> "Habit":
        """Return one that can be changed."""
        return Habit(self.present, self.more[:], self.paced, self.regular)

    def code_present(self, coder: Coder, is_present: bool) -> bool:
        """Write or read whether there are samples; learns it."""
        found = coder.flag(self.present, is_present)
        self.present = _followed(self.present, found)
        return found

    def code_more(self, coder: Coder, samples: int, is_more: bool) -> bool:
        """Write or read whether there is another sample after so many; learns it."""
        if samples >= MOST_SAMPLES:
            return False
        place = min(samples, _COUNTED) - 1
        found = coder.flag(self.more[place], is_more)
        self.more[place] = _followed(self.more[place], found)
        return found

    def code_steps(self, coder: Coder, expected: int, steps: int, *, in_frame: bool) -> int:
        """Write or read how far a sample lies behind its reference, 1…16; learns it."""
        chance = self.regular if in_frame else self.paced
        found = coder.flag(chance, steps == expected)
        if in_frame:
            self.regular = _followed(chance, found)
        else:
            self.paced = _followed(chance, found)
        if found:
            return expected
        others = [each for each in range(1, LONGEST_STEPS + 1) if each != expected]
        shares = [1 + (16 >> min(abs(each - expected), 4)) for each in others]
        return others[coder.choice(shares, others.index(steps) if steps in others else 0)]


def new_habit(prior: StreamPrior | None, streams: int) -> Habit:
    """Make the habit of a source of which nothing was heard.

    Args:
        prior: What a fit says of the stream.
        streams: How many streams there are.
    """
    if prior is None or not prior.present:
        present = min(_EVEN, (3 << 15) // max(streams, 1))
        return Habit(max(present, _LEAST), [_EVEN] * _COUNTED, _OFTEN, _OFTEN)
    more = [*prior.more, *[prior.more[-1] if prior.more else _EVEN] * _COUNTED][:_COUNTED]
    return Habit(prior.present, list(more), _OFTEN, _OFTEN)


def _followed(chance: int, found: bool) -> int:
    chance += ((1 << 16) - chance if found else -chance) >> _SHIFT
    return _LEAST if chance < _LEAST else min(chance, _MOST)
