"""The records inside a frame, native profile; docs/wire.md is the normative text, with vectors.

A frame is a sequence of *records*. The first byte gives the kind::

    0x00         padding
    0x01…0xAF    stream id: content of that stream follows
    0xB0…0xBF    control
    0xC0…0xFF    dense block, to the end of the frame (`zacoustic.core.values.dense`)

The stream, which both ends have in their tables, fixes what follows its id: a best-effort sample
costs its id and nothing else. A record does not carry its length, unless its payload delimits
itself or the sender wrote the control ``LEN`` before it. So the end of a frame ends its last
record; a receiver that meets an id it cannot measure takes the rest of the frame as that record.

This module decodes only the controls that belong to records. The others, with their decoders, are
in a table (`zacoustic.core.wire.controls`).
"""

import enum
from collections.abc import Callable, Iterator
from typing import Final

import msgspec

from zacoustic.core.values.encoding import decode_prefix
from zacoustic.core.wire.agreement import HELLO_CODE, TAG_CODE
from zacoustic.core.wire.controls import FIRST_EXTENSION, Controls, Extension, Item

LAST_STREAM_ID: Final = 0xAF
DENSE_FROM: Final = 0xC0
"""A dense block begins with a byte from here to 0xFF."""
LONGEST_DELIMITED_BYTES: Final = 255
"""Longest record that LEN can delimit, bytes."""


class Control(enum.IntEnum):
    """The codes that belong to records; all others are in the table of `controls`."""

    LEN = 0xB2
    """Length (1) of the record that follows, with its prefixes and its id."""
    DELETE = 0xB3
    """Prefix: the record deletes its key; it has no payload."""
    ENCODING = 0xB4
    """Prefix: encoding of the sample (`zacoustic.core.values.encoding`), where it is not the
    stream's."""
    SYNC = 0xB8
    """Prefix: lineage (2) and floor (3) of the count of a reliable topic
    (`zacoustic.core.transport.reliable`)."""
    ACK = 0xB9
    """Prefix: the record acknowledges samples of the node with this address (1); in a unicast frame
    those of the frame's destination, without the address. Before a byte from `C0` on it is a
    control: `DenseAck`."""


_PREFIXES: Final = frozenset(Control) - {Control.LEN}


class Sync(msgspec.Struct, frozen=True):
    """The state of a publisher's count of a key; see `zacoustic.core.transport.reliable`."""

    lineage: int
    """Boot epoch of the publisher in which the count began, 0…65535."""
    floor: int
    """The oldest number that may still come, modulo 2^24."""

    def encode(self) -> bytes:
        """Return the 6 bytes of the prefix."""
        floor = self.floor & 0xFFFFFF
        return bytes((Control.SYNC,)) + self.lineage.to_bytes(2, "big") + floor.to_bytes(3, "big")


class DenseBlock(msgspec.Struct, frozen=True):
    """Samples of dense streams; always the last item of a frame."""

    block: bytes
    """The block from its marker on."""


class DenseAck(msgspec.Struct, frozen=True):
    """The newest dense block from a node that the sender holds."""

    address: int
    """Address of the publisher; 0: the frame's destination."""
    mark: int
    """The mark of the block, 0…16383; see `zacoustic.core.values.dense.stream.references`."""

    def encode(self) -> bytes:
        """Return the 3 or 4 bytes of the control."""
        whose = bytes((self.address,)) if self.address else b""
        return bytes((Control.ACK, *whose, DENSE_FROM | self.mark >> 8, self.mark & 0xFF))


class Prefixes(msgspec.Struct, frozen=True):
    """The prefixes before the stream id of a record."""

    delete: bool = False
    """The record deletes its key."""
    encoding: str | None = None
    """The Zenoh encoding, where it is not the stream's."""
    sync: Sync | None = None
    """The state of the count."""
    acknowledged: int | None = None
    """Address of the publisher that this ACK is for, 0: the frame's destination; None: no ACK."""


_NO_PREFIXES: Final = Prefixes()


