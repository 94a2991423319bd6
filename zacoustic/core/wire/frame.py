"""The records inside a frame, native profile: docs/wire.md is the normative text, with vectors.

A frame is a sequence of *records*. The first byte says which kind::

    0x00         padding
    0x01…0xAF    stream id: content of that stream follows
    0xB0…0xBF    control, below
    0xC0…0xFF    dense block, to the end of the frame (`zacoustic.core.values.dense`)

What follows a stream id is fixed by the stream, which both ends have in their tables: a
best-effort sample costs its id and nothing else. Nothing in a record tells its length, unless
its payload delimits itself or the sender wrote the control ``LEN`` before it. So a frame ends its
own last record; a receiver that meets an id it cannot measure takes the rest of the frame as that
record.

Two frozen controls never change, in any version: ``HELLO`` and ``TAG``. They let two ends find
out that they speak different versions or hold different tables.
"""

import enum
from collections.abc import Callable, Iterator
from typing import Final

import msgspec

from zacoustic.core.values.encoding import decode_prefix
from zacoustic.core.wire.access import CLOCK_BYTES, TURN_BYTES, AccessControl, ClockTime, Turn
from zacoustic.core.wire.objects import Feedback, Fragment, decode_feedback, decode_fragment
from zacoustic.core.wire.subscriptions import SUBSCRIBE_BYTES, SUBSCRIBE_CODE, Subscribe

WIRE_VERSION: Final = 1
"""Version of this wire format, in every HELLO."""

LAST_STREAM_ID: Final = 0xAF
ASSURED: Final = 0
"""Address of a CONFIRM in a unicast frame: the node that the frame is for, which has confirmed the
sender."""
VOUCHED: Final = 0xFF
"""Address of a CONFIRM in a unicast frame: a provisional confirm for the destination."""
DENSE_FROM: Final = 0xC0
"""A dense string begins with a byte from here on."""
LONGEST_DELIMITED_BYTES: Final = 255
"""Longest record that LEN can delimit."""


class Control(enum.IntEnum):
    """Control codes; all others are reserved."""

    HELLO = 0xB0
    """Version, boot epoch (2), table digest (4): who sends, and with which table. Frozen for
    ever."""
    TAG = 0xB1
    """Boot epoch (2): the sender of this frame does not know that its hearers know its table.
    Frozen for ever."""
    LEN = 0xB2
    """Length (1) of the record that follows, with its prefixes and its id."""
    DELETE = 0xB3
    """Prefix: the record deletes its key; it has no payload."""
    ENCODING = 0xB4
    """Prefix: encoding of the sample (`zacoustic.core.values.encoding`), where it is not the
    stream's."""
    CONFIRM = 0xB5
    """Address (1), epoch (2): the sender knows the table of that node's epoch, and has the same."""
    ASK = 0xB6
    """Address (1), stream id or 0 (1): that node is asked for a HELLO, or for the digest of the
    stream."""
    TABLE = 0xB7
    """Epoch (2), stream id (1), digest (4): one row of the sender's table."""
    SYNC = 0xB8
    """Prefix: lineage (2) and floor (3) of the count of a reliable topic
    (`zacoustic.core.transport.reliable`)."""
    ACK = 0xB9
    """Prefix: the record acknowledges samples of the node with this address (1); in a unicast frame
    those of the frame's destination, without the address. Before a byte from `C0` on it is a
    control: `DenseAck`."""
    FRAGMENT = 0xBA
    """Transfer (1), index (2), data to the end: a fragment of an object
    (`zacoustic.core.transport.objects`)."""
    FEEDBACK = 0xBB
    """Transfer (1) and more: a receiver's feedback about an object."""
    SUBSCRIBE = SUBSCRIBE_CODE
    """Page (1), version (1), streams (1): what a node wants of another one
    (`zacoustic.core.transport.subscriptions`)."""
    CLOCK = 0xBD
    """Time (6), its error (1): network time at the first bit of this frame
    (`zacoustic.core.wire.access`)."""
    TURN = 0xBE
    """Node (1), span (1): who may transmit now, or when the sender listens."""
    RELAY = 0xBF
    """Reserved: origin, destination, hops, sequence."""


class Hello(msgspec.Struct, frozen=True):
    """Who sends, and with which table."""

    version: int
    epoch: int
    digest: bytes

    def encode(self) -> bytes:
        """Return the 8 bytes of the control."""
        return bytes((Control.HELLO, self.version)) + self.epoch.to_bytes(2, "big") + self.digest


class Tag(msgspec.Struct, frozen=True):
    """The sender's epoch, where its table may be unknown."""

    epoch: int

    def encode(self) -> bytes:
        """Return the 3 bytes of the control."""
        return bytes((Control.TAG,)) + self.epoch.to_bytes(2, "big")


class Confirm(msgspec.Struct, frozen=True):
    """The sender knows and shares the table of a node's epoch."""

    address: int
    """The node, `ASSURED`, or `VOUCHED`."""
    epoch: int

    def encode(self) -> bytes:
        """Return the 4 bytes of the control."""
        return bytes((Control.CONFIRM, self.address)) + self.epoch.to_bytes(2, "big")


