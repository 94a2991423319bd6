"""Dense frames: the samples of several streams as one arithmetic-coded string.

The problem: on the water a byte costs as much as a thousand on land, and a vehicle's telemetry says
again and again what is known already. The idea: samples that share a frame need no feedback to be
coded against each other, so that comes first; a frame that the receiver has acknowledged is the
reference of the first sample of each stream. Where there is no such frame, or it is too old, a
frame stands for itself. All prediction, and all learning, runs along these references only.

A frame is, in this order (shares in `_KINDS` and `_GAPS`; the first two bits are the marker):

1. kind: for itself, or for itself with a number, or with a number and a reference;
2. number, 4 bits; how many frames back the reference is;
3. for each stream, by id: are there samples? then each of them, with the steps from the one that it
   is coded against and, behind it, whether another one follows;
4. the check of `arithmetic`: of the stream table, the model and the reference, in at least 3 bits
   where there is a reference, and in what the rounding to bytes leaves over anyway.

The order of samples of one stream is kept; that of different streams is not.

What comes off the water is a `PayloadError` or samples within their bounds, in bounded time: a
string is read no further than 64 bits behind its end, and there are at most 255 samples of each
stream.

Nothing here remembers: which snapshots there are, and who has acknowledged which, is the affair of
whoever calls.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import msgspec

from zacoustic.core.dense.adaptation import LONGEST_STEPS, StreamState
from zacoustic.core.dense.arithmetic import Reader, Writer
from zacoustic.core.dense.habits import MOST_SAMPLES, Habit, new_habit
from zacoustic.core.dense.layout import Row
from zacoustic.core.dense.prior import Model
from zacoustic.core.dense.snapshot import NUMBERS, Snapshot, chained_digest
from zacoustic.core.dense.streamcodec import Beside, StreamCodec
from zacoustic.core.payload import PayloadError
from zacoustic.core.types import TypeSpec

_ALONE, _NUMBERED, _REFERRING = 0, 1, 2
_KINDS: Final = (4, 1, 11)
# How likely a reference is that many frames back, 1…15.
_GAPS: Final = (20, 24, 16, 12, 10, 7, 5, 4, 3, 2, 2, 1, 1, 1, 1)
_CHECK_WAYS: Final = 8  # at least 3 bits of check, on average 6, where there is a reference


class DenseSample(msgspec.Struct, frozen=True):
    """A sample to be sent."""

    stream_id: int
    """Of a stream of the codec."""
    value: Any
    """A Mapping or `msgspec.Struct` of the stream's type."""
    tick: int | None = None
    """When it was taken, in periods of the stream or as the count of what was published; None: one
    after the last. Only differences count, and a wrong one costs bits, nothing else."""


class Encoded(msgspec.Struct, frozen=True):
    """A frame to be sent."""

    frame: bytes
    """From the marker on."""
    taken: int
    """How many of the samples are in it, from the first on."""
    snapshot: Snapshot
    """What who receives it will know."""


class Decoded(msgspec.Struct, frozen=True):
    """A frame that was received."""

    samples: tuple[tuple[int, dict[str, Any]], ...]
    """Stream ids and values."""
    number: int | None
    """The frame's number; None: it is not to be referred to."""
    snapshot: Snapshot
    """What is known now."""


