"""The receiver's journal: where counts stand, and which samples are not delivered yet.

A receiver journals its position before it delivers and acknowledges a sample, so that no later boot
epoch delivers the sample twice. If the node dies between the two, the sample is not delivered, and
nobody sends it again. So for a journalled topic the position's entry also holds the sample, until
it is delivered. After a restart the node delivers a sample that it finds there and flags it
`again`, since it may have died right after the first delivery.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.base.linktypes import LinkMetrics
from zacoustic.core.base.moments import Moment, Moments
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.transport.deliveries import SampleReceived
from zacoustic.core.transport.reliable.receiving.receivelane import ReceiveLane
from zacoustic.core.values.payload import PayloadError

_JOURNAL: Final = "in"

LaneKey = tuple[int, int, Instance]
"""Source, stream, instance."""


class _Sample(msgspec.Struct, frozen=True, array_like=True):
    """A sample that is about to be delivered."""

    payload: bytes
    deleted: bool
    encoding: str
    age_s: float | None
    age_error_s: float | None = None
    received: Moment | None = None
    """When it had arrived, if it has an age."""


class _Position(msgspec.Struct, frozen=True, array_like=True):
    """A lane's entry in the journal."""

    lineage: int
    expected: int
    former: tuple[int, ...] = ()
    digest: bytes = b""
    pending: tuple[_Sample, ...] = ()


class Positions:
    """The positions of one node in its journal.

    Args:
        journal: Holds the positions.
        table: The streams.
        moments: Find instants again after a restart.
    """

    def __init__(self, journal: JournalPort, table: StreamTable, moments: Moments) -> None:
        self._journal = journal
        self._table = table
        self._moments = moments

    def write(
        self,
        key: LaneKey,
        lane: ReceiveLane,
        expected: int,
        then: Callable[[int], None] | None = None,
    ) -> None:
        """Journal that each sample before a number is delivered, or pending in the lane."""
        position = _Position(lane.lineage, expected, lane.former)
        stream = self._table.get(key[1])
        if lane.pending and stream is not None:
            pending = tuple(self._encoded(stream, sample) for sample in lane.pending)
            position = msgspec.structs.replace(position, digest=stream.digest, pending=pending)
        self._journal.write(_name(key), msgspec.msgpack.encode(position), then)

    def forget(self, key: LaneKey) -> None:
        """Delete the position of a key."""
        self._journal.write(_name(key), None)

    def recover(self, stored: Mapping[str, bytes]) -> Iterator[tuple[LaneKey, ReceiveLane]]:
        """Yield the lanes from before the restart, with their undelivered samples in `pending`."""
        for name, value in stored.items():
            if not name.startswith(f"{_JOURNAL}/"):
                continue
            _, source, stream_id, instance = name.split("/")
            stream = self._table.get(int(stream_id))
            if stream is None:
                self._journal.write(name, None)
                continue
            position = msgspec.msgpack.decode(value, type=_Position)
            lane = ReceiveLane(position.lineage, position.expected, is_settled=False)
            lane.former = position.former
            key = (int(source), int(stream_id), tuple(bytes.fromhex(instance)))
            if position.digest == stream.digest:
                for each in position.pending:
                    sample = _decoded(stream, key, each)
                    if sample is not None:
                        lane.pending.append(sample)
                        lane.pending_since.append(self._moments.restored(each.received))
            yield key, lane

    # Below the methods above

    def _encoded(self, stream: Stream, sample: SampleReceived) -> _Sample:
        payload = b"" if sample.deleted else stream.codec.encode(sample.value)
        received = None if sample.age_s is None else self._moments.keep(sample.received_at)
        return _Sample(
            payload, sample.deleted, sample.encoding, sample.age_s, sample.age_error_s, received
        )


def _name(key: LaneKey) -> str:
    source, stream_id, instance = key
    return f"{_JOURNAL}/{source}/{stream_id}/{bytes(instance).hex()}"


def _decoded(stream: Stream, key: LaneKey, kept: _Sample) -> SampleReceived | None:
    try:
        value = None if kept.deleted else stream.codec.decode(kept.payload)
    except PayloadError:
        return None
    return SampleReceived(
        stream_id=key[1],
        source=key[0],
        instance=key[2],
        value=value,
        deleted=kept.deleted,
        encoding=kept.encoding,
        age_s=kept.age_s,
        age_error_s=kept.age_error_s,
        received_at=0,
        metrics=LinkMetrics(),
        again=True,
    )
