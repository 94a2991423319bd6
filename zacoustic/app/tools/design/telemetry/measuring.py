"""The bytes of every codec on recorded telemetry, with each frame decoded and compared.

A frame is counted that carries one sample alone, on a link that frames, addresses and checks by
itself: for records the stream id, the number of a reliable topic, the age and the payload; for
dense blocks everything from the marker to the check. In addition: all samples that a vehicle
publishes in some seconds, in one frame.
"""

from collections.abc import Callable, Sequence
from typing import Any, Final

import msgspec

from zacoustic.app.tools.crossing import crosses_in_parts, room_bytes
from zacoustic.app.tools.design.telemetry.exchange import counted, exchange, windows
from zacoustic.app.tools.design.telemetry.recording import Mission, Recordings
from zacoustic.app.tools.design.telemetry.values import is_right
from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.core.base.qos import Reliability, Stamp
from zacoustic.core.streams.table import AGE_FIELD, Stream, StreamTable
from zacoustic.core.values.dense import DenseCodec, DenseSample, Model
from zacoustic.core.values.encoding import CBOR, JSON, decode_application, encode_application
from zacoustic.core.values.payload import CborCodec, PackedCodec, PayloadError
from zacoustic.core.values.types import TypeSpec
from zacoustic.core.wire.frame import DELIMITER_BYTES
from zacoustic.core.wire.numbers import NUMBER_BYTES
from zacoustic.errors import PayloadInvalidError

LOSSES: Final = (0.0, 0.1, 0.3)
"""Shares of lost frames and acknowledgements."""

RECORDS: Final = ("json", "cbor_map", "cbor", "packed")
"""Codecs of values in records, by name."""


_OPEN_ENDED: Final = ("json", "cbor_map")  # opaque bytes on the wire

Sizes = dict[str, int]
"""Bytes of a record, by `RECORDS`."""


class DenseBytes(msgspec.Struct, frozen=True, kw_only=True):
    """Mean bytes of dense frames."""

    alone: float
    """Independent frames."""
    acknowledged: dict[str, float]
    """With references to acknowledged frames, by the loss in percent."""


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """The cost of one stream's samples, each alone in a frame; or of all in a window, together."""

    stream_id: int
    """1…175; 0: all streams."""
    name: str
    """Name of the topic."""
    type: str
    """Name of its type."""
    frames: int
    """Number of frames behind the other columns."""
    records: dict[str, float]
    """Mean bytes, by `RECORDS`."""
    dense: DenseBytes
    """Dense frames without a model."""
    too_large: int = 0
    """Number of records in the configured codec that are too large for a frame, so never cross."""
    dense_fitted: DenseBytes | None = None
    """Dense frames with the configured model; None: there is none."""


class BenchReport(msgspec.Struct, frozen=True, kw_only=True):
    """The cost of telemetry."""

    files: tuple[str, ...]
    """The recordings."""
    streams: tuple[Row, ...]
    """The streams by id."""
    window_s: float
    """Time whose samples share a frame, s."""
    window: Row
    """All samples of such a window."""
    decoded: int
    """Number of decoded frames."""
    different: int
    """Number of those that did not decode, or to other values: a fault."""
    notes: tuple[str, ...]
    """Notes on the recordings."""


def measure(
    files: Sequence[str], recordings: Recordings, table: StreamTable, *, window_s: float, seed: int
) -> BenchReport:
    """Measure the cost of recordings.

    Args:
        files: Their names.
        recordings: Their contents.
        table: The streams, with the model.
        window_s: Time whose samples share a frame, s.
        seed: Seed of the losses.
    """
    bench = _Bench(recordings.missions, table, window_s, seed)
    return BenchReport(
        files=tuple(files),
        streams=tuple(
            bench.row(table.by_id(stream_id))
            for stream_id in sorted(recordings.counts)
            if recordings.counts[stream_id].samples
        ),
        window_s=window_s,
        window=bench.row(None),
        decoded=bench.decoded,
        different=bench.different,
        notes=tuple(recordings.notes),
    )


