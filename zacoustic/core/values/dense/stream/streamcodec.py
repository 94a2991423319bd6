"""The samples of one stream as symbols: against a reference, by the model alone, or plainly.

A sample is usually coded against its reference. Without one, the model predicts it; if neither
helps (a jump, a value never seen), all values have equal shares, which bounds the cost of a sample
to that of `packed` and a few bits. The choice among the three costs a fraction of a bit; the writer
tries the next one when one was expensive.
"""

import math
from typing import Any, Final

from zacoustic.core.values.dense.coder.arithmetic import Coder
from zacoustic.core.values.dense.coder.curve import LARGEST_SIZE, MOST_HOLD, POINT_BITS, Curve
from zacoustic.core.values.dense.coder.shares import ends_of
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.dense.model.adaptation import StreamState
from zacoustic.core.values.dense.model.layout import Layout, Row
from zacoustic.core.values.dense.model.prior import First, StreamPrior, adaptations_of, check_prior
from zacoustic.core.values.dense.model.rowmodel import START_STEADY, RowModel, TooFarError
from zacoustic.core.values.dense.stream.restcodec import RestCodec, plain_bits
from zacoustic.core.values.types import OutsideValues, TypeSpec

_AGAINST, _FIRST, _PLAIN = 0, 1, 2
_ALL_WAYS: Final = (_AGAINST, _FIRST, _PLAIN)
# Shares of the three ways with a reference, and of the last two without one.
_WAYS: Final = ends_of(60, 3, 1)
_WAYS_ALONE: Final = ends_of(3, 1)
_DEAR_BITS: Final = 2  # another way is tried if one costs this much more than plainly

Beside = dict[int, Row]
"""Rows of other streams that both ends know, by stream id."""


