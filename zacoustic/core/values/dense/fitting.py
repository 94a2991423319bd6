"""A model from recordings: where learning starts when nothing else is known.

A fit provides at once what online learning finds out in the first minutes of every mission: the
mean of what was learnt along the recording, at each distance from the reference; where the first
sample of a frame lies, and which other column predicts it; the usual texts; the usual contents of
frames. A fit never replaces learning: it sets where learning starts, since models that are only
fitted do worse than plain coders on half of all real logs.

Means, not last values: the weights at the end of a recording are those of its last minutes.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any, Final

from zacoustic.core.values.dense.coder.curve import (
    MOST_HOLD,
    MOST_LOG_SCALE,
    OCTAVE,
    POINT_BITS,
    SCALE_BITS,
)
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.dense.model.adaptation import (
    RESTING,
    Adaptation,
    StreamState,
    step_class,
)
from zacoustic.core.values.dense.model.layout import Content, Layout, Row
from zacoustic.core.values.dense.model.leastsquares import LEAST_ENERGY
from zacoustic.core.values.dense.model.prior import (
    LARGEST,
    LARGEST_ENERGY,
    Companion,
    First,
    Learnt,
    Model,
    StreamPrior,
)
from zacoustic.core.values.dense.model.rowmodel import START_STEADY, RowModel, TooFarError
from zacoustic.core.values.types import OutsideValues, TypeSpec
from zacoustic.errors import ConfigError

Recording = Sequence[tuple[float, int, Any]]
"""Time in seconds, stream id, value; in the order of time."""

Mission = tuple[Mapping[int, TypeSpec], Recording]
"""The type of each dense stream by stream id, and the recording of these and other streams."""

# Distances to the reference that stand for their class, steps.
_STEPS: Final = (1, 2, 3, 5, 7, 12, 16)
# Energies are divided by this, so that the first dozen samples of a mission can move the weights.
_RESTLESS: Final = 8
# Scales are widened by this, 3/16 octave: too narrow a start costs more than too wide a one.
_WIDER_START: Final = 3 * OCTAVE >> 4
_LEAST_ROWS: Final = 64
_MOST_ROWS: Final = 4000
_MOST_TEXT_BYTES: Final = 24000
_UNUSUAL: Final = 1 << 13  # 1/8: a frame that holds something else costs 3 bits a stream
_FEW: Final = 8
_OFTEN: Final = 7 << 13
_WORTH: Final = 4  # a companion must leave at most this part of the scale
_WIDER: Final = 3, 2  # missions differ from each other by more than one differs from itself


def fit(missions: Iterable[Mission], *, window_s: float = 10.0) -> Model:
    """Make a model of the recordings of one or more missions.

    Args:
        missions: Missions of one kind, each by itself. Their types may differ in where a range
            begins (the place of a mission), but not in how many values it has.
        window_s: Time whose samples usually share a frame, s.

    Raises:
        ConfigError: The types of a stream differ.
        PayloadInvalidError: A value is not of its stream's type.
    """
    fitting: dict[int, _StreamFitting] = {}
    single = several = 0
    for types, recording in missions:
        layouts = {stream_id: Layout(type_spec) for stream_id, type_spec in types.items()}
        outsides = {stream_id: OutsideValues(type_spec) for stream_id, type_spec in types.items()}
        for stream_id, layout in layouts.items():
            stream = fitting.setdefault(stream_id, _StreamFitting(layout))
            if [each.size for each in layout.columns] != stream.model.sizes:
                raise ConfigError(f"stream {stream_id}: types differ between the missions")
        rows: dict[int, list[Row]] = {stream_id: [] for stream_id in layouts}
        latest: dict[int, Row] = {}
        windows: dict[int, Counter[int]] = {}
        for at_s, stream_id, value in recording:
            if stream_id not in layouts:
                continue
            within = outsides[stream_id].normalised(value)
            parts = layouts[stream_id].split(within)
            fitting[stream_id].add(*parts, latest, stream_id)
            latest[stream_id] = parts[0]
            rows[stream_id].append(parts[0])
            windows.setdefault(int(at_s // window_s), Counter())[stream_id] += 1
        single += sum(1 for each in windows.values() if len(each) == 1)
        several += sum(1 for each in windows.values() if len(each) > 1)
        for stream_id in layouts:
            stream = fitting[stream_id]
            stream.runs.append(rows[stream_id])
            stream.windows.extend(each.get(stream_id, 0) for each in windows.values())
    return Model(
        streams={
            str(stream_id): stream.prior(stream_id)
            for stream_id, stream in sorted(fitting.items())
            if any(stream.runs)
        },
        single=_usual(single, single + several),
    )


class _StreamFitting:
    """The data collected for one stream."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.model = RowModel(layout.columns)
        self.runs: list[list[Row]] = []
        self.windows: list[int] = []
        self._bits: list[int] = []
        self._texts: Counter[str] = Counter()
        # For companions: each row with the latest rows of the streams earlier in a frame.
        self._beside: list[tuple[Row, dict[int, Row]]] = []

    def add(self, row: Row, rest: list[Any], latest: Mapping[int, Row], stream_id: int) -> None:
        for remainder, part in zip(self.layout.remainders, rest, strict=True):
            if remainder.content is Content.TEXT and part is not None:
                self._texts[part] += 1
        earlier = {other: each for other, each in latest.items() if other < stream_id}
        self._beside.append((row, earlier))

    def prior(self, stream_id: int) -> StreamPrior:
        count = len(self._beside)
        present = sum(1 for each in self.windows if each)
        learnt = self._learnt() if count >= _LEAST_ROWS else {}
        return StreamPrior(
            sizes=tuple(self.model.sizes),
            firsts=tuple(self._first(n, stream_id) for n in range(len(self.model.sizes))),
            steadiness=tuple(self._steadiness(n) for n in range(len(self.model.sizes))),
            learnt=learnt,
            typical_bits=sum(self._bits) // max(len(self._bits), 1),
            lines=self._lines(),
            present=_usual(present, len(self.windows)),
            more=tuple(
                _usual(
                    sum(1 for each in self.windows if each > samples),
                    sum(1 for each in self.windows if each >= samples),
                )
                for samples in range(1, 13)
            ),
        )

    def _lines(self) -> tuple[str, ...]:
        lines: list[str] = []
        left = _MOST_TEXT_BYTES
        for text, count in self._texts.most_common():
            for _ in range(count):
                left -= len(text)
                if left < 0:
                    return tuple(lines)
                lines.append(text)
        return tuple(lines)

    def _steadiness(self, n: int) -> int:
        if self.model.columns[n].is_ordered:
            return START_STEADY
        pairs = [(old[n], new[n]) for run in self.runs for old, new in pairwise(run)]
        return _chance(sum(1 for old, new in pairs if old == new), len(pairs))

    def _first(self, n: int, stream_id: int) -> First:
        column = self.model.columns[n]
        values = sorted(value for row, _ in self._beside if (value := row[n]) is not None)
        if not values:
            return First(center=0, scale=0)
        held, often = Counter(values).most_common(1)[0]
        hold = min(_chance(often, len(values)), MOST_HOLD)
        if hold < 1 << 13:
            hold = 0
        if not column.is_ordered or column.wraps:
            return First(center=0, scale=0, held=held, hold=hold)
        others = [value for value in values if value != held or not hold] or values
        center = others[len(others) // 2]
        scale = min(_mean_distance(others, center) * _WIDER[0] // _WIDER[1], LARGEST)
        return First(
            center=center << POINT_BITS,
            scale=scale,
            held=held,
            hold=hold,
            companion=self._companion(n, stream_id, scale),
        )

    def _companion(self, n: int, stream_id: int, scale: int) -> Companion | None:
        """Return the column that predicts this one best, if one is worth it."""
        order = [*self.model.symbols, *self.model.numbers]
        candidates = [
            (stream_id, other)
            for other in order[: order.index(n)]
            if self.model.columns[other].is_ordered and not self.model.columns[other].wraps
        ]
        beside = {
            (other_id, column)
            for _, latest in self._beside[-200:]
            for other_id, row in latest.items()
            for column in range(len(row))
        }
        best: Companion | None = None
        for other_id, column in [*candidates, *sorted(beside)]:
            pairs = [
                (other, own)
                for row, latest in self._beside
                if (own := row[n]) is not None
                and (source := row if other_id == stream_id else latest.get(other_id)) is not None
                and (other := source[column]) is not None
            ]
            if len(pairs) < _LEAST_ROWS:
                continue
            slope, offset = _line(pairs)
            left = [own * 16 - offset - (other * slope >> 12) for other, own in pairs]
            miss = (sum(abs(each) for each in left) << SCALE_BITS - POINT_BITS) // len(left)
            miss = max(miss, 1 << SCALE_BITS - 1) * _WIDER[0] // _WIDER[1]
            if max(miss, abs(slope), abs(offset)) > LARGEST:
                continue
            if miss * _WORTH < (best.scale * _WORTH if best is not None else scale):
                best = Companion(
                    stream_id=other_id, column=column, slope=slope, offset=offset, scale=miss
                )
        return best

    def _learnt(self) -> dict[str, Learnt]:
        found = {}
        for steps in _STEPS:
            mean = self._run(steps, moving=True)
            if mean is not None:
                found[str(step_class(steps, moving=True))] = mean
        mean = self._run(1, moving=False)
        if mean is not None:
            found[str(RESTING)] = mean
        return found

    def _run(self, steps: int, *, moving: bool) -> Learnt | None:
        """Return the mean of what is learnt along all runs, at one distance."""
        model = self.model
        place = step_class(steps, moving=moving)
        mean = _Mean(model)
        adaptations: dict[int, Adaptation] = {}
        for run in self.runs:
            states: list[StreamState] = []
            for row in run[:_MOST_ROWS]:
                velocity = [0] * len(row) if moving else None
                fresh = StreamState(list(row), velocity, [], adaptations, [START_STEADY] * len(row))
                if len(states) < steps:
                    states.append(fresh)
                    continue
                reference = states[-steps]
                if not moving:
                    reference = StreamState(
                        reference.row, None, [], adaptations, reference.steadiness
                    )
                else:
                    reference = StreamState(
                        reference.row, reference.velocity, [], adaptations, reference.steadiness
                    )
                writer = Writer()
                try:
                    state = model.code(writer, list(row), reference, steps)
                except TooFarError:
                    if moving:
                        fresh.velocity = model.strides(row, reference.row, steps) or velocity
                    states.append(fresh)
                    continue
                adaptations = {place: state.adaptations[place]}
                mean.add(adaptations[place])
                if steps == 1 and moving:
                    self._bits.append(writer.bits)
                states.append(state)
                states = states[-steps:]
        return mean.learnt() if mean.count >= _LEAST_ROWS else None


class _Mean:
    """The mean of adaptations over a recording, each sample counting the same."""

    _WARM: Final = 32  # samples that are left out: the weights start from nothing

    def __init__(self, model: RowModel) -> None:
        self._model = model
        self.count = -self._WARM
        self._weights = [[0] * row for row in range(model.shape.quantities)]
        names = ("energies", "log_scales", "widths", "nearer", "holds")
        self._sums: dict[str, list[int]] = {name: [] for name in names}

    def add(self, adaptation: Adaptation) -> None:
        self.count += 1
        if self.count <= 0:
            return
        for row, more in zip(
            self._weights, self._model.shape.unpacked(adaptation.weights), strict=True
        ):
            for place, weight in enumerate(more):
                row[place] += weight
        log_scales, nearer, holds = (
            [manner[part] for manner in adaptation.manners] for part in range(3)
        )
        lists = {
            "energies": adaptation.energies,
            "log_scales": log_scales,
            "widths": adaptation.widths,
            "nearer": nearer,
            "holds": holds,
        }
        for name, sums in self._sums.items():
            values = lists[name]
            self._sums[name] = (
                [a + b for a, b in zip(sums, values, strict=True)] if sums else list(values)
            )

    def learnt(self) -> Learnt:
        count = self.count
        means = {name: tuple(each // count for each in sums) for name, sums in self._sums.items()}
        means["log_scales"] = tuple(
            min(each + _WIDER_START, MOST_LOG_SCALE) for each in means["log_scales"]
        )
        means["energies"] = tuple(
            min(max(each // _RESTLESS, LEAST_ENERGY), LARGEST_ENERGY) for each in means["energies"]
        )
        return Learnt(
            weights=tuple(
                tuple(min(max(weight // count, -LARGEST), LARGEST) for weight in row)
                for row in self._weights
            ),
            **means,
        )


def _usual(often: int, of: int) -> int:
    """Return a probability in 2**-16 that leaves room for frames of another kind."""
    if of < _FEW:  # more samples than any window had: then frames are being filled
        return _OFTEN
    return max(_UNUSUAL, min((1 << 16) - _UNUSUAL, _chance(often, of)))


def _chance(often: int, of: int) -> int:
    """Return a probability in 2**-16, away from 0 and 1."""
    return max(1 << 9, min((1 << 16) - (1 << 9), ((2 * often + 1) << 16) // (2 * of + 2)))


def _mean_distance(values: Sequence[int], center: int) -> int:
    """Return the mean distance from a center, 2**-12 steps, at least half a step."""
    total = sum(abs(value - center) for value in values)
    return max((total << SCALE_BITS) // len(values), 1 << SCALE_BITS - 1)


def _line(pairs: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Return slope in 2**-16 and offset in 1/16 of the line through pairs of integers."""
    count = len(pairs)
    sum_x, sum_y = sum(x for x, _ in pairs), sum(y for _, y in pairs)
    spread = count * sum(x * x for x, _ in pairs) - sum_x * sum_x
    together = count * sum(x * y for x, y in pairs) - sum_x * sum_y
    slope = (together << 16) // spread if spread else 0
    limit = 1 << 32
    slope = max(-limit, min(limit, slope))
    return slope, (16 * sum_y - (slope * sum_x >> 12)) // count
