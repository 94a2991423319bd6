"""The publisher's journal: for each lane its count, and each of its samples.

A sample is journalled before its first transmission and deleted when it has ended. The count is
journalled with it, so no later boot epoch gives the number to another sample, which receivers would
take for a repetition. Samples that were published under another definition of the stream cannot be
read by anybody, and are given up.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.transport.deliveries import DeliveryEnded, DeliveryOutcome
from zacoustic.core.transport.outcomes import Outcomes
from zacoustic.core.transport.reliable.sending.sendlane import (
    JournalledSample,
    OutgoingSample,
    SendLane,
)
from zacoustic.core.transport.reliable.spans import Span
from zacoustic.errors import JournalUnavailableError

_JOURNAL: Final = "out"
OTHER_STREAM: Final = "the stream is defined in another way now"
"""Why a sample is given up: nobody could read it."""
NO_COUNT: Final = "the journal is damaged: the count of its stream is missing"
"""The same: nobody knows which numbers the receivers have seen."""


class _JournalledCount(msgspec.Struct, frozen=True, array_like=True):
    """The count of a lane in the journal."""

    digest: bytes
    next_number: int
    spans: tuple[Span, ...]
    own: dict[int, Span] = {}


class JournalledLane(msgspec.Struct, frozen=True, kw_only=True):
    """A lane from before the restart."""

    stream_id: int
    instance: tuple[int, ...]
    next_number: int
    spans: tuple[Span, ...]
    own: dict[int, Span]
    samples: tuple[tuple[int, JournalledSample], ...]
    """The samples with their numbers, in that order."""


class Keeping:
    """The lanes of one node in its journal.

    Args:
        journal: Holds the lanes.
        outcomes: Tells the ends of samples.
    """

    def __init__(self, journal: JournalPort, outcomes: Outcomes) -> None:
        self._journal = journal
        self._outcomes = outcomes
        self.highest_id = 0
        """The highest delivery id that was found in the journal."""

    def keep(
        self,
        stream: Stream,
        lane: SendLane,
        sample: OutgoingSample,
        kept: JournalledSample,
        then: Callable[[int], None],
    ) -> None:
        """Journal a sample and the count of its lane."""
        self.keep_count(stream, lane)
        name = f"{_name(lane)}/{sample.number}"
        self._journal.write(name, msgspec.msgpack.encode(kept), then)

    def keep_count(self, stream: Stream, lane: SendLane) -> None:
        """Journal the count of a lane."""
        spans = lane.spans
        count = _JournalledCount(stream.digest, lane.next_number, tuple(spans.all), spans.own)
        self._journal.write(_name(lane), msgspec.msgpack.encode(count))

    def check(self, stream: Stream) -> None:
        """Refuse a sample that must be journalled and cannot be.

        Raises:
            JournalUnavailableError: The journal cannot be written.
        """
        if stream.journals_sent and self._journal.failure:
            raise JournalUnavailableError(
                f"{stream.name}: not accepted: the journal cannot be written: "
                f"{self._journal.failure}",
                hint="what is accepted has to survive a restart",
            )

    def forget(
        self, lane: SendLane, sample: OutgoingSample, then: Callable[[int], None] | None = None
    ) -> None:
        """Delete a sample that has ended; the count stays."""
        self._journal.write(f"{_name(lane)}/{sample.number}", None, then)

    def recover(
        self,
        stored: Mapping[str, bytes],
        table: StreamTable,
    ) -> Iterator[JournalledLane]:
        """Yield the lanes from before the restart.

        Args:
            stored: The content of the journal.
            table: The streams as they are now.
        """
        self.highest_id = self._outcomes.highest_id
        numbers: dict[str, list[int]] = {}
        for key in stored:
            parts = key.split("/")
            if parts[0] == _JOURNAL:
                of_lane = numbers.setdefault("/".join(parts[:3]), [])
                of_lane += [int(number) for number in parts[3:]]
        for name in sorted(numbers):
            _, stream_id, instance = name.split("/")
            stream = table.get(int(stream_id))
            count: _JournalledCount | None = None
            if name in stored:
                count = msgspec.msgpack.decode(stored[name], type=_JournalledCount)
            samples = [
                (number, msgspec.msgpack.decode(stored[f"{name}/{number}"], type=JournalledSample))
                for number in sorted(numbers[name])
            ]
            self.highest_id = max([self.highest_id, *(each.delivery_id for _, each in samples)])
            for number, sample in samples:
                if self._outcomes.has(sample.delivery_id):  # a crash came between the two writes
                    self._journal.write(f"{name}/{number}", None)
            samples = [each for each in samples if not self._outcomes.has(each[1].delivery_id)]
            if count is None or stream is None or stream.digest != count.digest:
                why = NO_COUNT if count is None else OTHER_STREAM
                for number, sample in samples:
                    ended = given_up(int(stream_id), sample.delivery_id, why, 0)
                    self._outcomes.tell(ended, is_dated=False)
                    self._journal.write(f"{name}/{number}", None)
                if count is not None:
                    self._journal.write(name, None)
                continue
            yield JournalledLane(
                stream_id=int(stream_id),
                instance=tuple(bytes.fromhex(instance)),
                next_number=count.next_number,
                spans=count.spans,
                own=count.own,
                samples=tuple(samples),
            )


def given_up(stream_id: int, delivery_id: int, detail: str, now: int) -> DeliveryEnded:
    """Return the event for a sample from before the restart that can never be sent."""
    return DeliveryEnded(
        delivery_id=delivery_id,
        stream_id=stream_id,
        outcome=DeliveryOutcome.CANCELLED,
        missing=(),
        ended_at=now,
        detail=detail,
    )


def _name(lane: SendLane) -> str:
    return f"{_JOURNAL}/{lane.key[0]}/{bytes(lane.key[2:]).hex()}"
