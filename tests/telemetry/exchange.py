"""A source and its listener over lossy water: what each frame costs, and that it is read right."""

import random
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from tests.telemetry.streams import STREAM_IDS, Sample, is_near
from zacoustic.core.values.dense import DenseCodec, DenseSample, Listener, Speaker
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.types import TypeSpec

LISTENER = 1
"""Address of the one who listens."""


class Counters(msgspec.Struct):
    """What came of an exchange."""

    sizes: list[int]
    """Of each frame, bytes."""
    messages: list[int]
    """How many samples each frame had."""
    received: int = 0
    """Frames that arrived."""
    undecodable: int = 0
    """Of these, how many could not be read."""
    wrong: int = 0
    """Samples that were not what was sent."""

    @property
    def mean(self) -> float:
        """Mean size, bytes."""
        return sum(self.sizes) / len(self.sizes)

    @property
    def p95(self) -> int:
        """Size that 95 % do not exceed, bytes."""
        return sorted(self.sizes)[min(len(self.sizes) - 1, -(-len(self.sizes) * 95 // 100) - 1)]


def dense_samples(samples: Iterable[Sample], names: Iterable[str]) -> list[DenseSample]:
    """Make dense samples of some streams, in the order of time, counted by stream."""
    counts = dict.fromkeys(names, 0)
    found = []
    for _, name, value in samples:
        if name in counts:
            found.append(DenseSample(STREAM_IDS[name], value, counts[name]))
            counts[name] += 1
    return found


def exchange(
    codec: DenseCodec,
    groups: Sequence[Sequence[DenseSample]],
    *,
    room: int = 4096,
    ack_every: int | None = None,
    loss: float = 0.0,
    seed: int = 1,
    disorder: float = 0.0,
) -> Counters:
    """Send groups of samples, a frame each (or as many as they need), and read what arrives.

    Args:
        codec: The source's.
        groups: What is sent together.
        room: Greatest frame, bytes.
        ack_every: Every so many received frames the newest is acknowledged; the acknowledgement is
            known one frame later, unless it is lost too. None: never.
        loss: Share of frames and acknowledgements that are lost.
        seed: Of the losses.
        disorder: Share of frames that arrive again, and of those that arrive after their successor.
    """
    rng = random.Random(seed)
    speaker, listener, counters = Speaker(codec), Listener(codec), Counters([], [])
    types = {stream_id: each.type_spec for stream_id, each in codec.streams.items()}
    known: dict[bytes, Sequence[DenseSample]] = {}
    late: list[bytes] = []
    pending: list[int] = []
    for group in groups:
        left = list(group)
        while left:
            encoded = speaker.encode(left, room, {LISTENER} if ack_every else ())
            assert encoded is not None, "a sample that fits no frame"
            speaker.sent(encoded)
            while pending:
                speaker.acknowledged(LISTENER, pending.pop())
            taken, left = left[: encoded.taken], left[encoded.taken :]
            counters.sizes.append(len(encoded.frame))
            counters.messages.append(encoded.taken)
            known[encoded.snapshot.digest] = taken
            arriving = late
            late = []
            if rng.random() >= loss:
                (late if rng.random() < disorder else arriving).append(encoded.frame)
                if rng.random() < disorder:
                    late.append(encoded.frame)
            for frame in arriving:
                _receive(listener, frame, known, types, counters)
                if ack_every and counters.received % ack_every == 0 and rng.random() >= loss:
                    assert listener.mark is not None
                    pending.append(listener.mark)
    return counters


def _receive(
    listener: Listener,
    frame: bytes,
    known: dict[bytes, Sequence[DenseSample]],
    types: dict[int, TypeSpec],
    counters: Counters,
) -> None:
    counters.received += 1
    try:
        decoded = listener.decode(frame)
    except PayloadError:
        counters.undecodable += 1
        return
    sent = known.get(decoded.snapshot.digest, ())
    counters.wrong += abs(len(sent) - len(decoded.samples))
    expected = _in_order(sent)
    for (stream_id, value), (sent_id, sent_value) in zip(decoded.samples, expected, strict=False):
        is_right = stream_id == sent_id and is_near(types[stream_id], value, sent_value)
        counters.wrong += not is_right


def _in_order(samples: Sequence[DenseSample]) -> list[tuple[int, Any]]:
    """As they come out of a frame: by stream, in order within each."""
    by_stream = sorted(samples, key=lambda each: each.stream_id)
    return [(each.stream_id, each.value) for each in by_stream]
