"""What a source's frames usually hold: which streams, how many samples, how far apart.

A frame states which streams it has samples of, and after each sample whether another one follows. A
vehicle that sends the same every ten seconds should pay nothing for that, so the probabilities
follow the past, along the same chain of references as everything else. A frame may be of one stream
alone, or of several; one symbol says which, so that a source that sends each sample by itself does
not pay for all the absent streams.

Most frames of a source are like the one before, and after a few of the same kind the probabilities
no longer change. So habits are never changed in place: each is followed by another one, or by
itself. Lists of shares that follow others are cached, with the begin and end of each share.
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Final

from zacoustic.core.values.dense.coder.arithmetic import Coder
from zacoustic.core.values.dense.coder.shares import ends_of
from zacoustic.core.values.dense.model.prior import Model

MOST_SAMPLES: Final = 255
"""The most samples of a stream in a frame."""

_COUNTED: Final = 12  # after this many samples, all are alike
_SHIFT: Final = 2
_LEAST: Final = 1 << 9
_MOST: Final = (1 << 16) - _LEAST
_EVEN: Final = 1 << 15
_REMEMBERED: Final = 512  # cached lists of probabilities of one kind
_OFTEN: Final = 7 << 13
# How often a frame is in each form from the second on.
_FORMS: Final = ends_of(16, 8, 4, 2, 2)

Shares = tuple[tuple[int, ...], tuple[int, ...]]
"""Relative shares of alternatives, and their `ends_of`."""


def _shares(*shares: int) -> Shares:
    return shares, ends_of(*shares)


# How often the first sample is this many steps from its reference, 1…16.
_STEPS: Final = _shares(240, 320, 200, 160, 130, 100, 80, 60, 50, 40, 30, 25, 20, 15, 12, 40)
_STEPS_LEFT: Final = tuple(share >> 4 for share in _STEPS[0])
_STEPS_IN_FRAME: Final = ends_of(*_STEPS[0][1:])
# It is learnt from acknowledged frames only, which are those furthest from their own references:
# frames between them are at most as far.
_STEPS_GAIN: Final = 1 << 11
_STEPS_SHIFT: Final = 2


class Habit:
    """What a source's frames usually hold of one stream; never changed.

    Attributes:
        more: How often another sample follows the first, second …, 2**-16.
        regular: How often a sample is one step after the one before it in the frame, 2**-16.
        steps: How often the first sample is 1, 2, … steps from its reference.
    """

    __slots__ = ("more", "regular", "steps")

    def __init__(self, more: tuple[int, ...], regular: int, steps: Shares) -> None:
        self.more = more
        self.regular = regular
        self.steps = steps

    @property
    def likeliest_steps(self) -> int:
        """The most frequent distance of the first sample from its reference, 1…16 steps."""
        shares, _ = self.steps
        return shares.index(max(shares)) + 1

    def code_more(self, coder: Coder, samples: int, is_more: bool) -> tuple[bool, "Habit"]:
        """Write or read whether another sample follows; also return the habit after that."""
        if samples >= MOST_SAMPLES:
            return False, self
        more, place = self.more, (samples if samples < _COUNTED else _COUNTED) - 1
        chance = more[place]
        found = coder.flag(chance, is_more)
        if chance == (_MOST if found else _LEAST):
            return found, self
        more = (*more[:place], _followed(chance, found), *more[place + 1 :])
        return found, Habit(more, self.regular, self.steps)

    def code_steps(self, coder: Coder, steps: int) -> tuple[int, "Habit"]:
        """Write or read the distance of the first sample from its reference, 1…16 steps."""
        shares, ends = self.steps
        found = coder.pick(ends, steps - 1)
        after = _steps_after(shares, found)
        if after is self.steps:
            return found + 1, self
        return found + 1, Habit(self.more, self.regular, after)

    def code_steps_in_frame(self, coder: Coder, steps: int) -> tuple[int, "Habit"]:
        """Write or read the distance of a sample from the one before it, 1…16 steps."""
        is_next = coder.flag(self.regular, steps == 1)
        after = _followed(self.regular, is_next)
        habit = self if after == self.regular else Habit(self.more, after, self.steps)
        return 1 if is_next else 2 + coder.pick(_STEPS_IN_FRAME, steps - 2), habit


class Presence:
    """Which streams a source's frames usually hold; streams are numbered in the order of their ids.

    Attributes:
        single: How often a frame is of one stream alone, 2**-16.
        chances: How often a frame has samples of a stream, 2**-16.
        in_turn: How often a frame has the name whose turn it is, 2**-16.
    """

    __slots__ = ("_ends", "chances", "in_turn", "single")

    def __init__(self, single: int, chances: tuple[int, ...], in_turn: int = _OFTEN) -> None:
        self.single = single
        self.chances = chances
        self.in_turn = in_turn
        self._ends: tuple[int, ...] = ()  # of the chances, made at their first use

    def code(self, coder: Coder, places: Sequence[int]) -> tuple[tuple[int, ...], "Presence"]:
        """Write or read which streams there are; also return the presence after that."""
        single, chances = self.single, self.chances
        if coder.flag(single, len(places) == 1):
            ends = self._ends = self._ends or ends_of(*chances)
            found: tuple[int, ...] = (coder.pick(ends, places[0] if places else 0),)
        else:
            flag = coder.flag
            found = tuple(
                place for place, chance in enumerate(chances) if flag(chance, place in places)
            )
        return found, _presence_after(self, found)

    def after(self, place: int) -> "Presence":
        """Return the presence after a frame of one stream."""
        return _presence_after(self, (place,))

    def code_form(self, coder: Coder, form: int) -> tuple[int, "Presence"]:
        """Write or read the form in which a referring frame gets its name (`snapshot.FORMS`)."""
        is_first = coder.flag(self.in_turn, form == 0)
        found = 0 if is_first else 1 + coder.pick(_FORMS, form - 1)
        after = _followed(self.in_turn, is_first)
        return found, self if after == self.in_turn else Presence(self.single, self.chances, after)


def new_habits(model: Model | None, streams: Mapping[int, object]) -> tuple[Presence, list[Habit]]:
    """Make the habits of a new source: for its frames, and for each stream.

    Args:
        model: The fitted model.
        streams: The codec's streams, by id.
    """
    single = _EVEN if model is None or not model.single else model.single
    priors = {} if model is None else model.streams
    habits, chances = [], []
    for stream_id in streams:
        prior = priors.get(str(stream_id))
        present = min(_EVEN, (3 << 15) // len(streams))
        more: tuple[int, ...] = (_EVEN,) * _COUNTED
        if prior is not None and prior.present:
            present = prior.present
            last = prior.more[-1] if prior.more else _EVEN
            more = (*prior.more, *(last,) * _COUNTED)[:_COUNTED]
        chances.append(max(present, _LEAST))
        habits.append(Habit(more, _OFTEN, _STEPS))
    return Presence(single, tuple(chances)), habits


def _followed(chance: int, found: bool) -> int:
    chance += ((1 << 16) - chance if found else -chance) >> _SHIFT
    if chance > _MOST:
        return _MOST
    return chance if chance > _LEAST else _LEAST


@lru_cache(maxsize=_REMEMBERED)
def _steps_after(shares: tuple[int, ...], found: int) -> Shares:
    """Return the shares of steps after a first sample; `found` is its distance minus one."""
    after = [
        share - (share >> _STEPS_SHIFT) + left
        for share, left in zip(shares, _STEPS_LEFT, strict=True)
    ]
    fewer = _STEPS_GAIN // (found + 2)
    for place in range(found):
        after[place] += fewer
    after[found] += 2 * fewer
    return _shares(*after)


def _presence_after(before: Presence, places: tuple[int, ...]) -> Presence:
    single, chances = _chances_after(before.single, before.chances, places)
    return Presence(single, chances, before.in_turn)


@lru_cache(maxsize=_REMEMBERED)
def _chances_after(
    single: int, chances: tuple[int, ...], places: tuple[int, ...]
) -> tuple[int, tuple[int, ...]]:
    return _followed(single, len(places) == 1), tuple(
        _followed(chance, place in places) for place, chance in enumerate(chances)
    )
