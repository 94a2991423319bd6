"""What both ends know of a stream before its first sample: the fitted model, if any.

Both ends must agree on the model: `Model.digest` goes into the check of every frame. It holds
integers only; a file has it as JSON.
"""

import hashlib
from typing import Final

import msgspec

from zacoustic.core.values.dense.coder.curve import MOST_HOLD, MOST_LOG_SCALE, WIDTH_BITS
from zacoustic.core.values.dense.model.adaptation import SITUATIONS, Adaptation
from zacoustic.core.values.dense.model.leastsquares import LEAST_ENERGY
from zacoustic.core.values.dense.model.rowmodel import RowModel
from zacoustic.errors import ConfigError

LARGEST: Final = (1 << 40) - 1
"""Largest number in a model, with the exceptions below; more is damage."""
LARGEST_ENERGY: Final = 1 << 62
"""Largest energy: that of the widest numbers is the square of millions of steps."""
_CHANCE: Final = 1 << 16


class Companion(msgspec.Struct, frozen=True, kw_only=True, array_like=True):
    """A column that predicts another one: a depth for a pressure."""

    stream_id: int
    """Stream of the column; may be the stream itself."""
    column: int
    """Its index there; in the stream itself, a column that is coded earlier."""
    slope: int
    """Change per change of the predicting column, 2**-16."""
    offset: int
    """Value for 0 of the predicting column, 1/16 of a step."""
    scale: int
    """Mean error of that prediction, 2**-12 steps."""


class First(msgspec.Struct, frozen=True, kw_only=True, array_like=True):
    """A column of a sample without a reference."""

    center: int
    """Its expected value, 1/16 of a step."""
    scale: int
    """Mean error of that, 2**-12 steps; 0: every value is equally likely."""
    held: int = 0
    """Its most frequent value."""
    hold: int = 0
    """How often it has that value, 2**-16."""
    companion: Companion | None = None
    """The column that predicts it, if that one is known."""


class Learnt(msgspec.Struct, frozen=True, kw_only=True):
    """An `Adaptation` to start with."""

    weights: tuple[tuple[int, ...], ...]
    """By quantity, one for each earlier quantity, 2**-16."""
    energies: tuple[int, ...]
    """By quantity."""
    log_scales: tuple[int, ...]
    """By column, as in a `Manner`."""
    widths: tuple[int, ...]
    """By column, `SITUATIONS` of them each."""
    nearer: tuple[int, ...]
    """By column, as in a `Manner`."""
    holds: tuple[int, ...]
    """By column."""


class StreamPrior(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of a stream."""

    sizes: tuple[int, ...]
    """Number of values of each column of the type that it was fitted to."""
    firsts: tuple[First, ...] = ()
    """By column; empty: every value is equally likely."""
    steadiness: tuple[int, ...] = ()
    """How often a symbol stays unchanged, by column, 2**-16."""
    learnt: dict[str, Learnt] = {}
    """Adaptations by `step_class`, as text."""
    typical_bits: int = 0
    """Mean cost of a sample's integers given the sample before it, bits; 0: unknown."""
    lines: tuple[str, ...] = ()
    """Typical texts of the stream."""
    present: int = 0
    """How often a frame has samples of the stream, 2**-16; 0: unknown."""
    more: tuple[int, ...] = ()
    """How often another sample follows the first, second … of a frame, 2**-16."""


class Model(msgspec.Struct, frozen=True, kw_only=True, dict=True):
    """The priors of all streams."""

    streams: dict[str, StreamPrior] = {}
    """By stream id, as text."""
    single: int = 0
    """How often a frame is of one stream alone, 2**-16; 0: unknown."""

    @property
    def digest(self) -> bytes:
        """Four bytes that change with the model."""
        encoder = msgspec.json.Encoder(order="sorted")
        return hashlib.sha256(encoder.encode(self)).digest()[:4]


def check_prior(prior: StreamPrior, model: RowModel, stream_id: int) -> None:
    """Check that a prior was made for this stream and is within bounds.

    Raises:
        ConfigError: It is not; the message starts with the key in a model.
    """
    key = f"model.streams.{stream_id}"
    sizes = tuple(model.sizes)
    if prior.sizes != sizes:
        raise ConfigError(f"{key}: fitted to another type", hint="fit the model again")
    columns, quantities = len(sizes), model.shape.quantities
    for name, found, allowed in (
        ("firsts", len(prior.firsts), (0, columns)),
        ("steadiness", len(prior.steadiness), (0, columns)),
    ):
        if found not in allowed:
            raise ConfigError(f"{key}.{name}: {found} entries; allowed: {columns}")
    for place, learnt in prior.learnt.items():
        lengths = [len(each) for each in learnt.weights] == list(range(quantities))
        lists = (learnt.log_scales, learnt.nearer, learnt.holds)
        fits = (
            lengths
            and len(learnt.energies) == quantities
            and len(learnt.widths) == SITUATIONS * columns
            and all(len(each) == columns for each in lists)
        )
        if not fits:
            raise ConfigError(f"{key}.learnt.{place}: another number of entries than the type has")
        for numbers, least, most in (
            (learnt.energies, LEAST_ENERGY, LARGEST_ENERGY),
            (learnt.log_scales, 0, MOST_LOG_SCALE),
            (learnt.widths, 0, (1 << WIDTH_BITS) - 1),
            (learnt.nearer, 0, _CHANCE),
            (learnt.holds, 1, MOST_HOLD),  # 0 on a wide scale would divide by 0
        ):
            if not all(least <= number <= most for number in numbers):
                raise ConfigError(f"{key}.learnt.{place}: a number out of bounds")
        if not all(-LARGEST <= number <= LARGEST for row in learnt.weights for number in row):
            raise ConfigError(f"{key}.learnt.{place}.weights: a number out of bounds")
    for first in prior.firsts:
        if not 0 <= first.scale <= LARGEST or not 0 <= first.hold < _CHANCE:
            raise ConfigError(f"{key}.firsts: a number out of bounds")
    order = [*model.symbols, *model.numbers]
    for column, first in enumerate(prior.firsts):
        companion = first.companion
        if companion is None:
            continue
        known = order[: order.index(column)] if companion.stream_id == stream_id else None
        if known is not None and companion.column not in known:
            raise ConfigError(f"{key}.firsts[{column}].companion: a column that is coded later")
        numbers = (companion.column, companion.scale, abs(companion.slope), abs(companion.offset))
        if companion.scale < 1 or not all(0 <= number <= LARGEST for number in numbers):
            raise ConfigError(f"{key}.firsts[{column}].companion: a number out of bounds")
    chances = (*prior.steadiness, *prior.more, *((prior.present,) if prior.present else ()))
    if not all(0 < chance < _CHANCE for chance in chances):
        raise ConfigError(f"{key}: a chance out of bounds; allowed: 1..{_CHANCE - 1}")


def adaptations_of(prior: StreamPrior, model: RowModel) -> dict[int, Adaptation]:
    """Return the adaptations to start with."""
    return {
        int(place): Adaptation(
            weights=model.shape.packed([list(row) for row in learnt.weights]),
            energies=list(learnt.energies),
            manners=list(
                zip(
                    learnt.log_scales,
                    learnt.nearer,
                    learnt.holds,
                    strict=True,
                )
            ),
            widths=list(learnt.widths),
        )
        for place, learnt in prior.learnt.items()
    }
