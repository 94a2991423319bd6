"""Dense streams on the water: what goes into a dense string, and what it may refer to.

How samples become a string is the affair of `zacoustic.core.dense`; here is who knows what. The
problem: a reference that the receiver does not hold makes a frame useless, and nobody wants to
spend frames on finding out what it holds. The idea:

- Every dense string that may be referred to has a number, mod 16, counted by its source over all
  that it sends. Whoever receives it remembers what it knows then: a *snapshot* for each number.
- A receiver tells the newest number that it has in frames that go anyway, in three bytes
  (`DenseAck`); if that came in a broadcast, also which of the eight before it. It never makes a
  frame for that. What is lost is made up for by the next one. Nine bits of the snapshot go with
  the number: who has missed sixteen strings means another one of that number.
- A string refers to the newest one that all its receivers have acknowledged, at most 11 numbers
  back. Where there is none it stands for itself. So what is received can be decoded, whatever was
  lost: nothing has to be asked for again.
- A peer that begins a new life, or asks who we are, knows nothing; what it has acknowledged is
  forgotten. A new epoch of this node begins anew as well.

A receiver keeps the last string of each number. A sender refers only to one of its last eleven, so
a receiver cannot take an older one of the same number for it, and finds it also for a string that
four others have overtaken. Where a frame is later than that, the check of the string refuses it.

A number costs half a byte, a reference as much. Where nobody acknowledges (a mute receiver, a
listener that is not listed) only each eighth string has a number.

A sample is dense where that is no dearer than its packed form, the receivers are not known to hold
another table, and nothing stands before its record: a dense stream's deletes, and samples in an
encoding of their own, are records like any other.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any, Final

import msgspec

from zacoustic.core.age import encode_age
from zacoustic.core.dense import DenseCodec, DenseSample, Encoded, Snapshot
from zacoustic.core.frame import DenseAck
from zacoustic.core.handshake import Handshake
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.payload import PayloadError, TypedCodec
from zacoustic.core.queue import Waiting
from zacoustic.core.streams import AGE_FIELD, StreamTable, TopicSpec

NUMBERS: Final = 16
LATEST: Final = 4
"""By how many numbers a string may be late, behind others of its source."""
FARTHEST: Final = NUMBERS - 1 - LATEST
"""How many numbers back a reference may be, so that a late string finds its own."""
_MAP_BITS: Final = 8
_CHECK_MASK: Final = 0x1FF
_UNHEARD_AFTER: Final = 16
_NUMBERED_EVERY: Final = 8


class _Said(msgspec.Struct):
    """A dense string of this node that may be referred to."""

    index: int
    snapshot: Snapshot
    known_to: set[int]


class _Heard(msgspec.Struct):
    """What is known of the dense strings of one source."""

    codec: DenseCodec
    snapshots: dict[int, Snapshot]
    places: dict[int, int]
    """Of each number: how many it was behind the first one."""
    newest: int = 0
    """Place of the newest."""
    is_map_wanted: bool = False
    is_unsaid: bool = False


class DenseStreams:
    """The dense strings of one node, its own and those it hears.

    Args:
        address: Address of the node.
        table: Its streams.
        handshake: Knows who holds another table.
    """

    def __init__(self, address: int, table: StreamTable, handshake: Handshake) -> None:
        self._address = address
        self._table = table
        self._handshake = handshake
        self._codec: DenseCodec | None = None
        self._said: deque[_Said] = deque(maxlen=FARTHEST)
        self._next = 0
        self._unheard = 0
        self._heard: dict[int, _Heard] = {}

    # What this node says

    def admits(self, item: Waiting, destination: int) -> bool:
        """Tell whether a payload that waits can be part of a dense string to `destination`."""
        if not item.is_dense:
            return False
        return not any(
            self._handshake.knows_difference(address)
            for address in self._audience([item], destination)
        )

    def encode(
        self, items: Sequence[Waiting], destination: int, room_bytes: int, now: int
    ) -> Encoded | None:
        """Write a string of all these payloads; None where they do not fit.

        Changes nothing: `said` does, for the string that is sent.
        """
        number, reference = self._reference(items, destination)
        encoded = self._own_codec().encode(
            [self._sample(item, now) for item in items],
            room_bytes,
            number=number,
            reference=reference,
        )
        return encoded if encoded is not None and encoded.taken == len(items) else None

    def said(self, encoded: Encoded, items: Sequence[Waiting], destination: int) -> None:
        """Note that a string is sent."""
        if not self._is_numbered():
            self._unheard += 1
            return
        self._said.append(_Said(self._next, encoded.snapshot, set()))
        self._next += 1
        self._unheard += 1

    def acknowledged(self, source: int, ack: DenseAck) -> str | None:
        """Take what a peer says it has; returns why it is dropped, or None."""
        if ack.address not in (0, self._address):
            return None  # for another node
        newest = next((each for each in reversed(self._said) if _names(ack, each)), None)
        if newest is None:
            return "unexpected_ack"
        self._unheard = 0
        for each in self._said:
            behind = newest.index - each.index
            if behind == 0 or (0 < behind <= _MAP_BITS and ack.before >> (behind - 1) & 1):
                each.known_to.add(source)
        return None

    # What this node hears

    def receive(
        self, source: int, string: bytes, *, broadcast: bool
    ) -> tuple[tuple[int, dict[str, Any]], ...] | None:
        """Read the string of a source that holds the same table.

        Returns:
            Stream ids and values; None: it is damaged, or refers to what is not known here.
        """
        heard = self._heard.get(source)
        if heard is None:
            heard = self._heard[source] = _Heard(self._codec_of(source), {}, {})
        try:
            decoded = heard.codec.decode(string, heard.snapshots)
        except PayloadError:
            return None
        if decoded.number is not None:
            number, ahead = decoded.number, (decoded.number - heard.newest) % NUMBERS
            if not heard.snapshots:
                ahead, heard.newest = 0, number
            if ahead < NUMBERS - LATEST:
                heard.newest += ahead
                heard.is_map_wanted, heard.is_unsaid = broadcast, True
            else:
                ahead -= NUMBERS
            late_by = min(ahead, 0)
            heard.snapshots[number] = decoded.snapshot
            heard.places[number] = heard.newest + late_by
        return decoded.samples

    def acks(self, destination: int, room_bytes: int) -> bytes:
        """Take what is to be acknowledged to the hearers of a frame, and fits in it."""
        taken = b""
        sources = list(self._heard) if destination == BROADCAST else [destination]
        for source in sources:
            heard = self._heard.get(source)
            if heard is None or not heard.is_unsaid:
                continue
            newest = heard.newest % NUMBERS
            before = None
            if heard.is_map_wanted:
                before = sum(
                    1 << bit
                    for bit in range(_MAP_BITS)
                    if heard.places.get((newest - 1 - bit) % NUMBERS) == heard.newest - 1 - bit
                )
            ack = DenseAck(
                address=source if destination == BROADCAST else 0,
                number=newest,
                check=heard.snapshots[newest].check & _CHECK_MASK,
                before=before or 0,
                has_map=before is not None,
            ).encode()
            if len(taken) + len(ack) <= room_bytes:
                taken += ack
                heard.is_unsaid = False
        return taken

    # What changes

    def peer_restarted(self, address: int) -> None:
        """A peer begins a new life: it knows nothing of us, and says nothing that we know."""
        self._heard.pop(address, None)
        self.peer_forgot(address)

    def peer_forgot(self, address: int) -> None:
        """A peer does not know us any more."""
        for each in self._said:
            each.known_to.discard(address)

    def table_changed(self) -> None:
        """This node holds another table: all that was said was said with the old one."""
        self._codec = None
        self._said.clear()
        self._heard.clear()

    # Below the methods above

    def _own_codec(self) -> DenseCodec:
        if self._codec is None:
            self._codec = self._codec_of(self._address)
        return self._codec

    def _codec_of(self, source: int) -> DenseCodec:
        types = {
            stream.stream_id: stream.dense_type
            for stream in self._table
            if stream.dense_type is not None and stream.may_publish(source)
        }
        return DenseCodec(types, model=self._table.model, digest=self._table.digest)

    def _sample(self, item: Waiting, now: int) -> DenseSample:
        stream = self._table.by_id(item.stream_id)
        # What the receiver would get from the packed form is what it gets from this one.
        assert isinstance(stream.codec, TypedCodec)
        value = stream.codec.decode(item.payload)
        if item.stamped:
            value[AGE_FIELD] = encode_age(now - item.queued_at)
        return DenseSample(item.stream_id, value, item.tick)

    def _audience(self, items: Iterable[Waiting], destination: int) -> set[int]:
        """Return who is to know what these payloads say."""
        if destination != BROADCAST:
            return {destination}
        audience: set[int] = set()
        for stream_id in {item.stream_id for item in items}:
            spec = self._table.by_id(stream_id).spec
            assert isinstance(spec, TopicSpec)
            listed = spec.subscribers
            if listed is None:
                listed = tuple(self._table.nodes) or tuple(self._handshake.peers())
            audience.update(listed)
        return audience - {self._address}

    def _is_numbered(self) -> bool:
        return self._unheard < _UNHEARD_AFTER or self._unheard % _NUMBERED_EVERY == 0

    def _reference(
        self, items: Sequence[Waiting], destination: int
    ) -> tuple[int | None, tuple[int, Snapshot] | None]:
        """Return the number of the next string, and how far back its reference is."""
        if not self._is_numbered():
            return None, None
        audience = self._audience(items, destination)
        for each in reversed(self._said):
            gap = self._next - each.index
            if gap > FARTHEST:
                break
            if audience and audience <= each.known_to:
                return self._next % NUMBERS, (gap, each.snapshot)
        return self._next % NUMBERS, None


def _names(ack: DenseAck, said: _Said) -> bool:
    is_number = said.index % NUMBERS == ack.number
    return is_number and said.snapshot.check & _CHECK_MASK == ack.check
