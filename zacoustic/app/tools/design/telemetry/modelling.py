"""A model from recordings, and whether it helps.

A model measured on its own training data always helps. So it is fitted to the first half of each
recording and measured on the second, which it has not seen; the returned model is then fitted to
everything.
"""

from collections.abc import Iterator, Sequence
from typing import Final

import msgspec

from zacoustic.app.tools.design.telemetry.exchange import Counters, counted, exchange, windows
from zacoustic.app.tools.design.telemetry.recording import Mission, Recordings
from zacoustic.config.model import ModelFile
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.dense import DenseCodec, DenseSample, Model, StreamPrior, fit
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.dense.model.adaptation import StreamState
from zacoustic.core.values.dense.stream.streamcodec import StreamCodec
from zacoustic.core.values.payload import PackedCodec
from zacoustic.core.values.types import TypeSpec
from zacoustic.errors import ConfigError

_LEAST_SAMPLES: Final = 4


class Cost(msgspec.Struct, frozen=True, kw_only=True):
    """The cost of samples without and with the model."""

    before: float
    """Without a model."""
    after: float
    """With the model."""

    @property
    def gain(self) -> float:
        """Saved share, below 1; negative: the model costs more."""
        return 1 - self.after / self.before if self.before else 0.0


class StreamFit(msgspec.Struct, frozen=True, kw_only=True):
    """One stream."""

    stream_id: int
    """1…175."""
    name: str
    """Name of the topic."""
    samples: int
    """Number of recorded samples."""
    measured: int
    """Number of measured samples."""
    packed_bits: float
    """Mean packed size, bits."""
    first_bits: Cost
    """Mean size of the first sample of a stream, bits."""
    next_bits: Cost
    """Mean size of a sample after the previous one, bits."""


