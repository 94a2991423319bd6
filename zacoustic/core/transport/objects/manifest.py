"""The manifest of an object: stream, place, instance, encoding, length, digest, before its payload.

The manifest is part of the coded data, so it costs no byte in any fragment's header, and no
fragment is needed more than any other: a receiver with enough of them has the manifest too. Most
receivers have it with the first fragment.

::

    stream (1)  flags (1)  age (1)  lineage (2)  number (3)
    instance (…)  encoding (…)  length, LEB128 (1…4)  digest (8)

The flags say how many instance bytes follow, by 0x80 that an encoding does, and by 0x40 that an age
does. The age is that of the moment at which the fragment goes that holds it, which is the first
one. For the digest, for repair fragments and for comparisons it counts as unknown: `with_age` sets
it in a fragment, `take_age` takes it out. Lineage and number
are its position in the count of the key (`zacoustic.core.transport.reliable`): they set the order
of delivery, and distinguish the object from an earlier one with the same payload. The digest is the
first eight bytes of the SHA-256 of everything before it and of the payload.
"""

import hashlib
from typing import Final

import msgspec

from zacoustic.core.base.moments import Made, instant_of
from zacoustic.core.streams.keys import Instance
from zacoustic.core.values.age import UNKNOWN, encode_age
from zacoustic.core.values.encoding import decode_prefix, encode_prefix
from zacoustic.core.wire.objects import Fragment

DIGEST_BYTES: Final = 8
_HAS_ENCODING: Final = 0x80
_HAS_AGE: Final = 0x40
_INSTANCE: Final = 0x3F
_FLAGS_AT: Final = 1
_AGE_AT: Final = 2
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
    has_age: bool = False
    """Whether its first fragment says how old it is."""
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
    has_age: bool = False,
) -> tuple[Manifest, bytes]:
    """Return the manifest of a payload, and both encoded in a row, to be cut into fragments."""
    number %= _NUMBERS
    flags = len(instance) | _HAS_ENCODING * (encoding is not None) | _HAS_AGE * has_age
    head = bytes((stream_id, flags)) + bytes((UNKNOWN,)) * has_age
    head += (lineage * _NUMBERS + number).to_bytes(_PLACE_BYTES, "big") + bytes(instance)
    if encoding is not None:
        head += encode_prefix(encoding)
    head += _encode_length(len(payload))
    digest = _digest(head, payload)
    manifest = Manifest(
        stream_id=stream_id,
        instance=tuple(instance),
        encoding=encoding,
        has_age=has_age,
        lineage=lineage,
        number=number,
        payload_bytes=len(payload),
        digest=digest,
        size_bytes=len(head) + DIGEST_BYTES,
    )
    return manifest, head + digest + payload


def decode_manifest(coded: bytes) -> Manifest | None:
    """Decode the manifest at the start of an object; None: incomplete or invalid."""
    if len(coded) <= _FLAGS_AT:
        return None
    stream_id, flags = coded[0], coded[_FLAGS_AT]
    has_age = bool(flags & _HAS_AGE)
    place = _AGE_AT + has_age
    begin = place + _PLACE_BYTES
    if len(coded) < begin:
        return None
    lineage, number = divmod(int.from_bytes(coded[place:begin], "big"), _NUMBERS)
    offset = begin + (flags & _INSTANCE)
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
        has_age=has_age,
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


def with_age(first: bytes, code: int) -> bytes:
    """Return the first fragment of an object with the code of its age, if it has a place for it."""
    if len(first) <= _AGE_AT or not first[_FLAGS_AT] & _HAS_AGE:
        return first
    return first[:_AGE_AT] + bytes((code,)) + first[_AGE_AT + 1 :]


def aged(fragment: Fragment, manifest: Manifest, made: Made, now: int) -> Fragment:
    """Return a fragment that goes now: the first one says how old the object is."""
    if fragment.index or not manifest.has_age:
        return fragment
    made_at = instant_of(made, now)
    code = encode_age(None if made_at is None else now - made_at)
    return msgspec.structs.replace(fragment, data=with_age(fragment.data, code))


def take_age(first: bytes) -> tuple[bytes, int]:
    """Return the first fragment of an object as it counts, and the code of its age."""
    if len(first) <= _AGE_AT or not first[_FLAGS_AT] & _HAS_AGE:
        return first, UNKNOWN
    return with_age(first, UNKNOWN), first[_AGE_AT]


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
