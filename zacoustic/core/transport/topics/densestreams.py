"""Dense blocks on the channel: which samples share one, and which blocks are acknowledged.

`zacoustic.core.values.dense` makes blocks of samples and knows which blocks they may refer to. This
module tracks the listeners:

- A block refers to one that all its listeners hold: the one node of a unicast frame, or, in a
  broadcast, all listed subscribers of its streams. Without such a block it is independent. So every
  received block can be decoded, whatever was lost, and no block is ever requested again.
- A link may hand over a frame late, within the settling time after the longest delay. In that time
  the node sends at most as many counted blocks (`zacoustic.core.values.dense.stream.references`) as
  can be told apart; further blocks are independent.
- A node acknowledges the newest block that it holds of a source in frames that go there anyway, in
  three bytes (`DenseAck`). It makes a frame for that only where the source fills the link and this
  node alone listens to it (`offer`): there blocks with a reference save more than such a frame
  takes, and the source pauses anyway, now and then, to listen.
- `Savings` counts what blocks save compared with records, and what their acknowledgements cost.
  While the balance is negative, the node sends records: a dense stream costs no more airtime than a
  packed one.
- A peer that begins a new boot epoch, or asks who this node is, holds nothing. A new epoch of this
  node starts again as well.
- A dense block needs the whole table, since a node that cannot read it to the end cannot read it at
  all. A peer that is known to have another table gets records; the streams that agree still cross.

Deletes of a dense stream, and samples with an encoding of their own, are records.
"""

import copy
from collections import deque
from collections.abc import Collection, Iterable, Sequence
from typing import Any, Final

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.parts import Offer
from zacoustic.core.base.stats import Cause
from zacoustic.core.peers.handshake import latest_ns
from zacoustic.core.peers.reception import Heard
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.queue import QueuedRecord
from zacoustic.core.schedule.savings import Savings
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import AGE_FIELD, Stream
from zacoustic.core.transport.subscriptions.subscriptions import Subscriptions
from zacoustic.core.values.dense import DenseCodec, DenseSample, Encoded, Listener, Speaker
from zacoustic.core.values.dense.stream.references import REACH
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.wire.frame import DenseAck

# An acknowledgement is three bytes and may save about as many in each later block. Where blocks are
# that small, one acknowledgement answers several.
_WORTH_AN_ACK_BYTES: Final = 6
# A block that is repeated although it was acknowledged means that the acknowledgement was lost; it
# is sent again now and then.
_REPEATED_BYTES: Final = 1
# So many blocks in a row, each in a full frame, are worth a frame with an acknowledgement.
_WORTH_A_FRAME: Final = 3
# Blocks are in a row if they come within so many times the airtime of the largest frame.
_ROW_FRAMES: Final = 4


class _Heard:
    """What this node has heard from one source."""

    def __init__(self, codec: DenseCodec) -> None:
        self.listener = Listener(codec)
        self.said_mark: int | None = None
        """The mark that was acknowledged last."""
        self.row = 0
        """How many blocks have come one after the other since then, each in a full frame."""
        self.came_at = 0
        """When the last block came, ns."""
        self.unsaid_bytes = 0
        """Bytes of the blocks since then. A steady stream is the same block again and again until
        its source learns that it is held here, so each repetition counts."""


