"""The cost of a node that does not answer: an allowance of frames for a day.

The problem: nobody can tell whether a node that does not answer is away for a minute or for a week,
or whether its answers are lost. Tries at a constant pace, however slow, cost the channel a thousand
frames a day, or reach a node long after it has returned.

The idea: the pause before a try is a share of the time without an answer. In the first ten minutes
that is shorter than the pauses that the round trip asks for, so nothing changes; after an hour it
is five minutes, after ten hours fifty. A day costs some eighty frames, and a node that says nothing
is reached within a twelfth of its absence. What goes more often, as an emergency does, spends of
the same allowance: the rest of the day then has fewer and longer pauses. When nothing is left, the
pause is half of the time without an answer: a dozen frames a day. In a crowd many frames are lost
within minutes, and nobody may then wait for hours while the channel is free again.

A node that is heard after a silence gets a few tries at once, and an answer renews the allowance.
If these tries are in vain, since many frames are lost, each pause is at most the time since it was
heard: pauses double until the others hold again. A node that is heard again and again and never
answers, since its channel works in one direction only, costs little more than a silent one: such
returns count ever more rarely.

Each node has one allowance on each link (`zacoustic.core.schedule.pacers`). Whatever is repeated
has one of its own as well, since a node may answer everything else and never this: its journal is
full, say, or it takes no frame of this size.
"""

import math
from typing import Final

from zacoustic.core.base.clock import NS_PER_S

_DAY_NS: Final = 86_400 * NS_PER_S
_FRAMES: Final = 82
"""Frames of a day, those every `LONGEST_NS` not included."""
_FIRST_FRAMES: Final = 40
"""At most so many of them are first transmissions: who publishes much would leave no tries."""
SHARE: Final = 12
"""The pause is this part of the time without an answer, 1/12, or longer if little is left."""
_LARGEST_SHARE: Final = 2
"""No pause is longer than this part of that time, 1/2, whatever is left."""
LONGEST_NS: Final = 6 * 3600 * NS_PER_S
"""The longest pause before a try, ns. What goes so rarely costs nothing of the allowance."""
_HASTE_NS: Final = 610 * NS_PER_S
"""So long without an answer emergencies keep their pace, ns, and samples their deadlines."""
_RARE_NS: Final = 60 * NS_PER_S
"""With longer pauses tries count as rare, ns."""
_DATED_FRAMES: Final = 60
"""The latter up to so many frames only."""
_HASTY_FRAMES: Final = 112
"""The former up to so many: beside much else an emergency may exceed the allowance a little."""
_RETURN_NS: Final = 120 * NS_PER_S
"""A node that is heard after so long a silence returns, ns."""
_GRANT: Final = 6
"""How many tries a node that returns gets at the usual pace, or one for which the application has
something new."""
_HASTY_GRANT: Final = 10
"""The same for a new emergency."""
_FIRST_GRANT_NS: Final = 3600 * NS_PER_S
_MOST_DOUBLINGS: Final = 3
"""When nothing is left, one hour, then 2, 4 and 8, have to pass between two such returns."""