class StreamCodec:
    """Writes and reads samples of a stream.

    Args:
        stream_id: The stream's id.
        type_spec: Its type, resolved.
        prior: Its fitted model.

    Raises:
        ConfigError: The prior is for another type.
    """

    def __init__(
        self, stream_id: int, type_spec: TypeSpec, prior: StreamPrior | None = None
    ) -> None:
        self.stream_id = stream_id
        self.type_spec = type_spec
        self.outside = OutsideValues(type_spec)
        """How many values were cut, clamped or escaped so far."""
        self.layout = Layout(type_spec)
        self.model = RowModel(self.layout.columns)
        self.prior = prior
        if prior is not None:
            check_prior(prior, self.model, stream_id)
        if prior is not None:
            self.model.priors = adaptations_of(prior, self.model)
        columns = len(self.layout.columns)
        self._steadiness = list(prior.steadiness) if prior is not None else []
        self._steadiness = self._steadiness or [START_STEADY] * columns
        self._rest = RestCodec(self.layout.remainders, () if prior is None else prior.lines)
        self._widths = [math.ceil(math.log2(size)) for size in self.model.sizes]
        self._is_guarded = any(column.guard is not None for column in self.layout.columns)
        self._no_row: Row = [None] * columns
        self._no_rest: list[Any] = [None] * len(self.layout.remainders)
        # The plain cost of a row without missing columns, bits.
        self.plain_bits = sum(self._widths)

    def split(self, value: object) -> tuple[Row, list[Any]]:
        """Split an application's value into row and rest.

        Raises:
            PayloadInvalidError: It is not of the stream's type.
        """
        row = self.layout.take(value)
        if row is not None:
            return row, []
        return self.layout.split(self.outside.normalised(value))

    def write(
        self,
        coder: Writer,
        parts: tuple[Row, list[Any]],
        reference: StreamState | None,
        steps: int,
        beside: Beside,
    ) -> StreamState:
        """Write a sample in the shortest way; return its state."""
        row, rest = parts
        before = coder.mark()
        limit = coder.bits + _DEAR_BITS
        limit += self._plain_bits(row) if self._is_guarded else self.plain_bits
        if rest:
            limit += plain_bits(rest)
        best, fewest = _PLAIN, 1 << 60
        for way in _ALL_WAYS if reference is not None else _ALL_WAYS[1:]:
            try:
                state = self._code(coder, way, row, rest, reference, steps, beside)
            except TooFarError:
                pass
            else:
                bits = coder.bits
                if bits <= limit:
                    return state
                if bits < fewest:
                    best, fewest = way, bits
            coder.rewind(before)
        return self._code(coder, best, row, rest, reference, steps, beside)

    def read(
        self, coder: Coder, reference: StreamState | None, steps: int, beside: Beside
    ) -> tuple[dict[str, Any], StreamState]:
        """Read a sample; return its value and its state.

        Raises:
            PayloadError: There is none.
        """
        row, rest = self._no_row[:], self._no_rest[:]
        state = self._code(coder, 0, row, rest, reference, steps, beside)
        return self.layout.join(row, rest), state

    def _plain_bits(self, row: Row) -> int:
        """Return the plain cost of a row, bits."""
        return sum(
            width for width, count in zip(self._widths, row, strict=True) if count is not None
        )

    def _code(
        self,
        coder: Coder,
        way: int,
        row: Row,
        rest: list[Any],
        reference: StreamState | None,
        steps: int,
        beside: Beside,
    ) -> StreamState:
        """Write or read a sample in one way; a reader finds out which."""
        if reference is not None:
            way = coder.pick(_WAYS, way)
            if way == _AGAINST:
                state = self.model.code(coder, row, reference, steps)
                if rest:
                    state.rest = self._rest.code(coder, row, rest, state.rest, plainly=False)
                return state
        else:
            way = 1 + coder.pick(_WAYS_ALONE, way - 1)
        if way == _FIRST and self.prior is not None and self.prior.firsts:
            self._code_first(coder, row, self.prior.firsts, beside)
        else:
            self.model.code_plainly(coder, row)
        known = row if reference is None else reference.row
        known_rest = self._no_rest if reference is None else reference.rest
        return StreamState(
            row=[old if new is None else new for new, old in zip(row, known, strict=True)],
            velocity=None if reference is None else self.model.strides(row, reference.row, steps),
            rest=self._rest.code(coder, row, rest, known_rest, plainly=way == _PLAIN),
            adaptations=self.model.priors if reference is None else reference.adaptations,
            steadiness=self._steadiness if reference is None else reference.steadiness,
        )

    def _code_first(
        self, coder: Coder, row: Row, firsts: tuple[First, ...], beside: Beside
    ) -> None:
        """Write or read a row as the model predicts it."""
        model = self.model
        for n in (*model.symbols, *model.numbers):
            guard = model.columns[n].guard
            if guard is not None and row[guard[0]] != guard[1]:
                continue
            first, size = firsts[n], model.sizes[n]
            center, scale = first.center, first.scale
            companion = first.companion
            if companion is not None:
                own = companion.stream_id == self.stream_id
                other_row = row if own else beside.get(companion.stream_id, ())
                other = other_row[companion.column] if companion.column < len(other_row) else None
                if other is not None:
                    center = companion.offset + (other * companion.slope >> 16 - POINT_BITS)
                    scale = companion.scale
            if scale and size > 1:
                center = min(max(center, -size << POINT_BITS), size << POINT_BITS + 1)
                row[n] = _code_around(coder, center, scale, first, size, row[n] or 0)
            elif size > 1 and coder.flag(max(first.hold, 1), row[n] == first.held % size):
                row[n] = first.held % size
            else:
                row[n] = coder.uniform(size, row[n] or 0)


def _code_around(coder: Coder, center: int, scale: int, first: First, size: int, value: int) -> int:
    """Write or read a number around a center; one of many values by its distance from there."""
    least = 0
    span = size
    if size > LARGEST_SIZE:
        span = LARGEST_SIZE
        least = min(max((center >> POINT_BITS) - (span >> 1), 0), size - span)
        if not coder.is_reader and not least <= value < least + span:
            raise TooFarError
    curve = Curve(
        span, center - (least << POINT_BITS), scale, first.held - least, min(first.hold, MOST_HOLD)
    )
    return coder.number(curve, value - least) + least
