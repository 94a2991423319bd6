"""How many repair fragments to send before the next request for feedback.

One too many costs a frame. One too few costs a round: another request, the way there and back, and
the chance that the request or the answer is lost. Which is likelier depends on an unknown loss. The
loss is estimated from the fate of earlier fragments (a beta distribution), so the number N of
fragments that a receiver needs for its next `lacking` ones has a beta negative binomial
distribution. Fragment n + 1 is worth sending while

 round · P(N = n + 1)  >  P(N ≤ n)

that is, while it saves more by just sufficing than it costs by being superfluous. Several receivers
need the largest of their numbers, whose distribution is the product of theirs.
"""

import math
from typing import Final

import msgspec

_PRIOR_RECEIVED: Final = 1.5
_PRIOR_LOST: Final = 0.5
# The channel changes within minutes: observations older than this many fragments count half.
_MEMORY_FRAGMENTS: Final = 400.0
# Below this probability the rest costs less than its computation.
_HOPELESS: Final = 1e-12


class LossEstimate:
    """The estimated loss on the way to one receiver."""

    def __init__(self) -> None:
        self.received = _PRIOR_RECEIVED
        self.lost = _PRIOR_LOST

    def learn(self, sent: int, received: int) -> None:
        """Add fragments that were sent, and how many of them arrived."""
        received = max(0, min(sent, received))
        total = self.received + self.lost + sent
        keep = min(1.0, _MEMORY_FRAGMENTS / total)
        self.received = max(_PRIOR_RECEIVED, (self.received + received) * keep)
        self.lost = max(_PRIOR_LOST, (self.lost + sent - received) * keep)

    @property
    def is_known(self) -> bool:
        """Whether any fragment has been counted."""
        return self.received + self.lost > _PRIOR_RECEIVED + _PRIOR_LOST

    @property
    def loss(self) -> float:
        """The expected loss, 0…1."""
        return self.lost / (self.received + self.lost)


class Need(msgspec.Struct, frozen=True):
    """What one receiver needs of one block."""

    lacking: int
    """Fragments that it lacks, ≥ 1."""
    received: float
    """Fragments known to have arrived, with the prior."""
    lost: float
    """Fragments known to be lost, with the prior."""


def repairs_to_send(needs: list[Need], round_frames: float, most: int) -> int:
    """Return how many repair fragments of a block to send before the next request.

    Args:
        needs: The needs of each receiver that lacks something, at least one.
        round_frames: Cost of another round, in frames.
        most: The largest result.
    """
    number = max(need.lacking for need in needs)
    spreads = [_Spread(need) for need in needs]
    for spread in spreads:
        spread.reach(number)
    while number < most:
        enough = math.prod(spread.within for spread in spreads)
        for spread in spreads:
            spread.reach(number + 1)
        after = math.prod(spread.within for spread in spreads)
        if round_frames * (after - enough) <= enough and enough > _HOPELESS:
            break
        number += 1
    return min(number, most)


class _Spread:
    """The distribution of the number of fragments that one receiver needs, in ascending order."""

    def __init__(self, need: Need) -> None:
        self._need = need
        self._failures = 0
        self._probability = math.exp(
            _log_beta(need.received + need.lacking, need.lost) - _log_beta(need.received, need.lost)
        )
        self.within = self._probability
        """Probability that `number` fragments suffice, for the number last reached."""

    def reach(self, number: int) -> None:
        """Advance to `number` fragments."""
        need = self._need
        while need.lacking + self._failures < number:
            lost = self._failures
            self._probability *= (need.lacking + lost) / (lost + 1)
            self._probability *= (need.lost + lost) / (
                need.received + need.lost + need.lacking + lost
            )
            self._failures += 1
            self.within += self._probability


def _log_beta(one: float, other: float) -> float:
    return math.lgamma(one) + math.lgamma(other) - math.lgamma(one + other)
