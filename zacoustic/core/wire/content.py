"""The content after a stream id: its parts, and where it ends.

======================  ==========================================================================
best-effort sample      wildcards, age where stamped, payload
reliable sample         wildcards, number, age where stamped, payload
delete                  as a sample, without age and payload
ACK                     wildcards, then `zacoustic.core.wire.numbers.Ack`
call                    server where each node is one, call byte, age where stamped, payload
action                  operation and goal, payload (`zacoustic.core.wire.goals`)
======================  ==========================================================================
"""

from typing import Final

from zacoustic.core.base.qos import Reliability, Stamp
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import EVERY_NODE, Stream
from zacoustic.core.wire.calls import NAME_BYTES, NAMED, CallKind, decode_call_byte
from zacoustic.core.wire.frame import Prefixes
from zacoustic.core.wire.goals import measure_message
from zacoustic.core.wire.numbers import NUMBER_BYTES, measure_ack

SERVER_BYTES: Final = 1
"""Length of the server's address in a record, where each node is a server."""


def measure_content(
    stream: Stream, buffer: bytes, offset: int, prefixes: Prefixes, source: int
) -> int | None:
    """Find the end of a content; None: it does not delimit itself.

    Args:
        stream: The record's stream.
        buffer: The bytes with the record.
        offset: Start of the content, after the stream id.
        prefixes: The prefixes before the stream id.
        source: Address of the frame's sender: a server's records are answers.
    """
    if not isinstance(stream.spec, TopicSpec) and prefixes != Prefixes():
        return None  # reserved
    if isinstance(stream.spec, ServiceSpec):
        server, offset = server_of(stream.spec, buffer, offset)
        return _measure_call(stream, buffer, offset, answers=source == server)
    if isinstance(stream.spec, ActionSpec):
        # An unknown sender, in `zacoustic decode`, is assumed to be the server.
        from_client = source not in (0, stream.spec.server)
        return measure_message(stream, buffer, offset, from_client=from_client)
    offset += len(stream.keys.wildcards)
    if prefixes.acknowledged is not None:
        return measure_ack(buffer, offset)
    if stream.qos.reliability is Reliability.RELIABLE:
        offset += NUMBER_BYTES
    if prefixes.delete:
        return offset
    if not stream.codec.delimits_itself:
        return None
    return stream.codec.measure(buffer, offset + (stream.qos.stamp is Stamp.AGE))


def server_of(spec: ServiceSpec, buffer: bytes, offset: int) -> tuple[int | None, int]:
    """Return the server that a service's record concerns, and the offset of the rest.

    Args:
        spec: The service.
        buffer: The bytes with the content.
        offset: Start of the content.

    Returns:
        The server's address, None if the record is cut off; and the offset of the call byte.
    """
    if spec.server != EVERY_NODE:
        return spec.server, offset
    return (buffer[offset] if offset < len(buffer) else None), offset + SERVER_BYTES


def server_bytes(stream: Stream, server: int) -> bytes:
    """Return the server's address as it precedes a call byte, where each node is a server."""
    is_named = isinstance(stream.spec, ServiceSpec) and stream.spec.server == EVERY_NODE
    return bytes((server,)) if is_named else b""


def split_age(stream: Stream, payload: bytes) -> tuple[int | None, bytes]:
    """Split the code of its age off a payload; None: there is no stamp, or it is cut off."""
    if stream.qos.stamp is not Stamp.AGE or not payload:
        return None, payload
    return payload[0], payload[1:]


def _measure_call(stream: Stream, buffer: bytes, offset: int, *, answers: bool) -> int | None:
    if offset >= len(buffer):
        return None
    kind, _ = decode_call_byte(buffer[offset])
    offset += 1
    if answers and kind is NAMED:
        if offset >= len(buffer):
            return None
        kind, offset = CallKind(buffer[offset] >> 6), offset + NAME_BYTES
        if kind is NAMED:
            return None
    if kind is CallKind.ERROR or (kind is CallKind.RESPONSE and not answers):
        return None
    if kind is CallKind.CONFIRM:
        return offset
    offset += stream.qos.stamp is Stamp.AGE
    codec = stream.response_codec if kind is CallKind.RESPONSE else stream.codec
    return codec.measure(buffer, offset) if codec.delimits_itself else None
