"""Samples of latched topics that are delivered, for a receiver that has forgotten them.

The last samples of each key stay here when they have ended. If a receiver begins another boot epoch
(`zacoustic.core.transport.topics.latched`), they go to it again under their old numbers, with SYNC
and the oldest of these numbers as the floor. So a receiver whose journal has its position answers
that it has them all. The newest sample goes first, and the others once the receiver has shown that
it lacks them: one that has lost nothing costs one record and one answer for each key.

Such a sample is repeated, paced and given up as any other, but has no outcome to report.
"""

from collections import deque
from collections.abc import Iterator
from typing import Final

from zacoustic.core.base.qos import Durability
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.deliveries import DeliveryOutcome
from zacoustic.core.transport.reliable.sending.sendlane import OutgoingSample, SendLane

LIMIT_BYTES: Final = 4 * 1024 * 1024
"""Payloads of all keys together; the key that was delivered to least recently makes room."""
_MOST_SAMPLES: Final = 32
"""So many samples of a key at most: more would hold up those published later."""


class LatchedSamples:
    """The delivered samples of the latched topics of one node.

    Args:
        limit_bytes: Space for their payloads.
    """

    def __init__(self, limit_bytes: int = LIMIT_BYTES) -> None:
        self._limit_bytes = limit_bytes
        self._bytes = 0
        self._of: dict[SendLane, deque[OutgoingSample]] = {}

    def __iter__(self) -> Iterator[SendLane]:
        return iter(self._of)

    def ended(
        self, stream: Stream, lane: SendLane, sample: OutgoingSample, outcome: DeliveryOutcome
    ) -> None:
        """Keep a sample that all its receivers have."""
        is_latched = stream.qos.durability is Durability.TRANSIENT_LOCAL
        if not is_latched or sample.made_of is None or outcome is not DeliveryOutcome.DELIVERED:
            return
        if sample.is_delete:
            self.forget(lane)
            return
        kept = self._of.pop(lane, deque())
        self._of[lane] = kept
        others = [each for each in kept if each.number != sample.number]
        kept.clear()
        kept.extend(sorted([*others, sample], key=lambda each: each.number))
        self._bytes += sample.made_of.size_bytes if len(others) < len(kept) else 0
        self.superseded(stream, lane)
        while self._bytes > self._limit_bytes:
            self.forget(next(iter(self._of)))

    def superseded(self, stream: Stream, lane: SendLane) -> None:
        """Drop what newer samples of a key have displaced."""
        kept = self._of.get(lane, deque())
        most = min(stream.qos.depth, _MOST_SAMPLES)
        while kept and kept[0].number < max(lane.next_number - most, lane.spans.newest.first):
            self._drop(kept.popleft())
        lane.oldest_kept = kept[0].number if kept else None

    def forget(self, lane: SendLane) -> None:
        """Drop all samples of a key."""
        lane.oldest_kept = None
        for sample in self._of.pop(lane, ()):
            self._drop(sample)

    def again(
        self, stream: Stream, lane: SendLane, address: int, now: int
    ) -> OutgoingSample | None:
        """Put the samples of a key back for one receiver; return the newest; None: none."""
        first = lane.spans.of(address, max(0, lane.next_number - 1)).first
        most = min(stream.qos.depth, _MOST_SAMPLES)
        first = max(first, lane.next_number - most)
        kept = [
            each
            for each in self._of.get(lane, ())
            if each.number >= first and (each.expires_at is None or each.expires_at > now)
        ]
        return lane.give_again(stream, kept, first, address)

    def _drop(self, sample: OutgoingSample) -> None:
        assert sample.made_of is not None
        self._bytes -= sample.made_of.size_bytes