class FitReport(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a fit."""

    streams: tuple[StreamFit, ...]
    """The streams by id."""
    window_s: float
    """Time whose samples share a frame, s."""
    alone_bytes: Cost
    """Mean size of an independent frame with all samples of such a window, bytes."""
    acknowledged_bytes: Cost
    """The same with references to acknowledged frames."""
    helps: bool
    """Whether these frames are smaller with the model, in total."""
    digest: str
    """Digest of the model, on which both ends must agree."""
    notes: tuple[str, ...]
    """Notes on the recordings."""


def fit_recordings(
    recordings: Recordings, table: StreamTable, *, window_s: float
) -> tuple[ModelFile, FitReport]:
    """Fit a model to recordings, and measure its benefit.

    Args:
        recordings: Recordings of the dense topics.
        table: The streams.
        window_s: Time whose samples usually share a frame, s.

    Raises:
        ConfigError: The recordings are too short to measure.
    """
    halves = [_halves(mission) for mission in recordings.missions]
    seconds = [second for _, second in halves if second.samples]
    if sum(len(mission.samples) for mission in seconds) < _LEAST_SAMPLES:
        raise ConfigError(
            f"{sum(len(each.samples) for each in recordings.missions)} samples of dense topics; "
            f"allowed: at least {2 * _LEAST_SAMPLES}"
        )
    model = _fit([first for first, _ in halves], window_s)
    streams = tuple(
        _stream_fit(stream_id, table.by_id(stream_id).name, recordings, seconds, model)
        for stream_id in sorted(recordings.counts)
        if any(stream_id == each for mission in seconds for _, each, _ in mission.samples)
    )
    alone = _frames(seconds, model, window_s, acknowledged=False)
    acknowledged = _frames(seconds, model, window_s, acknowledged=True)
    whole = _fit(recordings.missions, window_s)
    report = FitReport(
        streams=streams,
        window_s=window_s,
        alone_bytes=alone,
        acknowledged_bytes=acknowledged,
        helps=alone.after + acknowledged.after < alone.before + acknowledged.before,
        digest=whole.digest.hex(),
        notes=(*recordings.notes, *_untyped_notes(table)),
    )
    typical_bits = {str(each.stream_id): round(each.next_bits.after, 1) for each in streams}
    return ModelFile(model=whole, typical_bits=typical_bits), report


def _untyped_notes(table: StreamTable) -> Iterator[str]:
    """Yield a remark on dense streams without a type: a fit does not help them."""
    for stream in table:
        if stream.dense_type is not None and stream.type is None:
            yield (
                f"{stream.name}: dense but without a type, so nothing is fitted to it: its texts "
                "and bytes have the model that the package ships, with a fit as without"
            )


def _halves(mission: Mission) -> tuple[Mission, Mission]:
    middle = len(mission.samples) // 2
    first, second = mission.samples[:middle], mission.samples[middle:]
    return Mission(mission.types, first), Mission(mission.types, second)


def _fit(missions: Sequence[Mission], window_s: float) -> Model:
    return fit(((each.types, each.samples) for each in missions), window_s=window_s)


def _stream_fit(
    stream_id: int, name: str, recordings: Recordings, seconds: Sequence[Mission], model: Model
) -> StreamFit:
    prior = model.streams.get(str(stream_id))
    firsts: list[tuple[float, float]] = []
    nexts: list[tuple[float, float]] = []
    packed_bits = []
    for mission in seconds:
        values = [value for _, each, value in mission.samples if each == stream_id]
        if not values:
            continue
        type_spec = mission.types[stream_id]
        packed = PackedCodec(type_spec)
        packed_bits += [8 * len(packed.encode(value)) for value in values]
        before = _bits(stream_id, type_spec, values, None)
        after = _bits(stream_id, type_spec, values, prior)
        firsts += zip(before[0], after[0], strict=True)
        nexts += zip(before[1], after[1], strict=True)
    return StreamFit(
        stream_id=stream_id,
        name=name,
        samples=recordings.counts[stream_id].samples,
        measured=len(firsts),
        packed_bits=_mean(packed_bits),
        first_bits=_cost(firsts),
        next_bits=_cost(nexts),
    )


def _bits(
    stream_id: int, type_spec: TypeSpec, values: Sequence[object], prior: StreamPrior | None
) -> tuple[list[float], list[float]]:
    """Return the bits of each value alone, and after the previous one."""
    codec = StreamCodec(stream_id, type_spec, prior)
    # One writer for all values of a kind: separate ones would each round their bits down.
    alone, behind = _Meter(), _Meter()
    state: StreamState | None = None
    for value in values:
        parts = codec.split(value)
        first = codec.write(alone.writer, parts, None, 1, {})
        alone.note()
        if state is None:
            state = first
            continue
        state = codec.write(behind.writer, parts, state, 1, {})
        behind.note()
    return alone.bits, behind.bits


class _Meter:
    """A writer, and the cost of each sample in it."""

    def __init__(self) -> None:
        self.writer = Writer()
        self.bits: list[float] = []
        self._before = 0

    def note(self) -> None:
        self.bits.append(float(self.writer.bits - self._before))
        self._before = self.writer.bits


def _frames(
    missions: Sequence[Mission], model: Model, window_s: float, *, acknowledged: bool
) -> Cost:
    def mean_bytes(with_model: Model | None) -> float:
        tallies = [
            _exchange(mission, with_model, window_s, acknowledged=acknowledged)
            for mission in missions
        ]
        return _mean([size for counters in tallies for size in counters.sizes])

    return Cost(before=mean_bytes(None), after=mean_bytes(model))


def _exchange(
    mission: Mission, model: Model | None, window_s: float, *, acknowledged: bool
) -> Counters:
    groups: list[list[DenseSample]] = windows(counted(mission), window_s)
    codec = DenseCodec(mission.types, model=model)
    return exchange(codec, mission.types, groups, acknowledged=acknowledged)


def _cost(pairs: Sequence[tuple[float, float]]) -> Cost:
    return Cost(before=_mean([pair[0] for pair in pairs]), after=_mean([pair[1] for pair in pairs]))


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else 0.0
