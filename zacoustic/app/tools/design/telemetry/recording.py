"""The recordings of a fleet's topics, checked like a publisher's values, by vehicle.

Values that a publisher would be refused are counted and left out, as at sea. If the positions of a
recording lie outside of the configured bounds, the bounds are moved there: the cost of telemetry
does not depend on the place.
"""

from collections import Counter
from collections.abc import Iterable
from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.telemetry.line import Cdr
from zacoustic.app.tools.design.telemetry.lines import read_lines
from zacoustic.app.tools.design.telemetry.names import StreamNames
from zacoustic.app.tools.design.telemetry.values import value_of
from zacoustic.config.ros import RosConfig
from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.qos import Stamp
from zacoustic.core.streams.table import AGE_FIELD, Stream, StreamTable, aged
from zacoustic.core.values.age import encode_age
from zacoustic.core.values.types import FieldSpec, Lattice, OutsideValues, TypeSpec
from zacoustic.errors import ConfigError, PayloadInvalidError
from zacoustic.ros.streams import RosTopic

_SHOWN_NAMES: Final = 12

Sample = tuple[float, int, dict[str, Any]]
"""Time in s, stream id, value."""


class Mission(msgspec.Struct, frozen=True):
    """Samples of one vehicle in one recording."""

    types: dict[int, TypeSpec]
    """Types in a dense block, by stream id."""
    samples: list[Sample]
    """In order of time, within bounds."""


class StreamCount(msgspec.Struct, kw_only=True):
    """The samples of one stream."""

    stream_id: int
    """1…175."""
    name: str
    """Name of the topic."""
    samples: int = 0
    """Number of samples."""
    refused: int = 0
    """Number of further samples that a publisher would have been refused."""
    reason: str = ""
    """Reason for the first of those."""
    outside: int = 0
    """Numbers outside of their range, which are clamped or carried in full width."""


class Recordings(msgspec.Struct, kw_only=True):
    """The samples of some files for a table's streams."""

    missions: list[Mission]
    """One for each file and vehicle."""
    counts: dict[int, StreamCount]
    """By stream id."""
    notes: list[str]
    """Remarks on the reading, one line each."""


def read_recordings(
    paths: Iterable[str],
    table: StreamTable,
    *,
    only_dense: bool,
    window_s: float,
    ros: RosConfig | None = None,
) -> Recordings:
    """Read recordings.

    Args:
        paths: The files.
        table: The streams; only typed topics count.
        only_dense: Only dense topics count.
        window_s: Time at whose end samples are sent, s: it makes their age, if they have a stamp.
        ros: The configuration's streams of ROS 2, which messages in CDR are of; None: none.

    Raises:
        ConfigError: A file or a line is wrong, or there are no samples.
    """
    reading = _Reading(table, only_dense=only_dense, window_s=window_s, ros=ros)
    names = list(paths)
    for path in names:
        reading.read(path)
    return reading.finish(", ".join(names))


