"""Least squares that learn from every sample, for all fields of a sample at once, in integers.

The problem: a field is best guessed from all that is known by then: where the vehicle was going,
how it was lying, and the fields of the same sample that were coded before it. Which of these matter
differs from vehicle to vehicle and from hour to hour, so the weights must follow the data, on both
ends alike, and there is time for a few hundred multiplications.

The idea: put all quantities into one list, first those known beforehand, then the fields in the
order in which they are coded, and take from each the part that the ones before it explain (Gram and
Schmidt). What is left of a quantity, its *innovation*, is uncorrelated to the innovations before
it, so the weights of one do not change with those of another, and each is a division::

    innovation[k] = quantity[k] - Σ weight[k][i] · innovation[i]        over i < k

The sum is the prediction of quantity k from all before it. When a sample is known, each weight
moves towards explaining what was left over, by a share that is the innovation's energy in this
sample over its energy so far; this is recursive least squares in the form that rounding does not
disturb (modified Gram-Schmidt with error feedback), for the cost of one triangle for all fields.
Energies forget, so that weights can follow. A sample far off what was expected (a turn, a fix after
dead reckoning) is an exception more often than a rule, and is trusted less: without that the weights
of the long straight legs are spoiled by every turn, which costs a tenth of all bits.

Units: quantities and innovations in 1/16 of a step, weights in 2**-16, energies in their squares.

Invariant: nothing is changed in place. A sample's weights are those of its reference, moved; the
reference's own stay, since the next sample may refer to it again.

Source: F. Ling, D. Manolakis, J. Proakis, "A recursive modified Gram-Schmidt algorithm for
least-squares estimation", IEEE Trans. ASSP 34 (1986) 829.
"""

from itertools import accumulate
from operator import mul
from typing import Final

WEIGHT_BITS: Final = 16

# 1/128 of the energy is forgotten with every sample: weights follow the last hundreds of samples.
_FORGET_BITS: Final = 7
# Gains are in 2**-30 of 1/16 of a step; they meet what is left over in 2**-20 of a step.
_GAIN_SHIFT: Final = 18
_STEP_SHIFT: Final = 34
# Prediction beyond which weights are taken for broken, in 1/16 of a step: no field is that wide.
_BROKEN: Final = 1 << 32

Weights = list[list[int]]
"""For each quantity the weights of those before it: row k has k of them."""


class Explained:
    """The quantities of one sample, as far as they are known.

    Args:
        weights: Those of the reference.
        energies: Those of the reference, one for each quantity.
    """

    __slots__ = ("_energies", "_quantities", "_sums", "_weights", "innovations", "is_broken")

    def __init__(self, weights: Weights, energies: list[int]) -> None:
        self._weights = weights
        self._energies = energies
        self._sums: list[list[int]] = []
        self._quantities: list[int] = []
        self.innovations: list[int] = []
        self.is_broken = False

    def predict(self) -> int:
        """The next quantity as the ones before it explain it."""
        innovations = self.innovations
        # What all before each quantity explain together; the last of them is the prediction.
        sums = list(accumulate(map(mul, self._weights[len(innovations)], innovations), initial=0))
        self._sums.append(sums)
        prediction = sums[-1] >> WEIGHT_BITS
        if -_BROKEN < prediction < _BROKEN:
            return prediction
        self.is_broken = True
        return 0

    def add(self, quantity: int, prediction: int) -> None:
        """Tell what the quantity is that was predicted."""
        self._quantities.append(quantity)
        self.innovations.append(quantity - prediction)

    def add_known(self, quantities: list[int]) -> None:
        """Tell quantities of which no prediction is asked."""
        weights, sums, innovations = self._weights, self._sums, self.innovations
        for row, quantity in zip(weights[len(innovations) :], quantities, strict=False):
            explained = list(accumulate(map(mul, row, innovations), initial=0))
            sums.append(explained)
            innovations.append(quantity - (explained[-1] >> WEIGHT_BITS))
        self._quantities.extend(quantities)

    def moved(self, trust: int) -> tuple[Weights, list[int]]:
        """Learn the sample, all of whose quantities must be known.

        Args:
            trust: How much the sample counts, 1…2**16.

        Returns:
            The weights and energies with it.
        """
        gains, energies = [], []
        for energy, innovation in zip(self._energies, self.innovations, strict=True):
            kept = energy - (energy >> _FORGET_BITS)
            lever = trust * innovation
            more = kept + (lever * innovation >> 16) or 1
            gains.append((lever << _GAIN_SHIFT) // more)
            energies.append(more)
            trust = trust * kept // more
        weights = []
        for row, quantity, sums in zip(self._weights, self._quantities, self._sums, strict=True):
            whole = quantity << WEIGHT_BITS
            # The innovation itself is what was left of a quantity by all before it, hence the
            # second entry of the sums for the first weight.
            explained = iter(sums)
            next(explained)
            weights.append(
                [
                    weight + (gain * (whole - part) >> _STEP_SHIFT)
                    for weight, gain, part in zip(row, gains, explained, strict=False)
                ]
            )
        return weights, energies
