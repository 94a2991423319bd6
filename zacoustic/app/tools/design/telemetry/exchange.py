"""A vehicle and a listener over a lossy channel: sizes of frames, and correct decoding.

The acknowledgement of a frame is known when the next but one is encoded, unless it is lost as well.
As on the channel it goes in a frame that is sent anyway, and is not counted here.
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
    """The result of an exchange."""

    sizes: list[int] = []
    """Size of each frame, bytes."""
    received: int = 0
    """Number of received frames."""
    unread: int = 0
    """Number of those that could not be decoded: a fault."""
    wrong: int = 0
    """Number of samples decoded to another value: a fault."""

    @property
    def total(self) -> int:
        """Size of all frames, bytes."""
        return sum(self.sizes)

    @property
    def faults(self) -> int:
        """Number of faults."""
        return self.unread + self.wrong


def counted(mission: Mission, streams: Sequence[int] = ()) -> list[tuple[float, DenseSample]]:
    """Make dense samples with their times; numbers the samples of a stream like a node.

    Args:
        mission: Mission of a vehicle.
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
    """Group samples by time.

    Args:
        timed: Samples with their times, s.
        window_s: Length of a group, s.
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
        codec: The vehicle's codec.
        types: Types of its streams, by stream id.
        groups: Samples of each frame.
        acknowledged: The listener acknowledges frames; otherwise each frame is independent.
        loss: Share of lost frames and acknowledgements.
        seed: Seed of the losses.
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
            if encoded is None:  # no unambiguous block is possible: send records
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
