"""What one end has learnt of a stream up to a sample, and the other end with it.

A state belongs to a sample, not to a connection: it follows from the sample that it was coded
against, the state there and the sample itself. Both ends hold it when both hold the sample, so it
cannot drift apart, whatever is lost, repeated or late. States share what did not change and are
never changed in place.

How far a sample lies behind its reference changes what can be said of it: the noise of a sensor is
the same whatever the distance, the way made is not. So distances of about the same length have an
`Adaptation` of their own, and a reference whose velocity is not known has another one. The first
time a distance occurs, its adaptation starts as a copy of the nearest that has learnt something.
"""

from typing import Any, Final

from zacoustic.core.values.dense.coder.curve import NARROWER, SCALE_BITS, log_scale

RESTING: Final = 0
"""The adaptation for references whose velocity is not known."""

LONGEST_STEPS: Final = 16
"""Steps behind the reference are counted up to this."""

SITUATIONS: Final = 16
"""How many situations are told apart, see `zacoustic.core.values.dense.model.rowmodel`."""

# Adaptations by steps: 1, 2, 3, 4…5, 6…8, 9…15, 16 and more.
_CLASSES: Final = (RESTING, 1, 2, 3, 4, 4, 5, 5, 5, 6, 6, 6, 6, 6, 6, 6, 7)

# The scale of a field of which nothing is known: as wide as a 64th of its values, at most this many
# steps. Too wide costs bits once, too narrow costs more.
_WIDEST_START: Final = 16
_START_PART: Final = 64

_START_ENERGY: Final = 1 << 8  # one step, squared
_START_HOLD: Final = 1 << 10  # 1/64
_START_NEARER: Final = 1 << 15


def step_class(steps: int, *, moving: bool) -> int:
    """Return which adaptation is for a sample that many steps, ≥ 1, behind its reference."""
    return _CLASSES[min(steps, LONGEST_STEPS)] if moving else RESTING


Manner = tuple[int, int, int]
"""How a column behaves:

- its scale: the logarithm of the mean miss of what was predicted, see
  `zacoustic.core.values.dense.coder.curve`;
- how often what the weights predict is nearer than that it stays, 2**-16;
- how often it stays as it was, 2**-16.
"""


class Adaptation:
    """What was learnt of samples at one distance from their reference.

    Attributes:
        weights: Of all quantities, packed, see `zacoustic.core.values.dense.model.leastsquares`.
        energies: Of all quantities.
        manners: By column.
        widths: How much wider than its scale, as a logarithm, `NARROWER` added: for each column
            `SITUATIONS` of them.
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
    """Make the adaptation of who knows nothing.

    Args:
        sizes: Of all columns.
        quantities: How many, see `zacoustic.core.values.dense.model.rowmodel`.
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
        row: Its integers; where a column was not there, the last that was; None: none ever was.
        velocity: Change a step, by column, 1/16 of a step of the field; None: not known.
        rest: The rest of the sample.
        adaptations: By `step_class`.
        steadiness: How often a symbol stays as it was, by column, 2**-16.
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
    """Return the adaptation for a class, or for the class nearest to it; None: there is none."""
    found = adaptations.get(wanted)
    if found is not None or not adaptations:
        return found
    return adaptations[min(adaptations, key=lambda known: (abs(known - wanted), known))]