class _Bench:
    def __init__(
        self, missions: Sequence[Mission], table: StreamTable, window_s: float, seed: int
    ) -> None:
        self._missions = missions
        self._model = table.model
        self._window_s = window_s
        self._seed = seed
        self.decoded = 0
        self.different = 0
        self._sizes = [self._sizes_of(mission, table) for mission in missions]

    def row(self, stream: Stream | None) -> Row:
        """Measure a stream; None: all of them, in frames of a window."""
        frames: list[list[Sizes]] = []
        groups: list[list[list[DenseSample]]] = []
        for mission, sizes in zip(self._missions, self._sizes, strict=True):
            if stream is None:
                frames += windows(sizes, self._window_s)
                groups.append(windows(counted(mission), self._window_s))
                continue
            own = [
                each
                for (_, stream_id, _), (_, each) in zip(mission.samples, sizes, strict=True)
                if stream_id == stream.stream_id
            ]
            frames += [[each] for each in own]
            groups.append([[each] for _, each in counted(mission, (stream.stream_id,))])
        return Row(
            stream_id=0 if stream is None else stream.stream_id,
            name="everything" if stream is None else stream.name,
            type="" if stream is None or stream.type is None else stream.type.name,
            frames=len(frames),
            records=_mean_records(frames),
            too_large=0 if stream is None else _too_large(stream, frames),
            dense=self._dense(groups, None),
            dense_fitted=self._dense(groups, self._model) if self._model is not None else None,
        )

    def _sizes_of(self, mission: Mission, table: StreamTable) -> list[tuple[float, Sizes]]:
        """Return the cost of each sample of a mission as a record."""
        records = {
            stream_id: _Records(table.by_id(stream_id), type_spec)
            for stream_id, type_spec in mission.types.items()
        }
        sizes = [
            (at_s, records[stream_id].sizes(value)) for at_s, stream_id, value in mission.samples
        ]
        self.decoded += sum(each.decoded for each in records.values())
        self.different += sum(each.different for each in records.values())
        return sizes

    def _dense(
        self, missions: Sequence[Sequence[Sequence[DenseSample]]], model: Model | None
    ) -> DenseBytes:
        return DenseBytes(
            alone=self._mean(missions, model, None),
            acknowledged={
                f"{loss:.0%}".rstrip("%"): self._mean(missions, model, loss) for loss in LOSSES
            },
        )

    def _mean(
        self,
        missions: Sequence[Sequence[Sequence[DenseSample]]],
        model: Model | None,
        loss: float | None,
    ) -> float:
        """Return the mean size of frames; `loss` None: no acknowledgements."""
        total = frames = 0
        for mission, groups in zip(self._missions, missions, strict=True):
            if not groups:
                continue
            counters = exchange(
                DenseCodec(mission.types, model=model), mission.types, groups,
                acknowledged=loss is not None, loss=loss or 0.0, seed=self._seed,
            )  # fmt: skip
            total += counters.total
            frames += len(counters.sizes)
            self.decoded += counters.received
            self.different += counters.faults
        return total / frames


class _Records:
    """The samples of one stream as records."""

    def __init__(self, stream: Stream, type_spec: TypeSpec) -> None:
        is_stamped = stream.qos.stamp is Stamp.AGE
        fields = type_spec.fields[:-1] if is_stamped else type_spec.fields
        self._type = msgspec.structs.replace(type_spec, fields=fields)
        self._cbor = CborCodec(self._type)
        self._packed = PackedCodec(self._type)
        is_reliable = stream.qos.reliability is Reliability.RELIABLE
        wildcards = len(stream.keys.wildcards)
        self._head_bytes = 1 + wildcards + is_reliable * NUMBER_BYTES + is_stamped
        self.decoded = 0
        self.different = 0

    def sizes(self, value: dict[str, Any]) -> Sizes:
        """Encode a sample in all ways, and decode it; return the sizes."""
        sent = {name: part for name, part in value.items() if name != AGE_FIELD}
        packed = self._packed.encode(sent)
        # With as few digits as the steps allow, as in text written by hand.
        rounded = self._packed.decode(packed)
        written = {
            "json": encode_application(rounded, JSON),
            "cbor_map": encode_application(rounded, CBOR),
            "cbor": self._cbor.encode(sent),
            "packed": packed,
        }
        found: dict[str, Callable[[bytes], object]] = {
            "json": lambda text: self._application(text, JSON),
            "cbor_map": lambda content: self._application(content, CBOR),
            "cbor": self._cbor.decode,
            "packed": self._packed.decode,
        }
        for name, payload in written.items():
            self.decoded += 1
            try:
                is_same = is_right(self._type, sent, found[name](payload))
            except (PayloadError, PayloadInvalidError):
                is_same = False
            self.different += not is_same
        return {name: self._head_bytes + len(payload) for name, payload in written.items()}

    def _application(self, payload: bytes, encoding: str) -> object:
        return self._type.validate(decode_application(payload, encoding, type_spec=self._type))


def _too_large(stream: Stream, frames: Sequence[Sequence[Sizes]]) -> int:
    """Count the records that are too large for a frame and may not cross in parts."""
    if crosses_in_parts(stream):
        return 0
    room = room_bytes(profile_named(DEFAULT_PROFILE).mtu_bytes)
    # An independent dense block of one sample is about as large as its packed record.
    codec = "cbor" if isinstance(stream.codec, CborCodec) else "packed"
    return sum(each[codec] > room for frame in frames for each in frame)


def _mean_records(frames: Sequence[Sequence[Sizes]]) -> dict[str, float]:
    """Return mean sizes of frames of records."""
    totals = dict.fromkeys(RECORDS, 0)
    for frame in frames:
        for name in RECORDS:
            totals[name] += sum(each[name] for each in frame)
            if name in _OPEN_ENDED:  # all but the last need a delimiter
                totals[name] += DELIMITER_BYTES * (len(frame) - 1)
    return {name: total / len(frames) for name, total in totals.items()}