class DenseStreams:
    """The dense blocks that one node sends and receives.

    Args:
        context: What the components of its engine share.
        subscriptions: Knows the subscribers of on-demand topics.
    """

    def __init__(self, context: Context, subscriptions: Subscriptions) -> None:
        self._address = context.address
        self._table = context.table
        self._handshake = context.handshake
        self._subscriptions = subscriptions
        self._pacers = context.pacers
        self._queue = context.queue
        self.savings = Savings()
        """What this node's blocks have saved."""
        self._speaker: Speaker | None = None
        self._counted_at: deque[int] = deque(maxlen=REACH)
        self._heard: dict[int, _Heard] = {}
        self._row = 0
        """How many blocks in a row this node has sent, each in a full frame."""
        self._sent_at = 0
        """When it sent the last one, ns."""
        context.reception.on(DenseAck, self.acknowledged)
        context.epoch.began.connect(self.epoch_changed)
        context.peers.restarted.connect(self.peer_restarted)
        context.peers.asked.connect(self.peer_asked)
        context.peers.forgotten.connect(self.peer_forgotten)

    # Blocks of this node

    def admits(self, item: QueuedRecord, destination: int) -> bool:
        """Return whether a waiting payload can be part of a dense block to `destination`."""
        return item.dense_value is not None and not any(
            self._handshake.knows_difference(address)
            for address in self._receivers([item], destination)
        )

    def encode(
        self, items: Sequence[QueuedRecord], destination: int, room_bytes: int, now: int
    ) -> Encoded | None:
        """Encode a block of all these payloads; return None if they do not fit."""
        if self._speaker is None:
            codec = self._codec_of(self._address)
            assert codec is not None  # a node with samples of dense streams publishes some
            self._speaker = Speaker(codec)
        samples = [self._sample(item, now) for item in items]
        hearers = {destination} if destination != BROADCAST else self._hearers()
        apart = len(self._counted_at) == REACH and now < self._counted_at[0] + self._latest_ns
        encoded = self._speaker.encode(samples, room_bytes, hearers, apart=apart)
        return encoded if encoded is not None and encoded.taken == len(items) else None

    def alone_bytes(self, item: QueuedRecord, room_bytes: int, now: int) -> int:
        """Return the size of a block with one payload, bytes; 0: it does not fit."""
        if not self.admits(item, item.destination):
            return 0
        encoded = self.encode([item], item.destination, room_bytes, now)
        return 0 if encoded is None else len(encoded.frame)

    def sent(self, encoded: Encoded, now: int) -> None:
        """Record that a block is sent; until then it is a draft."""
        assert self._speaker is not None
        follows = self._follows(encoded.frame, self._sent_at, now)
        self._row, self._sent_at = self._row + 1 if follows else 0, now
        if not encoded.is_apart:
            self._counted_at.append(now)
        self._speaker.sent(encoded)

    @property
    def fills_link(self) -> bool:
        """Whether block after block of this node fills a frame, and one node listens to them.

        If that node knows the pauses of this one, it acknowledges them there.
        """
        return self._row >= _WORTH_A_FRAME and len(self._hearers()) == 1

    def acknowledged(self, heard: Heard, ack: DenseAck) -> str | None:
        """Take a peer's acknowledgement; return why it is dropped, or None."""
        if ack.address not in (0, self._address):
            return None  # for another node
        self.savings.book(-len(ack.encode()))
        if self._speaker is None or not self._speaker.acknowledged(heard.source, ack.mark):
            return "unexpected_ack"
        return None

    # Blocks of other nodes

    def due_at(self, now: int) -> int | None:
        """Return when to make a frame for an acknowledgement, ns; None: it is not worth one."""
        return now if self._heard and self._asking(now) is not None else None

    def offer(self, now: int) -> Offer | None:
        """Offer a frame for an acknowledgement."""
        source = self._asking(now) if self._heard else None
        if source is None:
            return None
        return Offer(destination=source, must_go=Cause.ACK, is_reply=True)

    def concerns_us(self, source: int, destination: int) -> bool:
        """Return whether this node can decode the blocks from a source to `destination`.

        A source does not wait for acknowledgements from a node that subscribes to none of the
        streams in its blocks; such a node would take one reference for another.
        """
        streams = self._streams_of(source)
        return (
            destination != BROADCAST
            or not streams
            or any(
                source in self._subscriptions.wanted(stream.stream_id)
                if stream.is_on_demand
                else stream.may_subscribe(self._address)
                for stream in streams
            )
        )

    def receive(
        self, source: int, block: bytes, now: int
    ) -> tuple[tuple[int, dict[str, Any]], ...]:
        """Decode the block of a source that has the same table; return stream ids and values.

        Raises:
            PayloadError: It is damaged, or refers to a block that is not held here.
        """
        heard = self._heard.get(source)
        if heard is None:
            codec = self._codec_of(source)
            if codec is None:
                raise PayloadError("a source without dense streams")
            heard = self._heard[source] = _Heard(codec)
        # A source does not wait for a node that has acknowledged nothing: no block refers to its
        # own.
        decoded = heard.listener.decode(block, alone=heard.said_mark is None)
        is_unsaid = heard.listener.mark != heard.said_mark
        heard.unsaid_bytes += len(block) if is_unsaid else _REPEATED_BYTES
        follows = self._follows(block, heard.came_at, now)
        heard.row, heard.came_at = heard.row + 1 if follows else 0, now
        # Copy: a repeated block is decoded only once, and an application may change its values.
        return copy.deepcopy(decoded.samples)

    def acks(self, destination: int, room_bytes: int) -> bytes:
        """Take the acknowledgements for the receivers of a frame, as many as fit."""
        taken = b""
        for source in sorted(self._heard) if destination == BROADCAST else [destination]:
            heard = self._heard.get(source)
            if heard is None or heard.listener.mark is None:
                continue
            if heard.unsaid_bytes < _WORTH_AN_ACK_BYTES:
                continue
            address = source if destination == BROADCAST else 0
            ack = DenseAck(address, heard.listener.mark).encode()
            if len(taken) + len(ack) <= room_bytes:
                taken += ack
                heard.said_mark, heard.unsaid_bytes = heard.listener.mark, 0
                heard.row = 0
        return taken

    # Changes

    def peer_restarted(self, address: int, epoch: int, now: int) -> None:
        """Forget the blocks of a peer that begins a new boot epoch; it has forgotten ours too."""
        self._heard.pop(address, None)
        self.peer_asked(address, now)

    def peer_forgotten(self, address: int, now: int) -> None:
        """Forget a node."""
        self.peer_restarted(address, 0, now)

    def peer_asked(self, address: int, now: int) -> None:
        """Forget which blocks a peer holds that no longer knows this node."""
        if self._speaker is not None:
            self._speaker.forget(address)

    def epoch_changed(self, now: int) -> None:
        """Forget all blocks, sent and received: this node begins a new epoch."""
        self._speaker = None
        self._heard.clear()

    # Below the methods above

    @property
    def _latest_ns(self) -> int:
        """The longest time from the start of a block's transmission to its arrival, ns."""
        return latest_ns(self._handshake.settling_ns)

    def _follows(self, block: bytes, since: int, now: int) -> bool:
        """Return whether a block fills a frame, soon after the one before."""
        times, largest_bytes = self._pacers.times, self._queue.largest_bytes
        if times is None or largest_bytes is None:
            return False
        most_ns = _ROW_FRAMES * times.airtime_ns(times.mtu_bytes)
        return now - since <= most_ns and len(block) * 2 > largest_bytes

    def _asking(self, now: int) -> int | None:
        """Return the source whose blocks are worth a frame with an acknowledgement, or None."""
        for source, heard in self._heard.items():
            if heard.row >= _WORTH_A_FRAME and self._listens_alone(source):
                break
        else:
            return None
        listening = self._pacers.times.listening if self._pacers.times is not None else None
        if listening is not None and listening.next_invitation_at(now, now) is None:
            return None  # it would meet a frame of the source: its pauses are not known
        return source

    def _listens_alone(self, source: int) -> bool:
        """Return whether no other node listens to the blocks of a source."""
        return self._listeners(self._streams_of(source)) - {source} == {self._address}

    def _streams_of(self, source: int) -> list[Stream]:
        return [
            stream
            for stream in self._table
            if stream.dense_type is not None and stream.may_publish(source)
        ]

    def _codec_of(self, source: int) -> DenseCodec | None:
        types = {
            stream.stream_id: stream.dense_type
            for stream in self._streams_of(source)
            if stream.dense_type is not None
        }
        if not types:
            return None
        return DenseCodec(types, model=self._table.model, digest=self._table.digest)

    def _sample(self, item: QueuedRecord, now: int) -> DenseSample:
        assert item.dense_value is not None
        # At full precision: an attitude rounded first would be off by more than half a step.
        value = dict(item.dense_value)
        if item.stamped:
            value[AGE_FIELD] = item.age_at(now)
        return DenseSample(item.stream_id, value, item.tick)

    def _receivers(self, items: Iterable[QueuedRecord], destination: int) -> set[int]:
        """Return the listeners of these payloads."""
        if destination != BROADCAST:
            return {destination}
        streams = map(self._table.by_id, {item.stream_id for item in items})
        return self._subscribers(streams)

    def _hearers(self) -> set[int]:
        """Return the listeners of broadcast blocks, with any contents."""
        subscribers = self._subscribers(self._streams_of(self._address))
        return {each for each in subscribers if not self._handshake.knows_difference(each)}

    def _subscribers(self, streams: Iterable[Stream]) -> set[int]:
        return self._listeners(streams) - {self._address}

    def _listeners(self, streams: Iterable[Stream]) -> set[int]:
        found: set[int] = set()
        for stream in streams:
            assert isinstance(stream.spec, TopicSpec)
            listed: Collection[int] | None = self._subscriptions.subscribers(stream)
            if listed is None:
                listed = stream.spec.subscribers
            if listed is None:
                listed = tuple(self._table.nodes) or tuple(self._handshake.peers())
            found.update(listed)
        return found