class Record(msgspec.Struct, frozen=True):
    """One record of a stream in a frame."""

    stream_id: int
    content: bytes
    """The bytes after the id."""
    prefixes: Prefixes = _NO_PREFIXES
    """The prefixes before it."""


class Stray(msgspec.Struct, frozen=True):
    """The undecodable rest of a frame or of a delimited record."""

    reason: str
    """One word for the statistics: ``truncated``, ``reserved``, ``unknown_stream``."""
    size_bytes: int


Measure = Callable[[int, bytes, int, Prefixes], int | None]
"""``(stream_id, buffer, offset, prefixes)`` → end of the content there; None: it does not delimit
itself. Raises KeyError for a stream that the table lacks."""

PADDING: Final = b"\x00"
"""The byte of a frame without content: every receiver skips it."""
SYNC_BYTES: Final = 6
DELIMITER_BYTES: Final = 2
"""Bytes of LEN and its length byte."""


def parse_frame(
    frame: bytes, measure: Measure, controls: Controls, *, unicast: bool = False
) -> Iterator[Item]:
    """Decode a frame; never raises, for any bytes.

    Args:
        frame: The records of one frame, without envelope.
        measure: Finds the end of a stream's content.
        controls: The forms of the controls.
        unicast: Whether the frame is for one node.

    Yields:
        Controls and records in the order of the frame; at most one `Stray` for what cannot be
        decoded, after which only records that `LEN` delimits are still found.
    """
    offset, has_records = 0, False
    while offset < len(frame):
        code = frame[offset]
        if code in (HELLO_CODE, TAG_CODE):
            if has_records:
                # Which table they were written by, and so where they end, was not stated before
                # them.
                yield Stray("reserved", len(frame) - offset)
                return
            # The tables may differ: only the ends of what LEN delimits can be trusted.
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
                item = _parse_delimited(frame[start:offset], controls, unicast=unicast)
                has_records |= isinstance(item, Record)
                yield item
        elif code in controls:
            read = controls[code].read(frame, offset)
            if read is None:
                yield Stray("truncated", len(frame) - offset)
                return
            item, offset = read
            yield item
        elif code >= DENSE_FROM:
            yield DenseBlock(frame[offset:])
            return
        elif (ack := _parse_dense_ack(frame, offset, unicast=unicast)) is not None:
            yield ack[0]
            offset = ack[1]
        else:
            item, offset = _parse_record(frame, offset, measure, unicast=unicast)
            has_records = True
            yield item


def _parse_dense_ack(frame: bytes, offset: int, *, unicast: bool) -> tuple[DenseAck, int] | None:
    """Decode an acknowledgement of dense blocks; None: it is another item, or cut off."""
    said_at = offset + 1 + (not unicast)
    if frame[offset] != Control.ACK or said_at + 1 >= len(frame) or frame[said_at] < DENSE_FROM:
        return None
    mark = int.from_bytes(frame[said_at : said_at + 2], "big") & 0x3FFF
    return DenseAck(0 if unicast else frame[offset + 1], mark), said_at + 2


def _parse_delimited(piece: bytes, controls: Controls, *, unicast: bool) -> Item:
    """Decode what LEN delimits: a record, a control that shows no end, or an extension."""
    form = controls.get(piece[0])
    if form is not None and not form.shows_end:
        read = form.read(piece, 0)
        return Stray("truncated", len(piece)) if read is None else read[0]
    if piece[0] >= FIRST_EXTENSION:
        return Extension(piece[0], piece[1:])
    return _parse_record(piece, 0, _measure_nothing, unicast=unicast)[0]


def _measure_nothing(stream_id: int, buffer: bytes, offset: int, prefixes: Prefixes) -> None:
    """Measure nothing: the content extends to the end."""


def _parse_record(
    frame: bytes, offset: int, measure: Measure, *, unicast: bool
) -> tuple[Item, int]:
    start, end = offset, len(frame)
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
    """Decode the prefixes before a stream id; None: they are cut off."""
    if frame[offset] not in _PREFIXES:
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
