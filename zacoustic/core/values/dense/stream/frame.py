"""Dense frames: the samples of several streams as one arithmetic-coded block.

The problem: under water a byte costs as much as a thousand on land, and a vehicle's telemetry
repeats what is known already. The idea: samples that share a frame are coded against each other,
which needs no feedback; and a frame that the receiver has acknowledged is the reference of the
first sample of each stream. Without an acknowledged frame, a frame is independent. All prediction
and all learning follows these references only.

A frame contains, in this order (shares in `_KINDS`; the first two bits are the marker):

1. kind: with a reference; independent; or a single independent sample;
2. the name of the reference;
3. the streams; for each stream, by id, the samples: each with its distance in steps from the one
   that it is coded against and, after it, whether another one follows. A single sample has neither
   steps nor a successor, and all streams have the same share: this frame costs least beyond the
   sample itself, with any habits;
4. how the frame gets its own name (see `snapshot` and `references`);
5. the check of `arithmetic`: of the stream table, the model and the reference, in what the rounding
   to bytes leaves over.

The samples of one stream keep their order; those of different streams do not.

A received frame gives a `PayloadError` or samples within their bounds, in bounded time: a block is
read at most 64 bits beyond its end, and there are at most 255 samples of each stream.

This module keeps no state: `references` has the snapshots, and which of them are acknowledged.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final

import msgspec

from zacoustic.core.values.dense.coder.arithmetic import Coder
from zacoustic.core.values.dense.coder.reader import Reader
from zacoustic.core.values.dense.coder.shares import ends_of
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.dense.model.adaptation import LONGEST_STEPS
from zacoustic.core.values.dense.model.habits import MOST_SAMPLES, Presence, new_habits
from zacoustic.core.values.dense.model.layout import Row
from zacoustic.core.values.dense.model.prior import Model
from zacoustic.core.values.dense.model.snapshot import FORMS, NAMES, SHORT_NAMES, Known, Snapshot
from zacoustic.core.values.dense.stream.streamcodec import Beside, StreamCodec
from zacoustic.core.values.payload import PayloadError, ReferenceUnknownError
from zacoustic.core.values.types import TypeSpec
from zacoustic.errors import ConfigError

_REFERRING, _ALONE, _SINGLE = 0, 1, 2
_KINDS: Final = ends_of(28, 3, 1)
# An independent frame is in one of these forms, with these shares: if the rarer one took a bit
# more, a sample would cost three bytes more than packed.
_FORMS_ALONE: Final = 0, FORMS - 1
_ALONE_ENDS: Final = ends_of(31, 1)
_NOTHING: Final[Mapping[int, Snapshot]] = MappingProxyType({})
_NAME_BITS: Final = 5  # bits of a short name; of a long one, all but the last
_SPARE_BITS: Final = 8  # try other kinds if a frame exceeds its plain samples by this

_FIRST_TRY: Final = 16  # samples; how many fit is found by trying


def _code_name(coder: Coder, name: int) -> int:
    """Write or read the name of a reference."""
    found = coder.raw(_NAME_BITS, name if name < SHORT_NAMES else name + SHORT_NAMES >> 1)
    if found < SHORT_NAMES:
        return found
    return SHORT_NAMES + 2 * (found - SHORT_NAMES) + coder.raw(1, name - SHORT_NAMES & 1)


def _opening(name: int) -> tuple[int, int, int]:
    writer = Writer()
    writer.pick(_KINDS, _REFERRING)
    _code_name(writer, name)
    return writer.mark()


# The state of a writer that has written the name of a reference, so that it need not do it again.
_OPENINGS: Final = [_opening(name) for name in range(NAMES)]

_Piece = tuple[int, int | None, tuple[Row, list[Any]]]
"""A sample to write: the index of its stream, when it was taken, and its parts."""


class DenseSample(msgspec.Struct, frozen=True):
    """A sample to send."""

    stream_id: int
    """The id of a stream of the codec."""
    value: Any
    """A Mapping or `msgspec.Struct` of the stream's type."""
    tick: int | None = None
    """When it was taken, in periods of the stream or as a count of published samples; None: one
    after the last. Only differences count, and a wrong one costs bits, nothing else."""


class Encoded(msgspec.Struct, frozen=True):
    """A frame to send."""

    frame: bytes
    """The frame from the marker on."""
    taken: int
    """How many of the samples are in it, from the first on."""
    snapshot: Snapshot
    """The snapshot that its receivers will have."""
    reference: Snapshot | None
    """Its reference; None: it is independent."""

    @property
    def is_apart(self) -> bool:
        """Whether it is independent and nothing can refer to it."""
        return self.reference is None and self.snapshot.name is None


class Decoded(msgspec.Struct, frozen=True):
    """A decoded frame."""

    samples: tuple[tuple[int, dict[str, Any]], ...]
    """Stream ids and values."""
    snapshot: Snapshot
    """The snapshot after it."""


