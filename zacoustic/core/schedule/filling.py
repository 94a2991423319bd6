"""The records of one frame: a selection that fits, in the order that needs the fewest delimiters.

Either a payload shows where its record ends, or LEN does; the last record needs neither. So one
record whose payload does not delimit itself moves to the end, and each other such record costs two
bytes more. After a HELLO or TAG the receiver may have another table and cannot measure anything, so
there LEN delimits every record but the last. A dense block extends to the end of the frame, so it
is the last.

Samples of dense streams are taken as long as their packed records fit, or the block of all of them
does. The block is written at the end if it is not larger than the records. A sample whose record
fits no frame may still be small beside a reference: it goes in a block only.
"""

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.stats import Cause, EngineStats, count
from zacoustic.core.schedule.queue import QueuedRecord
from zacoustic.core.schedule.sources import DenseSource
from zacoustic.core.values.dense import Encoded
from zacoustic.core.wire.frame import DELIMITER_BYTES, LONGEST_DELIMITED_BYTES, Control


class Filling:
    """The records of a frame that is being composed.

    Args:
        destination: Address, or `BROADCAST`.
        room_bytes: Room for them, bytes.
        now: The instant.
        dense: Encodes dense blocks.
        introduced: They follow a HELLO or TAG.
    """

    def __init__(
        self,
        destination: int,
        room_bytes: int,
        now: int,
        dense: DenseSource,
        *,
        introduced: bool,
    ) -> None:
        self._destination = destination
        self._room_bytes = room_bytes
        self._now = now
        self._dense = dense
        self._introduced = introduced
        self._records: list[QueuedRecord] = []
        self._used_bytes = 0
        self._ends = 0
        self._last: QueuedRecord | None = None
        self._samples: list[QueuedRecord] = []
        self._block: Encoded | None = None

    @property
    def items(self) -> tuple[QueuedRecord, ...]:
        """All payloads taken."""
        return (*self._records, *self._samples)

    @property
    def is_full(self) -> bool:
        """Whether no further record can fit."""
        return self.left_bytes < DELIMITER_BYTES

    @property
    def left_bytes(self) -> int:
        """The room left, bytes."""
        delimiters_bytes = DELIMITER_BYTES * max(0, self._ends - (not self._samples))
        return self._room_bytes - self._used_bytes - delimiters_bytes - self._samples_bytes()

    def add(self, item: QueuedRecord) -> bool:
        """Take a payload if it fits beside the others; return whether it does."""
        needs_end = self._needs_end(item)
        must_be_last = needs_end and item.size_bytes > LONGEST_DELIMITED_BYTES
        is_sample = self._last is None and (not must_be_last or item.block_bytes > 0)
        if is_sample and self._dense.admits(item, self._destination):
            return self._add_sample(item)
        if must_be_last and self._samples:
            return False
        if self._last is not None and (must_be_last or item.stream_id == self._last.stream_id):
            return False
        has_end = 1 if not self._samples else 0
        delimiters_bytes = DELIMITER_BYTES * max(0, self._ends + needs_end - has_end)
        needed_bytes = self._used_bytes + item.size_bytes + delimiters_bytes
        if needed_bytes + self._samples_bytes() > self._room_bytes:
            if not self._samples:
                return False
            # The block always has room beside all that is taken: if the item does not fit beside a
            # shorter block, the block before stays.
            block = self._write(self._samples, self._room_bytes - needed_bytes)
            if block is None:
                return False
            self._block = block
        self._records.append(item)
        self._used_bytes += item.size_bytes
        self._ends += needs_end
        if must_be_last:
            self._last = item
        return True

    def encode(self, stats: EngineStats) -> bytes:
        """Return the records, and enter their bytes into the ledger."""
        block = self._finished()
        if block is None:
            records, self._samples = [*self._records, *self._samples], []
            self._records = records = _open_end_last(records, introduced=self._introduced)
            return b"".join(self._record(item, item is records[-1], stats) for item in records)
        self._dense.sent(block, self._now)
        self._attribute_block(len(block.frame), stats)
        records_bytes = b"".join(self._record(item, False, stats) for item in self._records)
        return records_bytes + block.frame

    # Below the methods above

    def _needs_end(self, item: QueuedRecord) -> bool:
        return item.needs_end(introduced=self._introduced)

    def _add_sample(self, item: QueuedRecord) -> bool:
        samples = [*self._samples, item]
        others_bytes = self._used_bytes + DELIMITER_BYTES * self._ends
        room_bytes = self._room_bytes - others_bytes
        block = None
        if self._packed_bytes(samples) > room_bytes:
            block = self._write(samples, room_bytes)
            if block is None:
                return False
        self._samples, self._block = samples, block
        return True

    def _samples_bytes(self) -> int:
        if self._block is not None:
            return len(self._block.frame)
        return self._packed_bytes(self._samples)

    def _packed_bytes(self, samples: list[QueuedRecord]) -> int:
        """Return the size of the samples as records beside other records that all have an end.

        The last record of a frame needs no end, but every record before a block does.
        """
        if not samples:
            return 0
        # Samples without a type show no end, even if nothing stands before them.
        needed = sum(self._needs_end(item) for item in samples)
        ends = max(0, self._ends + needed - 1) - self._ends
        return sum(item.size_bytes for item in samples) + DELIMITER_BYTES * ends

    def _write(self, samples: list[QueuedRecord], room_bytes: int) -> Encoded | None:
        if room_bytes <= 0:
            return None
        return self._dense.encode(samples, self._destination, room_bytes, self._now)

    def _finished(self) -> Encoded | None:
        """Return the dense block; None: records cost no more, or there are no samples."""
        if not self._samples:
            return None
        others_bytes = self._used_bytes + DELIMITER_BYTES * self._ends
        room_bytes = self._room_bytes - others_bytes
        block = self._block or self._write(self._samples, room_bytes)
        packed_bytes = self._packed_bytes(self._samples)
        if block is not None and packed_bytes <= room_bytes:
            if not self._dense.savings.is_worth(len(block.frame), packed_bytes):
                return None
            self._dense.savings.book(packed_bytes - len(block.frame))
        return block

    def _record(self, item: QueuedRecord, is_last: bool, stats: EngineStats) -> bytes:
        record = bytearray(item.sync + item.prefix)
        if self._destination == BROADCAST:
            record += item.address
        record.append(item.code)
        record += item.head_at(self._now)
        if item.stamped:
            record.append(item.age_at(self._now))
        header_bytes = len(record)
        record += item.payload
        if not is_last and self._needs_end(item):
            record[:0] = bytes((Control.LEN, len(record)))
            header_bytes += DELIMITER_BYTES
        if item.cause is not None:
            stats.attribute(item.stream_id, item.cause, len(record))
        else:
            stats.attribute(item.stream_id, Cause.HEADER, header_bytes)
            stats.attribute(item.stream_id, Cause.PAYLOAD, len(item.payload))
            count(stats.transmitted, item.stream_id)
        return bytes(record)

    def _attribute_block(self, block_bytes: int, stats: EngineStats) -> None:
        """Attribute a block to its streams in proportion to their packed forms."""
        whole_bytes = sum(item.size_bytes for item in self._samples)
        before_bytes = shared_bytes = 0
        for item in self._samples:
            before_bytes += item.size_bytes
            share_bytes = block_bytes * before_bytes // whole_bytes - shared_bytes
            shared_bytes += share_bytes
            stats.attribute(item.stream_id, Cause.PAYLOAD, share_bytes)
            count(stats.transmitted, item.stream_id)


def _open_end_last(chosen: list[QueuedRecord], *, introduced: bool) -> list[QueuedRecord]:
    """Move one record that needs an end to the last place; keep the order within a stream."""
    open_ended = [item for item in chosen if item.needs_end(introduced=introduced)]
    if not open_ended:
        return chosen
    too_long = [item for item in open_ended if item.size_bytes > LONGEST_DELIMITED_BYTES]
    last = too_long[0] if too_long else open_ended[-1]
    return [item for item in chosen if item is not last] + [last]
