"""The manifest of an object: stream, place, instance, encoding, length, digest, before its payload.

The manifest is part of the coded data, so it costs no byte in any fragment's header, and no
fragment is needed more than any other: a receiver with enough of them has the manifest too. Most
receivers have it with the first fragment.

::

    stream (1)  flags (1)  lineage (2)  number (3)
    instance (…)  encoding (…)  length, LEB128 (1…4)  digest (8)

The flags say how many instance bytes follow, and by 0x80 that an encoding does. Lineage and number
are its position in the count of the key (`zacoustic.core.transport.reliable`): they set the order
of delivery, and distinguish the object from an earlier one with the same payload. The digest is the
first eight bytes of the SHA-256 of everything before it and of the payload.
"""

import hashlib
from typing import Final

import msgspec

from zacoustic.core.streams.keys import Instance
from zacoustic.core.values.encoding import decode_prefix, encode_prefix

DIGEST_BYTES: Final = 8
_HAS_ENCODING: Final = 0x80
_PLACE_BYTES: Final = 5
_NUMBERS: Final = 1 << 24
_LONGEST_LENGTH_BYTES: Final = 4
_LENGTH_BITS: Final = 7


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """The description of an object."""

    stream_id: int
    """The topic's stream."""
    instance: Instance
    """The key within the topic."""
    encoding: str | None
    """The Zenoh encoding, where it is not the stream's."""
    lineage: int
    """The boot epoch of the key's count."""
    number: int
    """The number in that count, modulo 2^24."""
    payload_bytes: int
    """Length of the payload, bytes."""
    digest: bytes
    """Eight bytes of the SHA-256 of everything before it and the payload."""
    size_bytes: int
    """Length of the manifest, bytes."""

    @property
    def coded_bytes(self) -> int:
        """Length of the data that is cut into fragments, bytes."""
        return self.size_bytes + self.payload_bytes


def encode_object(
    stream_id: int,
    instance: Instance,
    encoding: str | None,
    payload: bytes,
    *,
    lineage: int,
    number: int,
) -> tuple[Manifest, bytes]:
    """Return the manifest of a payload, and both encoded in a row, to be cut into fragments."""
    number %= _NUMBERS
    head = bytes((stream_id, len(instance) | (_HAS_ENCODING if encoding is not None else 0)))
    head += (lineage * _NUMBERS + number).to_bytes(_PLACE_BYTES, "big") + bytes(instance)
    if encoding is not None:
        head += encode_prefix(encoding)
    head += _encode_length(len(payload))
    digest = _digest(head, payload)
    manifest = Manifest(
        stream_id=stream_id,
        instance=tuple(instance),
        encoding=encoding,
        lineage=lineage,
        number=number,
        payload_bytes=len(payload),
        digest=digest,
        size_bytes=len(head) + DIGEST_BYTES,
    )
    return manifest, head + digest + payload


def decode_manifest(coded: bytes) -> Manifest | None:
    """Decode the manifest at the start of an object; None: incomplete or invalid."""
    begin = 2 + _PLACE_BYTES
    if len(coded) < begin:
        return None
    stream_id, flags = coded[0], coded[1]
    lineage, number = divmod(int.from_bytes(coded[2:begin], "big"), _NUMBERS)
    offset = begin + (flags & ~_HAS_ENCODING)
    instance = tuple(coded[begin:offset])
    encoding: str | None = None
    if flags & _HAS_ENCODING:
        prefix = decode_prefix(coded, offset)
        if prefix is None:
            return None
        encoding, offset = prefix
    length = _decode_length(coded, offset)
    if length is None:
        return None
    payload_bytes, offset = length
    digest = coded[offset : offset + DIGEST_BYTES]
    if len(digest) < DIGEST_BYTES:
        return None
    return Manifest(
        stream_id=stream_id,
        instance=instance,
        encoding=encoding,
        lineage=lineage,
        number=number,
        payload_bytes=payload_bytes,
        digest=digest,
        size_bytes=offset + DIGEST_BYTES,
    )


def open_object(manifest: Manifest, coded: bytes) -> bytes | None:
    """Return the payload, or None if it is not the published one."""
    head = coded[: manifest.size_bytes - DIGEST_BYTES]
    payload = coded[manifest.size_bytes : manifest.coded_bytes]
    if decode_manifest(coded) != manifest or _digest(head, payload) != manifest.digest:
        return None
    return payload


def _digest(head: bytes, payload: bytes) -> bytes:
    whole = hashlib.sha256(head)
    whole.update(payload)
    return whole.digest()[:DIGEST_BYTES]


def _encode_length(length: int) -> bytes:
    groups = bytearray()
    while length >= 1 << _LENGTH_BITS:
        groups.append(length & 0x7F | 0x80)
        length >>= _LENGTH_BITS
    groups.append(length)
    return bytes(groups)


def _decode_length(buffer: bytes, offset: int) -> tuple[int, int] | None:
    length = 0
    for position in range(_LONGEST_LENGTH_BYTES):
        if offset + position >= len(buffer):
            return None
        group = buffer[offset + position]
        length |= (group & 0x7F) << _LENGTH_BITS * position
        if group < 0x80:
            return length, offset + position + 1
    return None
