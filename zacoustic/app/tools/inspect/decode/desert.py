"""Explains rmw_desert: packets, pieces of a byte stream, or single messages."""

import json
import struct
from typing import Final

from zacoustic.app.tools.inspect.decode.decoded import DecodedItem, decoded, printable
from zacoustic.core.profiles.entities import EntityKind
from zacoustic.core.profiles.rmw_desert.discovery import BEACON, BEACON_TOPIC, REQUEST_TOPIC
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.payload.items import FALSE, TEXT, TRUE, read_content, read_integer
from zacoustic.core.values.rmw_desert.codec import RmwDesertCodec
from zacoustic.core.values.rmw_desert.items import read_float
from zacoustic.core.values.rmw_desert.messages import Kind, Message, decode_message
from zacoustic.core.values.rmw_desert.packets import PacketDecoder

_START: Final = 0x99
_BEACON_ID: Final = 1
_REQUEST_ID: Final = 2
_TRUNCATED: Final = (IndexError, struct.error)
_BEACONS: Final = RmwDesertCodec(BEACON)


class DesertWords:
    """Explains packets, one piece of a byte stream after the other.

    Args:
        table: The streams; None: the items of each message are listed.
    """

    def __init__(self, table: StreamTable | None) -> None:
        self._table = table
        self._decoders: dict[int, PacketDecoder] = {}

    def explain(self, data: bytes, source: int) -> list[DecodedItem]:
        """Explain the bytes of one sender; never raises."""
        decoder = self._decoders.setdefault(source, PacketDecoder())
        # A single message begins with its kind, 0, 2 or 3, a packet with a marker.
        if not decoder.is_waiting and data[:1] != bytes((_START,)):
            return [self._message(data)]
        discarded_before = decoder.discarded_bytes
        items = [self._message(payload) for payload in decoder.feed(data)]
        discarded_bytes = decoder.discarded_bytes - discarded_before
        if discarded_bytes:
            text = f"STRAY {discarded_bytes} bytes: they belong to no packet"
            items.append(DecodedItem(kind="stray", text=text, fault="no_packet"))
        elif not items:
            text = f"STRAY {len(data)} bytes: the packet is not complete yet"
            items.append(DecodedItem(kind="stray", text=text, fault="incomplete"))
        return items

    def _message(self, payload: bytes) -> DecodedItem:
        try:
            message = decode_message(payload)
        except PayloadError as error:
            text = f"STRAY {payload.hex() or 'nothing'}: {error}"
            return DecodedItem(kind="stray", text=text, fault=str(error))
        kind = message.kind.name.lower()
        head = f"stream {message.stream_id}"
        stream = self._table.get(message.stream_id) if self._table is not None else None
        if stream is None:
            return _discovery(message) or _listed(kind, head, message)
        if isinstance(stream.spec, TopicSpec) is not (message.kind is Kind.SAMPLE):
            text = f"STRAY {head} {stream.name}: a {kind}"
            return DecodedItem(kind="stray", text=text, fault="unknown_stream")
        head += f" {stream.name}"
        if isinstance(stream.spec, ServiceSpec):
            head += f", {kind} of call {message.sequence}"
        codec = stream.response_codec if message.kind is Kind.RESPONSE else stream.codec
        return decoded(kind, head, message.stream_id, stream.name, codec, message.fields)


def _discovery(message: Message) -> DecodedItem | None:
    """Explain discovery on its usual ids; None: the message is none."""
    if message.kind is not Kind.SAMPLE:
        return None
    if message.stream_id == _REQUEST_ID and not message.fields:
        text = f"{REQUEST_TOPIC}: who is there?"
        return DecodedItem(kind="discovery_request", text=text, stream_id=_REQUEST_ID)
    if message.stream_id != _BEACON_ID:
        return None
    try:
        beacon = _BEACONS.decode(message.fields)
    except PayloadError:
        return None
    kind = EntityKind(beacon["kind"]).name.lower()
    node = f"{beacon['namespace'].rstrip('/')}/{beacon['node']}"
    what = "leaves" if beacon["leaves"] else f"{beacon['topic']} {beacon['type']}"
    text = f"{BEACON_TOPIC}: {node}: {kind} {what}"
    return DecodedItem(kind="beacon", text=text, stream_id=_BEACON_ID, value=printable(beacon))


def _listed(kind: str, head: str, message: Message) -> DecodedItem:
    """List the items of a message of an unknown type."""
    if message.kind is not Kind.SAMPLE:
        head += f", {kind} of call {message.sequence}"
    found: list[object] = []
    offset = 0
    try:
        while offset < len(message.fields):
            item, offset = _read_item(message.fields, offset)
            found.append(item)
    except (PayloadError, UnicodeDecodeError, *_TRUNCATED):
        found.append(message.fields[offset:].hex())
    text = f"{head}: {json.dumps(found, ensure_ascii=False)}"
    return DecodedItem(kind="record", text=text, stream_id=message.stream_id, value=found)


def _read_item(fields: bytes, offset: int) -> tuple[object, int]:
    initial = fields[offset]
    if initial in (FALSE, TRUE):
        return initial == TRUE, offset + 1
    if initial >> 5 == TEXT:
        content, end = read_content(fields, offset, TEXT)
        return content.decode(), end
    if initial > TRUE:
        return read_float(fields, offset)
    return read_integer(fields, offset)
