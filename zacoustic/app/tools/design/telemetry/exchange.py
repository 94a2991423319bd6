"""A vehicle and a listener over a lossy channel: sizes of frames, and that they decode right.

An acknowledgement is known when the next but one frame is written, unless it is lost too. It goes
in a frame that goes anyway, as on the channel, and is not counted here.
"""

import random
from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeVar

import msgspec

from zacoustic.app.tools.design.telemetry.recording import Mission
from zacoustic.app.tools.design.telemetry.values import is_right
from zacoustic.core.values.dense import DenseCodec, DenseSample, Listener, Speaker
from zacoustic.core.values.payload import PackedCodec, PayloadError
from zacoustic.core.values.types import TypeSpec

Thing = TypeVar("Thing")

_LISTENER: Final = 1
_ROOM_BYTES: Final = 1 << 20


class Counters(msgspec.Struct):
    """What came of an exchange."""

    sizes: list[int] = []
    """Of each frame, bytes."""
    received: int = 0
    """Frames that arrived."""
    unread: int = 0
    """Of these, how many could not be decoded: a fault."""
    wrong: int = 0
    """Samples that arrived as something else: a fault."""

    @property
    def total(self) -> int:
        """All frames, bytes."""
        return sum(self.sizes)

    @property
    def faults(self) -> int:
        """What must not be."""
        return self.unread + self.wrong


def counted(mission: Mission, streams: Sequence[int] = ()) -> list[tuple[float, DenseSample]]:
    """Make dense samples, with their times; a stream's are counted, as a node counts them.

    Args:
        mission: Of a vehicle.
        streams: Only these; none: all.
    """
    counts = dict.fromkeys(streams or mission.types, 0)
    found = []
    for at_s, stream_id, value in mission.samples:
        if stream_id in counts:
            counts[stream_id] += 1
            found.append((at_s, DenseSample(stream_id, value, counts[stream_id])))
    return found


def windows(timed: Sequence[tuple[float, Thing]], window_s: float) -> list[list[Thing]]:
    """Group the samples of the same time.

    Args:
        timed: Each with its time, s.
        window_s: How long a time is, s.
    """
    found: dict[int, list[Thing]] = {}
    for at_s, thing in timed:
        found.setdefault(int(at_s // window_s), []).append(thing)
    return list(found.values())


def exchange(
    codec: DenseCodec,
    types: Mapping[int, TypeSpec],
    groups: Sequence[Sequence[DenseSample]],
    *,
    acknowledged: bool,
    loss: float = 0.0,
    seed: int = 1,
) -> Counters:
    """Send groups of samples, each in its own frame, and decode what arrives.

    Args:
        codec: The vehicle's.
        types: Of its streams, by stream id.
        groups: What is sent together.
        acknowledged: The listener acknowledges what it has; else each frame stands for itself.
        loss: Share of frames, and of acknowledgements, that are lost.
        seed: Of the losses.
    """
    rng = random.Random(seed)
    packed = {stream_id: PackedCodec(each) for stream_id, each in types.items()}
    speaker, listener, counters = Speaker(codec), Listener(codec), Counters()
    receivers = {_LISTENER} if acknowledged else ()
    on_the_way: int | None = None
    for group in groups:
        left = list(group)
        while left:
            encoded = speaker.encode(left, _ROOM_BYTES, receivers)
            if encoded is None:  # no string that could not be misunderstood: as records
                counters.sizes.append(sum(_record_bytes(packed, sample) for sample in left))
                break
            speaker.sent(encoded)
            counters.sizes.append(len(encoded.frame))
            if on_the_way is not None:
                speaker.acknowledged(_LISTENER, on_the_way)
                on_the_way = None
            taken, left = left[: encoded.taken], left[encoded.taken :]
            if rng.random() < loss:
                continue
            _receive(listener, encoded.frame, taken, types, counters)
            if rng.random() >= loss:
                on_the_way = listener.mark
    return counters


def _receive(
    listener: Listener,
    frame: bytes,
    sent: Sequence[DenseSample],
    types: Mapping[int, TypeSpec],
    counters: Counters,
) -> None:
    counters.received += 1
    try:
        found = listener.decode(frame).samples
    except PayloadError:
        counters.unread += 1
        return
    expected = sorted(sent, key=lambda each: each.stream_id)
    counters.wrong += abs(len(expected) - len(found))
    for sample, (stream_id, value) in zip(expected, found, strict=False):
        counters.wrong += stream_id != sample.stream_id or not _is_right(types, sample, value)


def _is_right(types: Mapping[int, TypeSpec], sample: DenseSample, value: dict[str, Any]) -> bool:
    return is_right(types[sample.stream_id], sample.value, value)


def _record_bytes(packed: Mapping[int, PackedCodec], sample: DenseSample) -> int:
    return 1 + len(packed[sample.stream_id].encode(sample.value))