class DenseCodec:
    """Writes and reads the dense frames of one source.

    Args:
        types: Type of each dense stream, by stream id; the same at both ends.
        model: Their fitted model.
        digest: Digest of everything else that both ends must agree on: four bytes of the stream
            table.

    Raises:
        ConfigError: There are no streams, or the model is for other types.
    """

    def __init__(
        self, types: Mapping[int, TypeSpec], *, model: Model | None = None, digest: bytes = b""
    ) -> None:
        if not types:
            raise ConfigError("streams: none are dense; allowed: at least one")
        priors = {} if model is None else model.streams
        self.streams = {
            stream_id: StreamCodec(stream_id, types[stream_id], priors.get(str(stream_id)))
            for stream_id in sorted(types)
        }
        self._codecs = list(self.streams.values())
        self._places = {stream_id: place for place, stream_id in enumerate(self.streams)}
        presence, habits = new_habits(model, self.streams)
        agreed = digest + (b"" if model is None else model.digest)
        self._root = Snapshot([(None, None, habit) for habit in habits], presence, agreed)

    def encode(
        self,
        samples: Sequence[DenseSample],
        room: int,
        reference: Snapshot | None = None,
        *,
        refuses: Callable[["Encoded"], bool] | None = None,
        invested: int = 0,
    ) -> Encoded | None:
        """Write a frame.

        Args:
            samples: The most important first; as many as fit are taken, without leaving one out.
            room: Greatest size of the frame, bytes.
            reference: A frame that every receiver holds.
            refuses: Returns whether a frame must not have its name: then it is written in another
                form.
            invested: How much more a frame with the reference may cost than one without, bytes.

        Returns:
            The frame; None if not even the first sample fits, or if there is none.

        Raises:
            PayloadInvalidError: A value is not of its stream's type.
        """
        aim = _Aim(reference, refuses, invested)
        pieces: list[_Piece] = []
        fits: Encoded | None = None
        low, high = 0, len(samples)
        count = high if high < _FIRST_TRY else _FIRST_TRY
        while low < high:
            for sample in samples[len(pieces) : count]:
                place = self._places[sample.stream_id]
                pieces.append((place, sample.tick, self._codecs[place].split(sample.value)))
            encoded = self._best(pieces[:count], aim)
            if encoded is not None and len(encoded.frame) <= room:
                if count == high:
                    return encoded
                fits, low = encoded, count
            else:
                high = count - 1
            size = len(encoded.frame) if encoded is not None else 2 * room
            count = min(max(count * room // max(size, 1), low + 1), high)
        return fits

    def decode(self, frame: bytes, held: Mapping[int, Snapshot] = _NOTHING) -> Decoded:
        """Read a received frame.

        Args:
            frame: The whole frame, from the marker on.
            held: Snapshots of the source's frames that may be referred to, by name.

        Raises:
            PayloadError: It is damaged, or its reference is not held.
        """
        if not frame:
            raise PayloadError("an empty frame")
        reader = Reader(frame)
        kind = reader.pick(_KINDS)
        reference: Snapshot | None = None
        if kind == _REFERRING:
            reference = held.get(_code_name(reader, 0))
            if reference is None:
                raise ReferenceUnknownError("a reference to a frame that is not held")
        known = reference or self._root
        streams = known.streams[:]
        beside: Beside = {}
        samples: list[tuple[int, dict[str, Any]]] = []
        distance = 1
        if kind == _SINGLE:
            place = reader.uniform(len(streams))
            codec, presence = self._codecs[place], known.presence.after(place)
            value, state = codec.read(reader, None, 1, beside)
            samples.append((codec.stream_id, value))
            streams[place] = state, 0, streams[place][2]
        else:
            places, presence = known.presence.code(reader, ())
            for place in places:
                codec, (last, tick, habit) = self._codecs[place], streams[place]
                nth, is_more, behind = 0, True, 1
                while is_more:
                    nth += 1
                    steps = 1
                    if nth > 1:
                        steps, habit = habit.code_steps_in_frame(reader, 1)
                    elif last is not None:
                        steps, habit = habit.code_steps(reader, 1)
                        behind = steps
                    value, last = codec.read(reader, last, steps, beside)
                    tick = (tick or 0) + steps
                    beside[codec.stream_id] = last.row
                    samples.append((codec.stream_id, value))
                    is_more, habit = habit.code_more(reader, nth, False)
                streams[place] = last, tick, habit
                distance = max(distance, -(-behind // nth))
        if not samples:
            raise PayloadError("a frame of no samples")
        form, presence = _code_form(reader, presence, reference is not None, 0)
        reader.check(1, known.check)
        snapshot = Snapshot(streams, presence, frame, known, form, distance)
        return Decoded(tuple(samples), snapshot)

    def _best(self, pieces: Sequence[_Piece], aim: "_Aim") -> Encoded | None:
        """Return the cheapest frame of these samples; None: a stream has too many of them."""
        lanes: dict[int, list[_Piece]] = {}
        plain = 0
        for piece in pieces:
            place = piece[0]
            lanes.setdefault(place, []).append(piece)
            plain += self._codecs[place].plain_bits
        if len(pieces) > MOST_SAMPLES and max(map(len, lanes.values())) > MOST_SAMPLES:
            return None
        best: Encoded | None = None
        if aim.reference is not None:
            best = self._several(lanes, aim)
            if 8 * len(best.frame) <= plain + _SPARE_BITS:
                return best
        alone = _Aim(None, aim.refuses)
        others = [self._several(lanes, alone)]
        if len(pieces) == 1:
            others.append(self._single(pieces[0], alone))
        for other in others:
            if best is None or len(other.frame) + aim.invested_bytes(best, plain) < len(best.frame):
                best = other
        return best

    def _several(self, lanes: Mapping[int, Sequence[_Piece]], aim: "_Aim") -> Encoded:
        """Write a frame of any samples, by stream."""
        known = aim.reference
        if known is None:
            known, writer = self._root, Writer()
            writer.pick(_KINDS, _ALONE)
        else:
            assert known.name is not None
            writer = Writer(_OPENINGS[known.name])
        streams = known.streams[:]
        beside: Beside = {}
        places, presence = known.presence.code(writer, sorted(lanes))
        taken, distance = 0, 1
        for place in places:
            codec, (last, tick, habit) = self._codecs[place], streams[place]
            count = len(lanes[place])
            for nth, (_, taken_at, parts) in enumerate(lanes[place], 1):
                steps, tick = _steps(taken_at, tick)
                if nth > 1:
                    _, habit = habit.code_steps_in_frame(writer, steps)
                elif last is not None:
                    if parts[0] == last.row:
                        # A value that stood still is the same at any distance: take the cheapest.
                        steps = habit.likeliest_steps
                    _, habit = habit.code_steps(writer, steps)
                    distance = max(distance, -(-steps // count))
                last = codec.write(writer, parts, last, steps, beside)
                beside[codec.stream_id] = last.row
                _, habit = habit.code_more(writer, nth, nth < count)
            streams[place] = last, tick, habit
            taken += count
        return aim.finish(writer, known, streams, presence, taken, distance)

    def _single(self, piece: _Piece, aim: "_Aim") -> Encoded:
        """Write a frame of one sample in the form without habits."""
        writer, known, (place, tick, parts) = Writer(), self._root, piece
        streams = known.streams[:]
        writer.pick(_KINDS, _SINGLE)
        writer.uniform(len(streams), place)
        state = self._codecs[place].write(writer, parts, None, 1, {})
        streams[place] = state, tick or 0, streams[place][2]
        return aim.finish(writer, known, streams, known.presence.after(place), 1)


class _Aim:
    """The reference for a frame, and the names that it must not have.

    Args:
        reference: A frame that every receiver holds.
        refuses: Returns whether a frame must not have its name.
        invested: How much more it may cost than one without a reference, bytes.
    """

    __slots__ = ("_invested", "reference", "refuses")

    def __init__(
        self,
        reference: Snapshot | None,
        refuses: Callable[[Encoded], bool] | None,
        invested: int = 0,
    ) -> None:
        self.reference = reference
        self.refuses = refuses
        self._invested = invested

    def invested_bytes(self, encoded: Encoded, plain_bits: int) -> int:
        """Return how many bytes more a frame may cost; 0 if it is far dearer than plain."""
        is_dear = 8 * len(encoded.frame) > plain_bits + 2 * _SPARE_BITS
        return 0 if encoded.reference is None or is_dear else self._invested

    def finish(
        self,
        writer: Writer,
        known: Snapshot,
        streams: list[Known],
        presence: Presence,
        taken: int,
        distance: int = 1,
    ) -> Encoded:
        """Finish a frame in the cheapest form that is not refused."""
        mark, refers = writer.mark(), self.reference is not None
        for form in range(FORMS) if refers else _FORMS_ALONE:
            writer.rewind(mark)
            _, after = _code_form(writer, presence, refers, form)
            frame = writer.finish(1, known.check)
            snapshot = Snapshot(streams, after, frame, known, form, distance)
            encoded = Encoded(frame, taken, snapshot, self.reference)
            if snapshot.name is None or self.refuses is None or not self.refuses(encoded):
                break
        return encoded


def _code_form(coder: Coder, presence: Presence, refers: bool, form: int) -> tuple[int, Presence]:
    """Write or read the form of a frame; also return the presence after that."""
    if refers:
        return presence.code_form(coder, form)
    return _FORMS_ALONE[coder.pick(_ALONE_ENDS, _FORMS_ALONE.index(form))], presence


def _steps(tick: int | None, last: int | None) -> tuple[int, int]:
    """Return the distance of a sample from the last one, 1…16 steps, and its tick."""
    if tick is None:
        return 1, (last or 0) + 1
    if last is None:
        return 1, tick
    steps = tick - last
    if steps < 1:
        return 1, tick
    return steps if steps < LONGEST_STEPS else LONGEST_STEPS, tick
