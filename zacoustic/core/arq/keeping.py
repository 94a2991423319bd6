"""What the journal has of samples that were published: of each lane its count, and each sample.

A sample is written before its first transmission and deleted when it has ended. The count goes
with it, so a life that comes later never gives a number to another sample: receivers would take it
for a repetition. What was published under another definition of the stream cannot be read by
anybody any more, and is given up.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Final

import msgspec

from zacoustic.core.arq.sendlane import KeptSample, Outgoing, SendLane
from zacoustic.core.events import DeliveryEnded, DeliveryOutcome
from zacoustic.core.journal import JournalPort
from zacoustic.core.streams import Stream, StreamTable
from zacoustic.errors import JournalUnavailableError

_JOURNAL: Final = "out"


class _KeptCount(msgspec.Struct, frozen=True, array_like=True):
    """A lane as the journal has it."""

    digest: bytes
    lineage: int
    next_number: int


class KeptLane(msgspec.Struct, frozen=True, kw_only=True):
    """A lane that a former life has left."""

    stream_id: int
    instance: tuple[int, ...]
    lineage: int
    next_number: int
    samples: tuple[tuple[int, KeptSample], ...]
    """With their numbers, in that order."""
    is_valid: bool
    """The stream is defined as it was; otherwise the lane has been deleted."""

    def cancelled(self, now: int) -> Iterator[DeliveryEnded]:
        """Yield the end of its samples, where their stream is not what it was."""
        for _, sample in self.samples:
            yield given_up(self.stream_id, sample.delivery_id, now)


class Keeping:
    """The lanes of one node in its journal.

    Args:
        journal: Where they are.
    """

    def __init__(self, journal: JournalPort) -> None:
        self._journal = journal

    def keep(
        self,
        stream: Stream,
        lane: SendLane,
        sample: Outgoing,
        kept: KeptSample,
        then: Callable[[int], None],
    ) -> None:
        """Write a sample down, and the count behind it."""
        self.keep_count(stream, lane)
        name = f"{_name(lane)}/{sample.number}"
        self._journal.write(name, msgspec.msgpack.encode(kept), then)

    def keep_count(self, stream: Stream, lane: SendLane) -> None:
        """Write down where the count of a lane stands."""
        count = _KeptCount(stream.digest, lane.lineage, lane.next_number)
        self._journal.write(_name(lane), msgspec.msgpack.encode(count))

    def check(self, stream: Stream) -> None:
        """Refuse a sample that is to be kept and cannot be.

        Raises:
            JournalUnavailableError: The journal cannot be written.
        """
        if stream.spec.journal and self._journal.failure:
            raise JournalUnavailableError(
                f"{stream.name}: not accepted: the journal cannot be written: "
                f"{self._journal.failure}",
                hint="what is accepted has to survive a restart",
            )

    def forget(self, lane: SendLane, sample: Outgoing) -> None:
        """Delete a sample that has ended; the count stays."""
        self._journal.write(f"{_name(lane)}/{sample.number}", None)

    def recover(self, stored: Mapping[str, bytes], table: StreamTable) -> Iterator[KeptLane]:
        """Yield what a former life has left.

        Args:
            stored: What the journal has.
            table: The streams as they are now.
        """
        numbers: dict[str, list[int]] = {}
        for key in stored:
            parts = key.split("/")
            if parts[0] == _JOURNAL:
                of_lane = numbers.setdefault("/".join(parts[:3]), [])
                of_lane += [int(number) for number in parts[3:]]
        for name in sorted(numbers):
            _, stream_id, instance = name.split("/")
            count = msgspec.msgpack.decode(stored[name], type=_KeptCount)
            stream = table.get(int(stream_id))
            is_valid = stream is not None and stream.digest == count.digest
            keys = {number: f"{name}/{number}" for number in sorted(numbers[name])}
            if not is_valid:
                for key in (name, *keys.values()):
                    self._journal.write(key, None)
            yield KeptLane(
                stream_id=int(stream_id),
                instance=tuple(bytes.fromhex(instance)),
                lineage=count.lineage,
                next_number=count.next_number,
                samples=tuple(
                    (number, msgspec.msgpack.decode(stored[key], type=KeptSample))
                    for number, key in keys.items()
                ),
                is_valid=is_valid,
            )


def given_up(stream_id: int, delivery_id: int, now: int) -> DeliveryEnded:
    """Return what is told of a sample whose stream is not what it was."""
    return DeliveryEnded(
        delivery_id=delivery_id,
        stream_id=stream_id,
        outcome=DeliveryOutcome.CANCELLED,
        missing=(),
        ended_at=now,
        detail="the stream is defined in another way now",
    )


def _name(lane: SendLane) -> str:
    return f"{_JOURNAL}/{lane.key[0]}/{bytes(lane.key[2:]).hex()}"