class Ask(msgspec.Struct, frozen=True):
    """A node is asked for its HELLO (stream id 0) or for one row of its table."""

    address: int
    stream_id: int

    def encode(self) -> bytes:
        """Return the 3 bytes of the control."""
        return bytes((Control.ASK, self.address, self.stream_id))


class TableRow(msgspec.Struct, frozen=True):
    """The digest of one stream in the sender's table; four zero bytes when it has none."""

    epoch: int
    stream_id: int
    digest: bytes

    def encode(self) -> bytes:
        """Return the 8 bytes of the control."""
        return (
            bytes((Control.TABLE,))
            + self.epoch.to_bytes(2, "big")
            + bytes((self.stream_id,))
            + self.digest
        )


class Sync(msgspec.Struct, frozen=True):
    """Where a publisher's count of a key stands; see `zacoustic.core.transport.reliable`."""

    lineage: int
    """Boot epoch of the publisher in which the count began, 0…65535."""
    floor: int
    """The oldest number that may still come, modulo 2^24."""

    def encode(self) -> bytes:
        """Return the 6 bytes of the prefix."""
        floor = self.floor & 0xFFFFFF
        return bytes((Control.SYNC,)) + self.lineage.to_bytes(2, "big") + floor.to_bytes(3, "big")


class DenseString(msgspec.Struct, frozen=True):
    """Samples of dense streams; always the last item of a frame."""

    string: bytes
    """From its marker on."""


class DenseAck(msgspec.Struct, frozen=True):
    """The newest dense string of a node that the sender holds."""

    address: int
    """Address of the publisher; 0: the frame's destination."""
    mark: int
    """Which, 0…16383; see `zacoustic.core.values.dense.stream.references`."""

    def encode(self) -> bytes:
        """Return the 3 or 4 bytes of the control."""
        whose = bytes((self.address,)) if self.address else b""
        return bytes((Control.ACK, *whose, DENSE_FROM | self.mark >> 8, self.mark & 0xFF))


class Prefixes(msgspec.Struct, frozen=True):
    """What stands before the stream id of a record."""

    delete: bool = False
    """The record deletes its key."""
    encoding: str | None = None
    """Zenoh encoding where it is not the stream's."""
    sync: Sync | None = None
    """Where the count stands."""
    acknowledged: int | None = None
    """The record is an ACK: for the node with this address, or 0 for the frame's destination."""


_NO_PREFIXES: Final = Prefixes()


class Record(msgspec.Struct, frozen=True):
    """What one stream has in a frame."""

    stream_id: int
    content: bytes
    """What follows the id."""
    prefixes: Prefixes = _NO_PREFIXES
    """What stands before it."""


class Stray(msgspec.Struct, frozen=True):
    """The rest of a frame, or of a delimited record, that cannot be read."""

    reason: str
    """One word for the statistics: ``truncated``, ``reserved``, ``unknown_stream``."""
    size_bytes: int


PlainItem = (
    Hello
    | Tag
    | Confirm
    | Ask
    | TableRow
    | AccessControl
    | Fragment
    | Feedback
    | Subscribe
    | DenseAck
    | Record
    | Stray
)
"""The contents of a frame besides a dense block."""

Item = PlainItem | DenseString

Measure = Callable[[int, bytes, int, Prefixes], int | None]
"""``(stream_id, buffer, offset, prefixes)`` → end of the content there; None: it shows none.
Raises KeyError for a stream that the table does not have."""

ABSENT_DIGEST: Final = bytes(4)
"""Digest in a `TableRow` of a stream that the sender's table does not have."""

_CONTROL_SIZES: Final = {
    Control.HELLO: 8,
    Control.TAG: 3,
    Control.CONFIRM: 4,
    Control.ASK: 3,
    Control.TABLE: 8,
    Control.SUBSCRIBE: SUBSCRIBE_BYTES,
    Control.CLOCK: CLOCK_BYTES,
    Control.TURN: TURN_BYTES,
}
PADDING: Final = b"\x00"
"""The byte of a frame without contents: every receiver skips it."""
HELLO_BYTES: Final = _CONTROL_SIZES[Control.HELLO]
TAG_BYTES: Final = _CONTROL_SIZES[Control.TAG]
SYNC_BYTES: Final = 6
DELIMITER_BYTES: Final = 2
"""What LEN and its length byte cost."""


