"""Carried samples, as samples of the stream of `zacoustic.core.streams.carry`.

Integers are big-endian; docs/wire.md has the normative text::

    envelope   00dexxxx  origin 1  destination 1  life 1  stream 1  digest 2  lineage 2  number 3
               floor 1  wildcards  [encoding]  payload
    direct     11de0000  stream 1  digest 2  lineage 2  number 3  floor 1  wildcards  [encoding]
               payload             from its origin to its destination
    receipt    01000000  origin 1  destination 1  stream 1  lineage 2  number 3  wildcards
    refusal    10f00000  origin 1  destination 1  stream 1  lineage 2  number 3  wildcards

    d  the key is deleted, and there is no payload      e  an encoding follows
    x  how many further custodians may take it

A receipt says that its destination has everything before `number`; a refusal that a custodian does
not keep the sample with this number, or, with f, that its destination does not take it.
"""

from typing import Final, TypeAlias

import msgspec

from zacoustic.core.streams.keys import Instance
from zacoustic.core.values.encoding import decode_prefix, encode_prefix

DIGEST_BYTES: Final = 2
"""Bytes of a stream's digest in an envelope."""
LINEAGES: Final = 1 << 16
NUMBERS: Final = 1 << 24
"""A count ends before this number."""
MOST_HOPS: Final = 15
UNKNOWN_FLOOR: Final = 255
MINUTE_S: Final = 60
_ENVELOPE, _RECEIPT, _REFUSAL, _DIRECT = range(4)
_KIND_SHIFT: Final = 6
_DELETED: Final = 0x20
_ENCODED: Final = 0x10
_FINAL: Final = 0x20
_HOPS: Final = 0x0F
_MANTISSA_BITS: Final = 4
_MOST_MANTISSA: Final = 15
_ENCODING_AT: Final = 0


class Bundle(msgspec.Struct, frozen=True):
    """Which key of which publisher for which subscriber, and in which count."""

    origin: int
    """Address of the publisher."""
    destination: int
    """Address of the subscriber."""
    stream_id: int
    """The topic's stream."""
    instance: Instance
    """The key within the topic."""
    lineage: int
    """The count, 0…65535, drawn by the publisher."""


class Envelope(msgspec.Struct, frozen=True, kw_only=True):
    """A sample for one subscriber."""

    bundle: Bundle
    """Its key and count."""
    number: int
    """Its place in the count, 0…2²⁴ - 1."""
    floor: int | None
    """Everything before this number is delivered or will not come; None: unknown."""
    digest: bytes
    """The beginning of the digest of its stream at the publisher."""
    life_s: float
    """How long it may still be carried, s; of no meaning straight from its publisher."""
    hops: int = MOST_HOPS
    """How many further custodians may take it."""
    deleted: bool = False
    """Whether its key is deleted; then there is no payload."""
    encoding: str | None = None
    """Its Zenoh encoding, where it is not the stream's."""
    payload: bytes = b""
    """The encoded value."""

    @property
    def size_bytes(self) -> int:
        """What it counts for a quota, bytes."""
        return _HEAD_BYTES + len(self.bundle.instance) + len(self.payload)


class Receipt(msgspec.Struct, frozen=True):
    """A subscriber has everything of a count before a number."""

    bundle: Bundle
    """The key and count."""
    number: int
    """The next number that it awaits."""


class CarryRefusal(msgspec.Struct, frozen=True):
    """A custodian does not keep a sample, or its subscriber does not take it."""

    bundle: Bundle
    """The key and count."""
    number: int
    """The number of the sample."""
    is_final: bool = False
    """Whether the subscriber refuses it: it defines the topic in another way."""


Message: TypeAlias = Envelope | Receipt | CarryRefusal
_HEAD_BYTES: Final = 13
_DIRECT_BYTES: Final = 10
_ANSWER_BYTES: Final = 9


def encode_envelope(envelope: Envelope, sender: int, receiver: int) -> bytes:
    """Return the bytes of an envelope.

    Args:
        envelope: The envelope.
        sender: Address of the node that transmits it.
        receiver: Address of the node that it is given to.
    """
    bundle = envelope.bundle
    flags = _DELETED * envelope.deleted | _ENCODED * (envelope.encoding is not None)
    if (sender, receiver) == (bundle.origin, bundle.destination):
        head = bytes((_DIRECT << _KIND_SHIFT | flags,))
    else:
        head = bytes(
            (
                _ENVELOPE << _KIND_SHIFT | flags | envelope.hops,
                bundle.origin,
                bundle.destination,
                encode_life(envelope.life_s),
            )
        )
    behind = UNKNOWN_FLOOR
    if envelope.floor is not None:
        behind = min(envelope.number - envelope.floor, UNKNOWN_FLOOR)
    parts = (
        head,
        bytes((bundle.stream_id,)),
        envelope.digest[:DIGEST_BYTES],
        bundle.lineage.to_bytes(2, "big"),
        envelope.number.to_bytes(3, "big"),
        bytes((behind, *bundle.instance)),
        b"" if envelope.encoding is None else encode_prefix(envelope.encoding),
        envelope.payload,
    )
    return b"".join(parts)


