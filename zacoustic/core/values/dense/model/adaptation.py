"""What both ends have learnt of a stream up to a sample.

A state belongs to a sample, not to a connection: it follows from the sample's reference, the state
there and the sample itself. Both ends have the state when both have the sample, so it cannot
diverge, whatever is lost, repeated or late. States share what did not change and are never changed
in place.

The distance from a sample to its reference changes what can be predicted: the noise of a sensor
does not depend on the distance, the way travelled does. So distances of about the same length have
an `Adaptation` of their own, and a reference of unknown velocity has another one. The first time a
distance occurs, its adaptation starts as a copy of the nearest one that has learnt something.
"""

from typing import Any, Final

from zacoustic.core.values.dense.coder.curve import NARROWER, SCALE_BITS, log_scale

RESTING: Final = 0
"""The adaptation for references of unknown velocity."""

LONGEST_STEPS: Final = 16
"""Steps from the reference are counted up to this."""

SITUATIONS: Final = 16
"""How many situations are distinguished; see `zacoustic.core.values.dense.model.rowmodel`."""

# Adaptations by steps: 1, 2, 3, 4…5, 6…8, 9…15, 16 and more.
_CLASSES: Final = (RESTING, 1, 2, 3, 4, 4, 5, 5, 5, 6, 6, 6, 6, 6, 6, 6, 7)

# The scale of an unknown field: a 64th of its number of values, at most this many steps. Too wide
# costs bits once, too narrow costs more.
_WIDEST_START: Final = 16
_START_PART: Final = 64

_START_ENERGY: Final = 1 << 8  # one step, squared
_START_HOLD: Final = 1 << 10  # 1/64
_START_NEARER: Final = 1 << 15


def step_class(steps: int, *, moving: bool) -> int:
    """Return the adaptation class of a sample that is this many steps, ≥ 1, from its reference."""
    return _CLASSES[min(steps, LONGEST_STEPS)] if moving else RESTING


Manner = tuple[int, int, int]
"""How a column behaves:

- its scale: the logarithm of the mean prediction error, see
  `zacoustic.core.values.dense.coder.curve`;
- how often the weights predict better than "unchanged" does, 2**-16;
- how often it stays unchanged, 2**-16.
"""


class Adaptation:
    """What was learnt of samples at one distance from their reference.

    Attributes:
        weights: For all quantities, packed, see `zacoustic.core.values.dense.model.leastsquares`.
        energies: For all quantities.
        manners: By column.
        widths: How much wider than its scale the curve is, as a logarithm plus `NARROWER`: for each
            column `SITUATIONS` of them.
    """

    __slots__ = ("energies", "manners", "weights", "widths")

    def __init__(
        self, weights: list[int], energies: list[int], manners: list[Manner], widths: list[int]
    ) -> None:
        self.weights = weights
        self.energies = energies
        self.manners = manners
        self.widths = widths


def new_adaptation(sizes: list[int], quantities: int) -> Adaptation:
    """Make the adaptation before anything is learnt.

    Args:
        sizes: Number of values of each column.
        quantities: Number of quantities, see `zacoustic.core.values.dense.model.rowmodel`.
    """
    scales = [
        log_scale(min(_WIDEST_START, 1 + size // _START_PART) << SCALE_BITS) for size in sizes
    ]
    return Adaptation(
        weights=[0] * quantities,
        energies=[_START_ENERGY] * quantities,
        manners=[(scale, _START_NEARER, _START_HOLD) for scale in scales],
        widths=[NARROWER] * (SITUATIONS * len(sizes)),
    )


class StreamState:
    """A sample, and what was learnt up to it.

    Attributes:
        row: Its integers; for a missing column, its last value; None: it never had one.
        velocity: Change per step, by column, 1/16 of a step of the field; None: unknown.
        rest: The rest of the sample.
        adaptations: By `step_class`.
        steadiness: How often a symbol stays unchanged, by column, 2**-16.
    """

    __slots__ = ("adaptations", "rest", "row", "steadiness", "velocity")

    def __init__(
        self,
        row: list[int | None],
        velocity: list[int] | None,
        rest: list[Any],
        adaptations: dict[int, Adaptation],
        steadiness: list[int],
    ) -> None:
        self.row = row
        self.velocity = velocity
        self.rest = rest
        self.adaptations = adaptations
        self.steadiness = steadiness


def nearest(adaptations: dict[int, Adaptation], wanted: int) -> Adaptation | None:
    """Return the adaptation for a class, or for the nearest class that has one; None: none."""
    found = adaptations.get(wanted)
    if found is not None or not adaptations:
        return found
    return adaptations[min(adaptations, key=lambda known: (abs(known - wanted), known))]
