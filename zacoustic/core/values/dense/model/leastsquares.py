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
Energies forget, so that weights can follow. An innovation smaller than usual says little of its
weights: it moves its energy only (set-membership filtering), which is the fate of half of them and
costs a fifth of what there was to learn. A sample far off what was expected (a turn, a fix after
dead reckoning) is an exception more often than a rule, and is trusted less: without that the
weights of the long straight legs are spoiled by every turn, which costs a tenth of all bits.

A row of weights at a time would cost a hundred multiplications; but all that an innovation explains
are multiples of it. So the weights *of* one innovation, for all quantities after it, stand side by
side in one long integer, 96 bits each, and one multiplication of Python's does them all. The last
quantity stands in the lowest bits: later innovations have fewer weights, and shorter integers. What
has been explained of quantities that are known by then is cut off, so it becomes shorter as well,
and the next prediction stands on its top.

Units: quantities and innovations in 1/16 of a step, weights in 2**-16, energies in 1/256 of a step
squared. Values that do not fit their 96 bits spill into their neighbours, at both ends alike: the
predictions are then nonsense, are found to be, and learning starts again.

Invariant: nothing is changed in place. A sample's weights are those of its reference, moved; the
reference's own stay, since the next sample may refer to it again.

Sources: F. Ling, D. Manolakis, J. Proakis, "A recursive modified Gram-Schmidt algorithm for
least-squares estimation", IEEE Trans. ASSP 34 (1986) 829; S. Gollamudi et al., "Set-membership
filtering and a set-membership normalized LMS algorithm", IEEE Signal Proc. Letters 5 (1998) 111.
"""

from collections.abc import Generator, Iterable
from typing import Final

WEIGHT_BITS: Final = 16

# 1/128 of the energy is forgotten with every sample: weights follow the last hundreds of samples.
_FORGET_BITS: Final = 7
# Gains are in 2**-30 of 1/16 of a step; they meet what is left over in 2**-20 of a step.
_GAIN_SHIFT: Final = 18
_STEP_SHIFT: Final = 34
# Prediction from which on weights are taken for broken, in 1/16 of a step: no field is that wide.
_BROKEN: Final = 1 << 32

# Innovations of which the square is less than this part of the energy move nothing, 2**-7: less
# than the mean, since the energy is the sum of about the last 128.
_SMALL_BITS: Final = _FORGET_BITS

LEAST_ENERGY: Final = 1 << 6
"""Energy to start with. Below that a quantity that stood still would throw its weights about when
it moves; forgetting stops above it."""

_LANE_BITS: Final = 96
_LANE: Final = 1 << _LANE_BITS - WEIGHT_BITS


class Shape:
    """Where the weights of so many quantities stand.

    Args:
        quantities: How many.
    """

    def __init__(self, quantities: int) -> None:
        self.quantities = quantities
        self.places = [_LANE_BITS * (quantities - 1 - k) for k in range(quantities)]
        """By quantity: the place of its lane, bits."""
        ones = [sum(1 << place for place in self.places[k + 1 :]) for k in range(quantities)]
        # By innovation, for the lanes of all quantities after it: half a lane, which makes every
        # lane positive; and the lowest bit of every lane.
        self.halves = [one << _LANE_BITS - 1 for one in ones]
        self._ones = ones
        # All of these lanes, and where the top one's prediction begins; behind the last is nothing.
        lanes = [(1 << place) - 1 for place in self.places]
        tops = [max(place - _LANE_BITS, 0) + WEIGHT_BITS for place in self.places]
        self.steps = list(zip(lanes, tops, strict=True))
        """What `Explained` needs of each quantity to predict the next."""
        self.moves = [
            # And what is left of every lane after a shift, and half of that.
            (each, half, one * ((1 << _LANE_BITS - _STEP_SHIFT) - 1), half >> _STEP_SHIFT)
            for each, half, one in zip(lanes, self.halves, ones, strict=True)
        ]
        """What it needs to move the weights of each innovation."""

    def packed(self, weights: list[list[int]]) -> list[int]:
        """Pack weights given by quantity, each with one for every quantity before it."""
        return [
            sum(weights[k][i] << self.places[k] for k in range(i + 1, self.quantities))
            for i in range(self.quantities)
        ]

    def carried_over(
        self, weights: list[int], learnt: list[int], start: list[int], *, in_full: bool
    ) -> list[int]:
        """Weights plus the way, or half the way, that others have come from their start."""
        moved = [
            weight + new - old for weight, new, old in zip(weights, learnt, start, strict=True)
        ]
        if in_full:
            return moved
        # As in `moved`: lanes are made positive, and what one loses must not reach the next.
        return [
            ((weight + other + half) >> 1 & (half - one)) - (half >> 1)
            for weight, other, half, one in zip(
                weights, moved, self.halves, self._ones, strict=True
            )
        ]

    def unpacked(self, weights: list[int]) -> list[list[int]]:
        """Give the weights by quantity, one for every quantity before it."""
        rows: list[list[int]] = [[] for _ in range(self.quantities)]
        for i, packed in enumerate(weights):
            for k in range(i + 1, self.quantities):
                lane = ((packed + self.halves[i]) >> self.places[k]) & (1 << _LANE_BITS) - 1
                rows[k].append(lane - (1 << _LANE_BITS - 1))
        return rows


def _predictions(
    shape: Shape,
    weights: list[int],
    quantities: list[int],
    innovations: list[int],
    stages: list[int],
    broken: list[int],
) -> Generator[int, int, None]:
    """Take quantities, give predictions of the next, and note what comes of them in the lists.

    A generator, since its variables need not be fetched and put back for every quantity; it knows
    of no object that knows of it, so that both are gone as soon as nobody needs them.
    """
    explained = prediction = 0
    quantity = yield prediction
    for weight, (lanes, top) in zip(weights, shape.steps, strict=True):
        quantities.append(quantity)
        innovation = quantity - prediction
        innovations.append(innovation)
        explained = explained + innovation * weight & lanes
        stages.append(explained)
        prediction = explained >> top
        if prediction >= _BROKEN:  # or a negative one
            prediction -= _LANE
            if prediction <= -_BROKEN:
                broken.append(prediction)
                prediction = 0
        quantity = yield prediction


class Explained:
    """The quantities of one sample, as far as they are known.

    Args:
        shape: How many there are.
        weights: Those of the reference, packed, one for each quantity.
        energies: Those of the reference, one for each quantity.

    Attributes:
        follow: Tells what the next quantity is; returns the one after it as this one and those
            before explain it, 0 behind the last.
    """

    __slots__ = (
        "_broken",
        "_energies",
        "_innovations",
        "_quantities",
        "_shape",
        "_stages",
        "_weights",
        "follow",
    )

    def __init__(self, shape: Shape, weights: list[int], energies: list[int]) -> None:
        self._shape = shape
        self._weights = weights
        self._energies = energies
        self._quantities: list[int] = []
        self._innovations: list[int] = []
        # What all innovations so far explain of the quantities to come, after each of them.
        self._stages: list[int] = []
        self._broken: list[int] = []
        predictions = _predictions(
            shape, weights, self._quantities, self._innovations, self._stages, self._broken
        )
        next(predictions)
        self.follow = predictions.send

    @property
    def is_broken(self) -> bool:
        """Whether a prediction was nonsense."""
        return bool(self._broken)

    def add(self, quantities: Iterable[int]) -> int:
        """Tell what the next quantities are, as `follow`."""
        prediction = 0
        for quantity in quantities:
            prediction = self.follow(quantity)
        return prediction

    def moved(self, trust: int) -> tuple[list[int], list[int]]:
        """Learn the sample, all of whose quantities must be known.

        Args:
            trust: How much the sample counts, 1…2**16.

        Returns:
            The weights and energies with it.
        """
        whole = 0
        for quantity in self._quantities:
            whole = (whole << _LANE_BITS) + quantity
        whole <<= WEIGHT_BITS
        weights, energies = [], []
        for weight, energy, innovation, stage, move in zip(
            self._weights,
            self._energies,
            self._innovations,
            self._stages,
            self._shape.moves,
            strict=True,
        ):
            kept = energy - (energy >> _FORGET_BITS)
            square = innovation * innovation
            if square < energy >> _SMALL_BITS:
                energies.append(kept + square)
                weights.append(weight)
                continue
            lanes, half, mask, shifted = move
            more = kept + (trust * square >> 16)
            energies.append(more)
            gain = (trust * innovation << _GAIN_SHIFT) // more
            left_over = (whole & lanes) - stage
            weights.append(weight + (gain * left_over + half >> _STEP_SHIFT & mask) - shifted)
            trust = trust * kept // more
        return weights, energies