def encode_answer(answer: Receipt | CarryRefusal) -> bytes:
    """Return the bytes of a receipt or refusal."""
    kind = _RECEIPT if isinstance(answer, Receipt) else _REFUSAL
    flags = _FINAL if isinstance(answer, CarryRefusal) and answer.is_final else 0
    bundle = answer.bundle
    return (
        bytes((kind << _KIND_SHIFT | flags, bundle.origin, bundle.destination, bundle.stream_id))
        + bundle.lineage.to_bytes(2, "big")
        + answer.number.to_bytes(3, "big")
        + bytes(bundle.instance)
    )


def is_direct(message: bytes) -> bool:
    """Tell whether a message goes straight from its origin to its destination."""
    return bool(message) and message[0] >> _KIND_SHIFT == _DIRECT


def decode(message: bytes, sender: int, receiver: int, wildcards: dict[int, int]) -> Message | None:
    """Return what a sample of the stream says; None: it is damaged, or of an unknown topic.

    Args:
        message: Its payload.
        sender: Address of the node that transmitted it.
        receiver: Address of the node that it was given to.
        wildcards: By stream id of each carried topic, how many wildcards its name has.
    """
    if not message:
        return None
    kind = message[0] >> _KIND_SHIFT
    if kind in (_RECEIPT, _REFUSAL):
        return _decode_answer(message, is_receipt=kind == _RECEIPT, wildcards=wildcards)
    straight = is_direct(message)
    least_bytes = _DIRECT_BYTES if straight else _HEAD_BYTES
    if len(message) < least_bytes or (straight and message[0] & _HOPS):
        return None
    origin, destination, life = (sender, receiver, 0) if straight else message[1:4]
    stream_id = message[least_bytes - 9]
    wild = wildcards.get(stream_id)
    if wild is None or len(message) < least_bytes + wild:
        return None
    digest = message[least_bytes - 8 : least_bytes - 6]
    lineage = int.from_bytes(message[least_bytes - 6 : least_bytes - 4], "big")
    number = int.from_bytes(message[least_bytes - 4 : least_bytes - 1], "big")
    behind = message[least_bytes - 1]
    if UNKNOWN_FLOOR != behind > number:
        return None
    content = message[least_bytes + wild :]
    encoding: str | None = None
    if message[0] & _ENCODED:
        found = decode_prefix(content, _ENCODING_AT)
        if found is None:
            return None
        encoding, end = found
        content = content[end:]
    deleted = bool(message[0] & _DELETED)
    if deleted and content:
        return None
    return Envelope(
        bundle=Bundle(
            origin, destination, stream_id,
            tuple(message[least_bytes : least_bytes + wild]), lineage,
        ),
        number=number,
        floor=None if behind == UNKNOWN_FLOOR else number - behind,
        digest=digest,
        life_s=decode_life(life),
        hops=message[0] & _HOPS,
        deleted=deleted,
        encoding=encoding,
        payload=content,
    )  # fmt: skip


def encode_life(life_s: float) -> int:
    """Return the byte of a life: minutes, rounded down to a mantissa and an exponent of 4 bits."""
    minutes = max(0, int(life_s / MINUTE_S))
    exponent = max(0, minutes.bit_length() - _MANTISSA_BITS)
    if exponent > _MOST_MANTISSA:
        return 0xFF
    return exponent << _MANTISSA_BITS | minutes >> exponent


def decode_life(code: int) -> float:
    """Return the life of a byte, s."""
    return float((code & _MOST_MANTISSA) << (code >> _MANTISSA_BITS)) * MINUTE_S


# Below the functions above


def _decode_answer(
    message: bytes, *, is_receipt: bool, wildcards: dict[int, int]
) -> Receipt | CarryRefusal | None:
    allowed = 0x03 << _KIND_SHIFT | (0 if is_receipt else _FINAL)
    if len(message) < _ANSWER_BYTES or message[0] & ~allowed:
        return None
    _, origin, destination, stream_id = message[:4]
    if len(message) != _ANSWER_BYTES + wildcards.get(stream_id, -_ANSWER_BYTES):
        return None
    lineage = int.from_bytes(message[4:6], "big")
    bundle = Bundle(origin, destination, stream_id, tuple(message[_ANSWER_BYTES:]), lineage)
    number = int.from_bytes(message[6:9], "big")
    if is_receipt:
        return Receipt(bundle, number)
    return CarryRefusal(bundle, number, bool(message[0] & _FINAL))
