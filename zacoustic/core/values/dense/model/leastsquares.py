"""Least squares that learn from every sample, for all fields of a sample at once, in integers.

The problem: the best guess of a field uses everything known by then: the vehicle's velocity, its
attitude, and the fields of the same sample that are coded before it. Which of these matter differs
from vehicle to vehicle and from hour to hour, so the weights must follow the data, equally at both
ends, and there is time for a few hundred multiplications.

The idea: put all quantities into one list, first those known beforehand, then the fields in coding
order, and subtract from each the part that the earlier ones explain (Gram and Schmidt). The
remainder of a quantity, its *innovation*, is uncorrelated to the earlier innovations, so the
weights of one do not change with those of another, and each is a division::

    innovation[k] = quantity[k] - Σ weight[k][i] · innovation[i]        over i < k

The sum is the prediction of quantity k from all before it. When a sample is known, each weight
moves towards explaining what was left over, by a share that is the innovation's energy in this
sample over its energy so far. This is recursive least squares in the form that rounding does not
disturb (modified Gram-Schmidt with error feedback), for the cost of one triangle for all fields.
Energies decay, so that weights can follow. An innovation smaller than usual says little about its
weights: it changes only its energy (set-membership filtering). That applies to half of the
innovations and loses a fifth of what could be learnt. A sample far from its prediction (a turn, a
fix after dead reckoning) is an exception more often than a rule, and is trusted less: otherwise
every turn spoils the weights of the long straight legs, which costs a tenth of all bits.

One row of weights at a time would cost a hundred multiplications; but everything that an innovation
explains is a multiple of it. So the weights *of* one innovation, for all quantities after it, are
packed into one long integer, 96 bits each, and one multiplication in Python does them all. The last
quantity is in the lowest bits: later innovations have fewer weights, and shorter integers. The
explained part of quantities that are known by then is cut off, so it becomes shorter as well, and
the next prediction is at its top.

Units: quantities and innovations in 1/16 of a step, weights in 2**-16, energies in 1/256 of a step
squared. Values that do not fit their 96 bits spill into their neighbours, equally at both ends: the
predictions are then nonsense, are recognised as such, and learning starts again.

Invariant: nothing is changed in place. A sample's weights are those of its reference, moved; the
reference's own weights stay, since the next sample may refer to it again.

Sources: F. Ling, D. Manolakis, J. Proakis, "A recursive modified Gram-Schmidt algorithm for
least-squares estimation", IEEE Trans. ASSP 34 (1986) 829; S. Gollamudi et al., "Set-membership
filtering and a set-membership normalized LMS algorithm", IEEE Signal Proc. Letters 5 (1998) 111.
"""

from collections.abc import Generator, Iterable
from typing import Final

WEIGHT_BITS: Final = 16

# 1/128 of the energy decays with every sample: weights follow the last hundreds of samples.
_FORGET_BITS: Final = 7
# Gains are in 2**-30 of 1/16 of a step; they multiply what is left over, in 2**-20 of a step.
_GAIN_SHIFT: Final = 18
_STEP_SHIFT: Final = 34
# A prediction from here on means broken weights, 1/16 of a step: no field is that wide.
_BROKEN: Final = 1 << 32

# Innovations whose square is below this part of the energy move nothing, 2**-7: that is less than
# the mean, since the energy is the sum of about the last 128.
_SMALL_BITS: Final = _FORGET_BITS

LEAST_ENERGY: Final = 1 << 6
"""Energy to start with. Below it, a quantity that stood still would move its weights wildly when it
moves; decay stops above it."""

_LANE_BITS: Final = 96
_LANE: Final = 1 << _LANE_BITS - WEIGHT_BITS


class Shape:
    """The positions of the weights of a number of quantities.

    Args:
        quantities: Number of quantities.
    """

    def __init__(self, quantities: int) -> None:
        self.quantities = quantities
        self.places = [_LANE_BITS * (quantities - 1 - k) for k in range(quantities)]
        """The position of each quantity's lane, bits."""
        ones = [sum(1 << place for place in self.places[k + 1 :]) for k in range(quantities)]
        # By innovation, for the lanes of all quantities after it: half a lane, which makes every
        # lane positive; and the lowest bit of every lane.
        self.halves = [one << _LANE_BITS - 1 for one in ones]
        self._ones = ones
        # All of these lanes, and the position of the top lane's prediction; the last one has none.
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
        """Pack weights given by quantity; each quantity has one weight for every earlier one."""
        return [
            sum(weights[k][i] << self.places[k] for k in range(i + 1, self.quantities))
            for i in range(self.quantities)
        ]

    def carried_over(
        self, weights: list[int], learnt: list[int], start: list[int], *, in_full: bool
    ) -> list[int]:
        """Return weights plus what others have learnt since their start, or half of that."""
        moved = [
            weight + new - old for weight, new, old in zip(weights, learnt, start, strict=True)
        ]
        if in_full:
            return moved
        # As in `moved`: lanes are made positive, and a lane's loss must not reach the next.
        return [
            ((weight + other + half) >> 1 & (half - one)) - (half >> 1)
            for weight, other, half, one in zip(
                weights, moved, self.halves, self._ones, strict=True
            )
        ]

    def unpacked(self, weights: list[int]) -> list[list[int]]:
        """Return the weights by quantity, one for every earlier quantity."""
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
    """Take quantities, yield predictions of the next, and record intermediate values in the lists.

    It is a generator, since its variables then need not be loaded and stored for every quantity; it
    refers to no object that refers to it, so that both are freed as soon as they are unused.
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
        shape: The shape of the weights.
        weights: The reference's weights, packed, one for each quantity.
        energies: The reference's energies, one for each quantity.

    Attributes:
        follow: Takes the next quantity; returns the prediction of the one after it, 0 after the
            last.
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
        # What all innovations so far explain of later quantities, after each innovation.
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
        """Take the next quantities; otherwise like `follow`."""
        prediction = 0
        for quantity in quantities:
            prediction = self.follow(quantity)
        return prediction

    def moved(self, trust: int) -> tuple[list[int], list[int]]:
        """Learn the sample, all of whose quantities must be known.

        Args:
            trust: How much the sample counts, 1…2**16.

        Returns:
            The weights and energies after it.
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
