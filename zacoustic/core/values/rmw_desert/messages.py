"""The content of a packet of rmw_desert: kind, stream id, a sequence id for calls, and fields.

::

    sample      0 | id | fields
    request     2 | id | sequence | fields
    response    3 | id | sequence | fields

All are CBOR items in their shortest form. There are no addresses: a sample does not name its
publisher, nor a request its client, and a response is for the client that awaits its sequence id.

The limits are those of the receiver: in a longer payload it may take a byte for the end of the
packet, of more than 64 items it drops the last ones, and calls must fit with their sequence id.
"""

import enum
import struct
from typing import Final

import msgspec

from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.payload.items import UNSIGNED, head, read_length
from zacoustic.core.values.rmw_desert.packets import PAYLOAD_LIMIT_BYTES
from zacoustic.errors import PayloadTooLargeError

ITEMS_LIMIT: Final = 64
"""How many items the receiver of rmw_desert keeps of a packet, kind and id included."""
LAST_STREAM_ID: Final = 255
"""Stream ids are 1…255; 0 is a topic that is not sent."""

_TRUNCATED: Final = (IndexError, struct.error)


class Kind(enum.IntEnum):
    """The kind of a message."""

    SAMPLE = 0
    REQUEST = 2
    RESPONSE = 3


_KINDS: Final = {kind.value: kind for kind in Kind}


class Message(msgspec.Struct, frozen=True):
    """A received message, its fields still in their items."""

    kind: Kind
    stream_id: int
    sequence: int
    """Sequence id of the call; 0 for a sample."""
    fields: bytes


def encode_head(stream_id: int, sequence: int | None = None) -> bytes:
    """Return the items between the kind and the fields."""
    sequence_item = b"" if sequence is None else head(UNSIGNED, sequence)
    return head(UNSIGNED, stream_id) + sequence_item


def decode_message(payload: bytes) -> Message:
    """Decode a payload.

    Raises:
        PayloadError: It is no message.
    """
    kind = _KINDS.get(payload[0]) if payload else None
    if kind is None:
        raise PayloadError(f"kind {payload[:1].hex() or 'missing'}; there are 00, 02 and 03")
    try:
        stream_id, offset = read_length(payload, 1, UNSIGNED)
        sequence = 0
        if kind is not Kind.SAMPLE:
            sequence, offset = read_length(payload, offset, UNSIGNED)
    except _TRUNCATED:
        raise PayloadError("the packet ends inside its head") from None
    if not 1 <= stream_id <= LAST_STREAM_ID:
        raise PayloadError(f"stream id {stream_id}; there are 1..{LAST_STREAM_ID}")
    return Message(kind, stream_id, sequence, payload[offset:])


def check_limits(name: str, items: int, size_bytes: int) -> None:
    """Refuse a message that the receiver would cut.

    Args:
        name: Name of its type, for the error.
        items: Number of its items, head and fields.
        size_bytes: Size of all of them, bytes.

    Raises:
        PayloadTooLargeError: States which limit it exceeds.
    """
    if items > ITEMS_LIMIT:
        raise PayloadTooLargeError(
            f"{name}: {items} items with the head of the packet; allowed: {ITEMS_LIMIT}",
            hint="rmw_desert drops what is beyond; give the topic a smaller type",
        )
    if size_bytes > PAYLOAD_LIMIT_BYTES:
        raise PayloadTooLargeError(
            f"{name}: {size_bytes} bytes in a packet; allowed: {PAYLOAD_LIMIT_BYTES}",
            hint="rmw_desert cannot tell the length of a longer packet",
        )
