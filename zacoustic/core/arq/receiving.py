"""The subscriber's side: samples in their order, each once, and what is owed for them."""

from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.arq.numbers import Ack, resolve, resolve_floor
from zacoustic.core.arq.timing import LinkTimes
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.events import SampleReceived
from zacoustic.core.frame import Control, Sync
from zacoustic.core.journal import JournalPort
from zacoustic.core.keys import Instance
from zacoustic.core.qos import Priority, Qos
from zacoustic.core.queue import TransmitQueue, Waiting
from zacoustic.core.stats import Cause
from zacoustic.core.streams import Stream, StreamTable, TopicSpec

ACK_LANE: Final = 4
_JOURNAL: Final = "in"

_LaneKey = tuple[int, int, Instance]
"""Source, stream, instance."""


class _Position(msgspec.Struct, frozen=True, array_like=True):
    """What a journal keeps of a lane."""

    lineage: int
    expected: int


class _ReceiveLane:
    """Samples of one key of one publisher."""

    __slots__ = ("expected", "held", "in_sync", "kept", "lineage")

    def __init__(self, lineage: int, expected: int) -> None:
        self.lineage = lineage
        self.expected = expected
        """The next number to hand on."""
        self.kept = expected
        """Everything before this number is written down: it may be acknowledged."""
        self.held: dict[int, SampleReceived] = {}
        """Samples that came too early, by number."""
        self.in_sync = True
        """The publisher's last sample came without SYNC: a short ACK is understood."""

    def hand_on(self, up_to: int) -> list[SampleReceived]:
        """Take what is in order now, and what is held below a number; what lacks there is over."""
        ready = [self.held.pop(number) for number in sorted(self.held) if number < up_to]
        self.expected = max(self.expected, up_to)
        while self.expected in self.held:
            ready.append(self.held.pop(self.expected))
            self.expected += 1
        return ready

    def ack(self) -> Ack:
        """Return what may be acknowledged."""
        held = 0
        for number in self.held:
            # Numbers between `kept` and `expected` are being written down: they are not held.
            held |= 1 << number - self.kept - 1
        return Ack(self.kept, held if self.kept == self.expected else 0)


class ReliableReceiving:
    """What came reliably from other nodes.

    Args:
        address: Address of this node.
        table: Its streams.
        queue: Takes ACKs.
        journal: Keeps the positions.
        emit: Takes the samples in their order.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        *,
        queue: TransmitQueue,
        journal: JournalPort,
        emit: Callable[[SampleReceived], None],
    ) -> None:
        self._address = address
        self._table = table
        self._queue = queue
        self._journal = journal
        self._emit = emit
        self._lanes: dict[_LaneKey, _ReceiveLane] = {}
        self._times: LinkTimes | None = None

    def use_link(self, times: LinkTimes) -> None:
        """Take the airtimes of a link."""
        self._times = times

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Go on from the positions that a former life has left."""
        for key, value in stored.items():
            if not key.startswith(f"{_JOURNAL}/"):
                continue
            _, source, stream_id, instance = key.split("/")
            if self._table.get(int(stream_id)) is None:
                self._journal.write(key, None)
                continue
            position = msgspec.msgpack.decode(value, type=_Position)
            lane = _ReceiveLane(position.lineage, position.expected)
            self._lanes[int(source), int(stream_id), tuple(bytes.fromhex(instance))] = lane

    def receive(
        self,
        stream: Stream,
        low_number: int,
        sync: Sync | None,
        sample: SampleReceived,
        now: int,
    ) -> str | None:
        """Take a sample.

        Args:
            stream: Its topic.
            low_number: The seven bits of its number.
            sync: What stands before it.
            sample: The event to hand on when it is its turn.
            now: The instant.

        Returns:
            Why it is dropped, or None.
        """
        key = (sample.source, stream.stream_id, sample.instance)
        lane = self._lanes.get(key)
        ready: list[SampleReceived] = []
        if sync is not None and (lane is None or lane.lineage != sync.lineage):
            if lane is not None:
                # What the old count still lacks will never come.
                ready = lane.hand_on(max(lane.held, default=lane.expected))
            lane = self._lanes[key] = _ReceiveLane(sync.lineage, sync.floor)
        if lane is None:
            self._owe(key, Ack(0, knows=False), None, stream, now)
            return "out_of_sync"
        lane.in_sync = sync is None
        if sync is not None:
            ready += lane.hand_on(resolve_floor(sync.floor, lane.expected))
        number = resolve(low_number, lane.expected)
        reason = None
        if number < lane.expected or number in lane.held:
            reason = "repeated_sample"
        else:
            lane.held[number] = sample
            ready += lane.hand_on(number - stream.qos.depth + 1)
        if ready:
            self._keep(key, lane, ready, stream)
        else:
            self._owe_ack(key, lane, stream, now)
        return reason

    # Below the methods above

    def _keep(
        self, key: _LaneKey, lane: _ReceiveLane, ready: list[SampleReceived], stream: Stream
    ) -> None:
        """Write the position down, then hand the samples on."""
        expected = lane.expected

        def kept(at: int) -> None:
            for sample in ready:
                self._emit(sample)
            lane.kept = max(lane.kept, expected)
            if self._lanes.get(key) is lane:
                self._owe_ack(key, lane, stream, at)

        source, stream_id, instance = key
        name = f"{_JOURNAL}/{source}/{stream_id}/{bytes(instance).hex()}"
        position = _Position(lane.lineage, expected)
        self._journal.write(name, msgspec.msgpack.encode(position), kept)

    def _owe_ack(self, key: _LaneKey, lane: _ReceiveLane, stream: Stream, now: int) -> None:
        sync = None if lane.in_sync else Sync(lane.lineage, lane.kept)
        self._owe(key, lane.ack(), sync, stream, now)

    def _owe(self, key: _LaneKey, ack: Ack, sync: Sync | None, stream: Stream, now: int) -> None:
        source, stream_id, instance = key
        item = Waiting(
            stream_id=stream_id,
            destination=source,
            prefix=bytes((Control.ACK,)),
            address=bytes((source,)),
            head=bytes(instance),
            payload=ack.encode(),
            delimits_itself=True,
            cause=Cause.ACK,
            queued_at=now,
        )
        item.sync = sync.encode() if sync else b""
        self._queue.replace((stream_id, ACK_LANE, source, *instance), item, self._qos(stream))

    def _qos(self, stream: Stream) -> Qos:
        """Return how an ACK waits: for the end of the publisher's frames, and its turn."""
        assert self._times is not None
        linger_ns = self._rank(stream) * self._times.ack_slot_ns
        if stream.qos.priority is not Priority.REAL_TIME:
            linger_ns += self._times.ack_linger_ns
        return Qos(priority=Priority.INTERACTIVE_HIGH, linger_s=linger_ns / NS_PER_S)

    def _rank(self, stream: Stream) -> int:
        """Count the subscribers that acknowledge before this one."""
        assert isinstance(stream.spec, TopicSpec)
        subscribers = stream.spec.subscribers
        listed = sorted(self._table.nodes if subscribers is None else subscribers)
        return listed.index(self._address) if self._address in listed else 0