class Allowance:
    """The frames that may still go in vain to one node, or for one thing."""

    __slots__ = (
        "_firsts", "_granted", "_grants", "_heard_at", "_last_at", "_may_return_at", "_returned_at",
        "_since", "_spent", "is_rare",
    )  # fmt: skip

    def __init__(self) -> None:
        self.is_rare = False
        """Whether tries had become rare since the last answer."""
        self._heard_at = self._last_at = self._may_return_at = 0
        self._since: int | None = None
        self._returned_at: int | None = None
        self._spent = self._firsts = self._granted = self._grants = 0

    @property
    def is_hasty(self) -> bool:
        """Whether emergencies do not become rare: there was an answer not long ago."""
        if self._granted:
            return True
        return self._vain_ns < _HASTE_NS and self._spent < _HASTY_FRAMES

    @property
    def keeps_deadlines(self) -> bool:
        """Whether what has a deadline does not become rarer than that, likewise."""
        if self._granted:
            return True
        return self._vain_ns < _HASTE_NS and self._spent < _DATED_FRAMES

    def pause_ns(self, frames: int = 1) -> int:
        """Return the shortest pause after the last try, ns.

        Args:
            frames: How many frames it was on the channel.
        """
        if self._granted or self._since is None:
            return 0
        left, vain_ns = _FRAMES - self._spent, max(1, self._vain_ns)
        longest_ns = min(LONGEST_NS, vain_ns // _LARGEST_SHARE)
        if self._returned_at is not None:
            longest_ns = min(longest_ns, max(1, self._last_at - self._returned_at))
        if left <= 0:
            return longest_ns
        # With this pause at any time, what is left lasts for the rest of the day.
        spread_ns = round(vain_ns * math.log(max(1.0, _DAY_NS / vain_ns)) / left)
        return min(longest_ns, frames * max(vain_ns // SHARE, spread_ns))

    def floor_ns(self, frames: int, *, is_urgent: bool) -> int:
        """Return `pause_ns`, but 0 for an emergency that does not become rare."""
        return 0 if is_urgent and self.is_hasty else self.pause_ns(frames)

    def sent(self, at: int, frames: int = 1, *, is_first: bool) -> None:
        """Record the end of a frame with something that awaits an answer.

        Args:
            at: The end of its transmission, ns.
            frames: How many frames it is on the channel if nobody answers.
            is_first: It goes for the first time.
        """
        if self._since is None:
            self._since = at
        elif at == self._last_at:
            return  # something else in the same frame
        if is_first:
            self._spent += frames * (self._firsts < _FIRST_FRAMES)
            self._firsts += frames
        else:
            self._spent += frames * (at - self._last_at < LONGEST_NS // 2)
            self._granted = max(0, self._granted - 1)
        self._last_at = max(self._last_at, at)
        self.is_rare |= self.pause_ns(frames) >= _RARE_NS

    def grant(self, *, hasty: bool = False) -> None:
        """Grant a few tries at the usual pace: the application has given something new.

        Args:
            hasty: It is an emergency.
        """
        self._granted = max(self._granted, _HASTY_GRANT if hasty else _GRANT)

    def back(self, now: int) -> None:
        """Grant a few tries, and ever longer pauses between further ones: the node is back."""
        self._granted, self._returned_at = max(self._granted, _GRANT), now

    def heard(self, now: int, patience: int) -> bool:
        """Record a frame of the node; return whether it is back, so that tries follow at once.

        Args:
            now: The instant.
            patience: How many tries it often takes until an answer comes, beyond a few.
        """
        silent_since = None if self._since is None else max(self._heard_at, self._since)
        self._heard_at = now
        if silent_since is None or now - silent_since < _RETURN_NS:
            return False
        if self._spent >= _FRAMES:
            if now < self._may_return_at:
                return False
            self._may_return_at = now + (_FIRST_GRANT_NS << min(self._grants, _MOST_DOUBLINGS))
            self._grants += 1
        self.back(now)
        self._granted = max(self._granted, _GRANT + patience)
        return True

    def may_try(self, now: int, frames: int = 1) -> bool:
        """Return whether a frame of a silent node releases a try at once."""
        is_recent = self._vain_ns < _HASTE_NS and self._spent < _HASTY_FRAMES
        return is_recent or now - self._last_at >= self.pause_ns(frames)

    def answered(self) -> bool:
        """Record an answer: the node is there; return whether tries had become rare."""
        was_rare, self.is_rare = self.is_rare, False
        self._since = self._returned_at = None
        self._spent = self._firsts = self._granted = self._grants = self._may_return_at = 0
        return was_rare

    # Below the methods above

    @property
    def _vain_ns(self) -> int:
        """How long there had been no answer when the last try ended, ns."""
        return 0 if self._since is None else self._last_at - self._since