def parse_frame(frame: bytes, measure: Measure, *, unicast: bool = False) -> Iterator[Item]:
    """Take a frame apart; never raises, for any bytes.

    Args:
        frame: The records of one frame, without envelope.
        measure: Finds where the content of a stream ends.
        unicast: The frame is for one node.

    Yields:
        Controls and records in the order of the frame; at most one `Stray` for what cannot be
        read, after which only records that `LEN` delimits are still found.
    """
    offset = 0
    while offset < len(frame):
        code = frame[offset]
        if code in (Control.HELLO, Control.TAG):
            # The tables may differ: only what LEN delimits can be trusted to end where it seems to.
            measure = _measure_nothing
        if code == 0:
            offset += 1
        elif code == Control.LEN:
            start = offset + DELIMITER_BYTES
            if start > len(frame) or start + frame[offset + 1] > len(frame):
                yield Stray("truncated", len(frame) - offset)
                return
            offset = start + frame[offset + 1]
            if offset > start:
                yield _parse_delimited(frame[start:offset], unicast=unicast)
        elif code in _CONTROL_SIZES:
            size = _CONTROL_SIZES[Control(code)]
            if offset + size > len(frame):
                yield Stray("truncated", len(frame) - offset)
                return
            yield _parse_control(frame, offset)
            offset += size
        elif code == Control.FEEDBACK:
            feedback = decode_feedback(frame, offset)
            if feedback is None:
                yield Stray("truncated", len(frame) - offset)
                return
            yield feedback[0]
            offset = feedback[1]
        elif code >= DENSE_FROM:
            yield DenseString(frame[offset:])
            return
        elif (ack := _parse_dense_ack(frame, offset, unicast=unicast)) is not None:
            yield ack[0]
            offset = ack[1]
        else:
            item, offset = _parse_record(frame, offset, measure, unicast=unicast)
            yield item


def _parse_control(frame: bytes, offset: int) -> Item:
    code = frame[offset]
    body = frame[offset + 1 : offset + _CONTROL_SIZES[Control(code)]]
    if code == Control.HELLO:
        return Hello(body[0], int.from_bytes(body[1:3], "big"), body[3:7])
    if code == Control.TAG:
        return Tag(int.from_bytes(body, "big"))
    if code == Control.CONFIRM:
        return Confirm(body[0], int.from_bytes(body[1:3], "big"))
    if code == Control.ASK:
        return Ask(body[0], body[1])
    if code == Control.SUBSCRIBE:
        return Subscribe.decode(body)
    if code == Control.CLOCK:
        return ClockTime.decode(body)
    if code == Control.TURN:
        return Turn.decode(body)
    return TableRow(int.from_bytes(body[0:2], "big"), body[2], body[3:7])


def _parse_dense_ack(frame: bytes, offset: int, *, unicast: bool) -> tuple[DenseAck, int] | None:
    """Read an acknowledgement of dense strings; None: it is something else, or cut off."""
    said_at = offset + 1 + (not unicast)
    if frame[offset] != Control.ACK or said_at + 1 >= len(frame) or frame[said_at] < DENSE_FROM:
        return None
    mark = int.from_bytes(frame[said_at : said_at + 2], "big") & 0x3FFF
    return DenseAck(0 if unicast else frame[offset + 1], mark), said_at + 2


def _parse_delimited(piece: bytes, *, unicast: bool) -> Item:
    """Parse the one record that LEN delimits: its content reaches to the end."""
    item, _ = _parse_record(piece, 0, _measure_nothing, unicast=unicast)
    return item


def _measure_nothing(stream_id: int, buffer: bytes, offset: int, prefixes: Prefixes) -> None:
    """Measure no content: it reaches to the end."""


def _parse_record(
    frame: bytes, offset: int, measure: Measure, *, unicast: bool
) -> tuple[Item, int]:
    start, end = offset, len(frame)
    if frame[offset] == Control.FRAGMENT:
        fragment = decode_fragment(frame[offset:])
        return fragment or Stray("truncated", end - start), end
    parsed = _parse_prefixes(frame, offset, unicast=unicast)
    if parsed is None or parsed[1] >= end:
        return Stray("truncated", end - start), end
    prefixes, offset = parsed
    stream_id = frame[offset]
    if not 1 <= stream_id <= LAST_STREAM_ID:
        return Stray("reserved", end - start), end
    offset += 1
    try:
        measured = measure(stream_id, frame, offset, prefixes)
    except KeyError:
        return Stray("unknown_stream", end - start), end
    content_end = end if measured is None else min(measured, end)
    return Record(stream_id, frame[offset:content_end], prefixes), content_end


def _parse_prefixes(frame: bytes, offset: int, *, unicast: bool) -> tuple[Prefixes, int] | None:
    """Read what stands before a stream id; None: it is cut off."""
    if not Control.DELETE <= frame[offset] <= Control.ACK:
        return _NO_PREFIXES, offset
    delete, encoding, sync, acknowledged = False, None, None, None
    while offset < len(frame):
        code, offset = frame[offset], offset + 1
        if code == Control.DELETE:
            delete = True
        elif code == Control.ENCODING:
            prefix = decode_prefix(frame, offset)
            if prefix is None:
                return None
            encoding, offset = prefix
        elif code == Control.SYNC:
            if offset + 5 > len(frame):
                return None
            words = int.from_bytes(frame[offset : offset + 5], "big")
            sync, offset = Sync(words >> 24, words & 0xFFFFFF), offset + 5
        elif code == Control.ACK:
            if not unicast and offset >= len(frame):
                return None
            acknowledged = 0 if unicast else frame[offset]
            offset += not unicast
        else:
            return Prefixes(delete, encoding, sync, acknowledged), offset - 1
    return None