class DenseCodec:
    """Writes and reads the dense frames of one source.

    Args:
        types: Type of each dense stream, by stream id; the same at both ends.
        model: What a fit says of them.
        digest: Of everything else that both ends must agree on: four bytes of the stream table.

    Raises:
        ConfigError: The model is for other types.
    """

    def __init__(
        self, types: Mapping[int, TypeSpec], *, model: Model | None = None, digest: bytes = b""
    ) -> None:
        priors = {} if model is None else model.streams
        self.streams = {
            stream_id: StreamCodec(stream_id, types[stream_id], priors.get(str(stream_id)))
            for stream_id in sorted(types)
        }
        habits = {
            stream_id: new_habit(codec.prior, len(self.streams))
            for stream_id, codec in self.streams.items()
        }
        root = chained_digest(digest, b"" if model is None else model.digest)
        self._root = Snapshot({}, habits, {}, {}, root)

    def encode(
        self,
        samples: Sequence[DenseSample],
        room: int,
        *,
        number: int | None = None,
        reference: tuple[int, Snapshot] | None = None,
    ) -> Encoded | None:
        """Write a frame.

        Args:
            samples: The most important first; as many as fit are taken, without leaving one out.
            room: Greatest size of the frame, bytes.
            number: The frame's number, 0…15, if it may be referred to: one more than that of the
                source's last such frame.
            reference: How many numbers back the reference is, 1…15, and its snapshot; needs a
                number.

        Returns:
            None where not even the first sample fits, or there is none.

        Raises:
            PayloadInvalidError: A value is not of its stream's type.
        """
        parts = [self.streams[each.stream_id].split(each.value) for each in samples]
        fits: Encoded | None = None
        low, high = 0, len(samples)
        count = high
        while low < high:
            encoded = self._encode(samples, parts, count, number, reference)
            size = len(encoded.frame) if encoded is not None else 2 * room
            if encoded is not None and size <= room:
                fits, low = encoded, count
            else:
                high = count - 1
            count = min(max(count * room // size, low + 1), high)
        return fits

    def _encode(
        self,
        samples: Sequence[DenseSample],
        parts: Sequence[tuple[Row, list[Any]]],
        count: int,
        number: int | None,
        reference: tuple[int, Snapshot] | None,
    ) -> Encoded | None:
        """Write a frame of the first `count` samples; None: a stream has too many of them."""
        lanes: dict[int, list[int]] = {}
        for place, sample in enumerate(samples[:count]):
            lanes.setdefault(sample.stream_id, []).append(place)
        if any(len(lane) > MOST_SAMPLES for lane in lanes.values()):
            return None
        writer = Writer()
        kind = _ALONE if number is None else _NUMBERED if reference is None else _REFERRING
        writer.choice(_KINDS, kind)
        gap, known = reference if reference is not None else (0, self._root)
        if number is not None:
            writer.uniform(NUMBERS, number)
            if reference is not None:
                writer.choice(_GAPS, gap - 1)
        page = _Page(known)
        for stream_id, codec in self.streams.items():
            lane = lanes.get(stream_id, [])
            habit = page.habit(stream_id)
            if not habit.code_present(writer, bool(lane)):
                continue
            for nth, place in enumerate(lane, 1):
                state, expected = page.state_of(stream_id, nth, gap)
                steps, tick = _steps(samples[place].tick, page.ticks.get(stream_id), expected)
                if state is not None:
                    habit.code_steps(writer, expected, steps, in_frame=nth > 1)
                state = codec.write(writer, parts[place], state, steps, page.beside)
                page.add(stream_id, state, tick)
                habit.code_more(writer, nth, nth < len(lane))
        ways = 1 if reference is None else _CHECK_WAYS
        frame = writer.finish(ways, known.check)
        return Encoded(frame, count, page.snapshot(chained_digest(known.digest, frame)))

    def decode(self, frame: bytes, known: Mapping[int, Snapshot]) -> Decoded:
        """Read a frame off the water.

        Args:
            frame: From the marker on, all of it.
            known: Snapshots of the source's last frames that were received, by number; none that is
                more than 15 numbers old.

        Raises:
            PayloadError: It is damaged, or its reference is not known.
        """
        if not frame:
            raise PayloadError("an empty frame")
        reader = Reader(frame)
        kind = reader.choice(_KINDS)
        number, gap, reference = None, 0, self._root
        if kind != _ALONE:
            number = reader.uniform(NUMBERS)
            if kind == _REFERRING:
                gap = 1 + reader.choice(_GAPS)
                found = known.get((number - gap) % NUMBERS)
                if found is None:
                    raise PayloadError(f"a reference to frame {(number - gap) % NUMBERS}")
                reference = found
        page = _Page(reference)
        samples: list[tuple[int, dict[str, Any]]] = []
        for stream_id, codec in self.streams.items():
            habit = page.habit(stream_id)
            nth = 0
            is_more = habit.code_present(reader, False)
            while is_more:
                nth += 1
                state, expected = page.state_of(stream_id, nth, gap)
                steps = 1
                if state is not None:
                    steps = habit.code_steps(reader, expected, 0, in_frame=nth > 1)
                value, state = codec.read(reader, state, steps, page.beside)
                page.add(stream_id, state, page.ticks.get(stream_id, 0) + steps)
                samples.append((stream_id, value))
                is_more = habit.code_more(reader, nth, False)
        reader.check(1 if kind != _REFERRING else _CHECK_WAYS, reference.check)
        snapshot = page.snapshot(chained_digest(reference.digest, frame))
        return Decoded(tuple(samples), number, snapshot)


class _Page:
    """What is known while a frame is written or read."""

    def __init__(self, known: Snapshot) -> None:
        self._known = known
        self._streams = dict(known.streams)
        self._habits: dict[int, Habit] = {}
        self._counts: dict[int, int] = {}
        self.ticks = dict(known.ticks)
        self.beside: Beside = {}

    def habit(self, stream_id: int) -> Habit:
        """The habit of a stream, to be changed."""
        habit = self._habits[stream_id] = self._known.habits[stream_id].copy()
        return habit

    def state_of(self, stream_id: int, nth: int, gap: int) -> tuple[StreamState | None, int]:
        """What the nth sample of a stream is coded against, and the steps that are expected."""
        state = self._streams.get(stream_id)
        if nth > 1:
            return state, 1
        count = self._known.counts.get(stream_id, 1)
        return state, min(max(gap * count - count + 1, 1), LONGEST_STEPS)

    def add(self, stream_id: int, state: StreamState, tick: int) -> None:
        """Take a sample in."""
        self._streams[stream_id] = state
        self._counts[stream_id] = self._counts.get(stream_id, 0) + 1
        self.ticks[stream_id] = tick
        self.beside[stream_id] = state.row

    def snapshot(self, digest: bytes) -> Snapshot:
        """All of it, for later frames."""
        return Snapshot(self._streams, self._habits, self._counts, self.ticks, digest)


def _steps(tick: int | None, last: int | None, expected: int) -> tuple[int, int]:
    """How far a sample lies behind the last one, 1…16, and its tick."""
    if tick is None or last is None:
        return expected, (tick if tick is not None else (last or 0) + expected)
    return min(max(tick - last, 1), LONGEST_STEPS), tick
