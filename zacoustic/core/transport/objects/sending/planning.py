"""How many repair fragments to send before the receivers are asked again.

One too many costs a frame. One too few costs a round: another request, the way there and back, and
the chance that request or answer is lost. Which of them is likelier depends on an unknown loss. It
is estimated from the fate of the fragments before (a beta distribution), so the number N of
fragments that a receiver needs for its next `lacking` ones has a beta negative binomial
distribution. Fragment n + 1 is worth sending while

    round · P(N = n + 1)  >  P(N ≤ n)

that is, while what it saves by just sufficing is more than what it costs by being superfluous.
Several receivers need the largest of their numbers, whose distribution is the product of theirs.
"""

import math
from typing import Final

import msgspec

_PRIOR_RECEIVED: Final = 1.5
_PRIOR_LOST: Final = 0.5
# The channel changes within minutes: observations older than so many fragments count half.
_MEMORY_FRAGMENTS: Final = 400.0
# From here on the rest costs less than its computation.
_HOPELESS: Final = 1e-12


class LossEstimate:
    """What is known of the loss on the way to one receiver."""

    def __init__(self) -> None:
        self.received = _PRIOR_RECEIVED
        self.lost = _PRIOR_LOST

    def learn(self, sent: int, received: int) -> None:
        """Count fragments sent and how many of them arrived."""
        received = max(0, min(sent, received))
        total = self.received + self.lost + sent
        keep = min(1.0, _MEMORY_FRAGMENTS / total)
        self.received = max(_PRIOR_RECEIVED, (self.received + received) * keep)
        self.lost = max(_PRIOR_LOST, (self.lost + sent - received) * keep)

    @property
    def is_known(self) -> bool:
        """Something has been learnt."""
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
    """Return how many repair fragments of a block to send before asking.

    Args:
        needs: Of each receiver that lacks something, at least one.
        round_frames: What another round costs, in frames.
        most: Never more than that.
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
    """The distribution of the number of fragments that one receiver needs, from small to large."""

    def __init__(self, need: Need) -> None:
        self._need = need
        self._failures = 0
        self._probability = math.exp(
            _log_beta(need.received + need.lacking, need.lost) - _log_beta(need.received, need.lost)
        )
        self.within = self._probability
        """Probability that the number reached suffices."""

    def reach(self, number: int) -> None:
        """Go on to `number` fragments."""
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