class _Reading:
    def __init__(
        self, table: StreamTable, *, only_dense: bool, window_s: float, ros: RosConfig | None
    ) -> None:
        self._ros = ros
        self._unread: dict[str, tuple[int, str]] = {}
        self._names = StreamNames(table)
        self._untyped = StreamNames(table, are_typed=False)
        self._only_dense = only_dense
        self._window_s = window_s
        self._left_out: Counter[str] = Counter()
        self._found = Recordings(missions=[], counts={}, notes=[])

    def read(self, path: str) -> None:
        streams: dict[int, Stream] = {}
        written: dict[int | None, list[Sample]] = {}
        for line in read_lines(path):
            try:
                named = self._names.find(line.name)
                if named is None or (self._only_dense and named.stream.dense_type is None):
                    self._left_out[line.name] += 1
                    continue
                stream = named.stream
                assert stream.type is not None
                if isinstance(line.content, Cdr):
                    value = self._of_ros(stream, line.content)
                    if value is None:
                        continue
                else:
                    value = value_of(stream.type, line.content)
            except ConfigError as error:
                raise ConfigError(f"{line.place}: {error.args[0]}", hint=error.hint) from None
            streams[stream.stream_id] = stream
            sample = (line.at_s, stream.stream_id, value)
            written.setdefault(named.source, []).append(sample)
        # Samples without a named node belong to the only vehicle.
        if len(written) == 2 and None in written:
            written = {0: [each for samples in written.values() for each in samples]}
        for samples in written.values():
            samples.sort(key=lambda sample: sample[0])
            self._add_mission(path, streams, samples)

    def _of_ros(self, stream: Stream, content: Cdr) -> dict[str, Any] | None:
        """Return the value of a message in CDR as its topic has it; None: it cannot be read."""
        streams = {} if self._ros is None else self._ros.streams
        topic = streams.get(stream.stream_id)
        reason = "CDR, and the topic has no `ros` in the configuration"
        if isinstance(topic, RosTopic):
            try:
                return topic.message.read(content.data)[0]
            except PayloadInvalidError as error:
                reason = str(error)
        count, first = self._unread.get(stream.name, (0, reason))
        self._unread[stream.name] = (count + 1, first)
        return None

    def finish(self, files: str) -> Recordings:
        found = self._found
        unread = [f"{name}: {n} messages: {why}" for name, (n, why) in self._unread.items()]
        found.notes += unread
        if not found.missions and unread:
            raise ConfigError(f"{files}: no sample that can be read; {unread[0]}")
        if not found.missions:
            kind = "dense topic" if self._only_dense else "typed topic"
            names = ", ".join(list(self._left_out)[:_SHOWN_NAMES])
            but = f", but of {names}" if names else ", nor of anything else"
            raise ConfigError(
                f"{files}: no samples of any {kind} of the configuration{but}",
                hint="`s` is the name of a topic, its last part or its id",
            )
        for name, count in sorted(self._left_out.items())[:_SHOWN_NAMES]:
            what = f"no {'dense' if self._only_dense else 'typed'} topic of that name"
            if self._is_untyped(name):
                what = "a topic without a type"
            found.notes.append(f'"{name}", {count} samples: {what}')
        for each in found.counts.values():
            if each.refused:
                found.notes.append(
                    f"{each.name}: {each.refused} of {each.samples + each.refused} samples would "
                    f"be refused and are left out; the first: {each.reason}"
                )
            if each.outside:
                found.notes.append(f"{each.name}: {each.outside} numbers outside of their range")
        return found

    def _is_untyped(self, name: str) -> bool:
        try:
            return self._untyped.find(name) is not None
        except ConfigError:  # the name is ambiguous
            return True

    def _add_mission(self, path: str, streams: dict[int, Stream], written: list[Sample]) -> None:
        types: dict[int, TypeSpec] = {}
        outside: dict[int, OutsideValues] = {}
        dense_types: dict[int, TypeSpec] = {}
        for stream_id in sorted({stream_id for _, stream_id, _ in written}):
            stream = streams[stream_id]
            assert stream.type is not None
            values = [value for _, each, value in written if each == stream_id]
            types[stream_id] = self._moved(f"{path}: {stream.name}", stream.type, values)
            outside[stream_id] = OutsideValues(types[stream_id])
            is_aged = stream.qos.stamp is Stamp.AGE
            dense_types[stream_id] = aged(types[stream_id]) if is_aged else types[stream_id]
            self._found.counts.setdefault(
                stream_id, StreamCount(stream_id=stream_id, name=stream.name)
            )
        samples: list[Sample] = []
        for at_s, stream_id, value in written:
            count = self._found.counts[stream_id]
            try:
                value = outside[stream_id].normalised(value)
            except PayloadInvalidError as error:
                count.refused += 1
                count.reason = count.reason or str(error)
                continue
            if dense_types[stream_id] is not types[stream_id]:
                waits_s = self._window_s - at_s % self._window_s
                value[AGE_FIELD] = encode_age(seconds_to_ns(waits_s))
            samples.append((at_s, stream_id, value))
            count.samples += 1
        for stream_id, each in outside.items():
            beyond = each.clamped.total() + each.escaped.total() + each.trimmed.total()
            self._found.counts[stream_id].outside += beyond
        if samples:
            self._found.missions.append(Mission(dense_types, samples))

    def _moved(self, what: str, type_spec: TypeSpec, values: list[dict[str, Any]]) -> TypeSpec:
        """Return a type with the bounds of positions at the place of the recording."""
        fields = []
        for field in type_spec.fields:
            moved = _moved_field(field, [each.get(field.name) for each in values])
            if moved is not None and moved.range is not None and field.range is not None:
                low, high = field.range
                self._found.notes.append(
                    f"{what}.{field.name}: most lie outside of {low:g}..{high:g}; read as if the "
                    f"range were {moved.range[0]:g}..{moved.range[1]:g}, of another place"
                )
            fields.append(moved or field)
        return msgspec.structs.replace(type_spec, fields=tuple(fields))


def _moved_field(field: FieldSpec, written: list[Any]) -> FieldSpec | None:
    """Return the field with its range moved to the values; None: not necessary, or too wide."""
    if field.range is None or field.wraps or field.outside != "reject" or field.is_array:
        return None
    low, high = field.range
    numbers = [each for each in written if isinstance(each, int | float)]
    if 2 * sum(not low <= each <= high for each in numbers) <= len(numbers):
        return None
    span = high - low
    least, greatest = min(numbers), max(numbers)
    if greatest - least > span:
        return None
    # The beginning of the recording becomes the middle, if the rest then is within.
    wanted = max(min(numbers[0] - span / 2, least), greatest - span)
    step = field.step or (1 if field.is_integer else None)
    shift = wanted - low if step is None else round((wanted - low) / step) * step
    try:
        moved = msgspec.structs.replace(field, range=(low + shift, high + shift))
    except ConfigError:  # beyond the range of the type
        return None
    if Lattice.has_lattice(field) and Lattice(moved).size != Lattice(field).size:
        return None
    return moved
