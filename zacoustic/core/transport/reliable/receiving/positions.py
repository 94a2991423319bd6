"""What the journal has of samples that come: where counts stand, and what is not handed on yet.

A position is written down before a sample is handed on and acknowledged, so no later life hands it
on twice. A node that dies between the two has not handed it on, though, and nobody sends it again.
So where the topic is journalled the sample is in the entry of its position, and is taken out when
it has been handed on. A life that finds one there hands it on: *again*, it says, since the one
before may have died right behind that.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.base.linktypes import LinkMetrics
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.transport.deliveries import SampleReceived
from zacoustic.core.transport.reliable.receiving.receivelane import ReceiveLane
from zacoustic.core.values.payload import PayloadError

_JOURNAL: Final = "in"

LaneKey = tuple[int, int, Instance]
"""Source, stream, instance."""


class _Sample(msgspec.Struct, frozen=True, array_like=True):
    """A sample that is about to be handed on."""

    payload: bytes
    deleted: bool
    encoding: str
    age_s: float | None


class _Position(msgspec.Struct, frozen=True, array_like=True):
    """What a journal keeps of a lane."""

    lineage: int
    expected: int
    former: tuple[int, ...] = ()
    digest: bytes = b""
    pending: tuple[_Sample, ...] = ()


class Positions:
    """The positions of one node in its journal.

    Args:
        journal: Where they are.
        table: The streams.
    """

    def __init__(self, journal: JournalPort, table: StreamTable) -> None:
        self._journal = journal
        self._table = table

    def write(
        self,
        key: LaneKey,
        lane: ReceiveLane,
        expected: int,
        then: Callable[[int], None] | None = None,
    ) -> None:
        """Write down that everything before a number is handed on, or pending in the lane."""
        position = _Position(lane.lineage, expected, lane.former)
        stream = self._table.get(key[1])
        if lane.pending and stream is not None:
            pending = tuple(_encoded(stream, sample) for sample in lane.pending)
            position = msgspec.structs.replace(position, digest=stream.digest, pending=pending)
        self._journal.write(_name(key), msgspec.msgpack.encode(position), then)

    def forget(self, key: LaneKey) -> None:
        """Delete the position of a key."""
        self._journal.write(_name(key), None)

    def recover(self, stored: Mapping[str, bytes]) -> Iterator[tuple[LaneKey, ReceiveLane]]:
        """Yield the lanes that a former life has left; what is pending in them is not handed on."""
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
                lane.pending = [
                    sample
                    for each in position.pending
                    if (sample := _decoded(stream, key, each)) is not None
                ]
            yield key, lane


def _name(key: LaneKey) -> str:
    source, stream_id, instance = key
    return f"{_JOURNAL}/{source}/{stream_id}/{bytes(instance).hex()}"


def _encoded(stream: Stream, sample: SampleReceived) -> _Sample:
    payload = b"" if sample.deleted else stream.codec.encode(sample.value)
    return _Sample(payload, sample.deleted, sample.encoding, sample.age_s)


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
        received_at=0,
        metrics=LinkMetrics(),
        again=True,
    )
