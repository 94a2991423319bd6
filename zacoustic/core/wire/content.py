"""What follows a stream id: where the content of a record ends, and what it consists of.

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
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec
from zacoustic.core.streams.table import EVERY_NODE, Stream
from zacoustic.core.values.age import decode_age_s
from zacoustic.core.wire.calls import NAME_BYTES, NAMED, CallKind, decode_call_byte
from zacoustic.core.wire.frame import Prefixes
from zacoustic.core.wire.goals import measure_message
from zacoustic.core.wire.numbers import NUMBER_BYTES, measure_ack

SERVER_BYTES: Final = 1
"""What a record names its server in, where each node is one."""


def measure_content(
    stream: Stream, buffer: bytes, offset: int, prefixes: Prefixes, source: int
) -> int | None:
    """Find the end of a content; None: it does not delimit itself.

    Args:
        stream: Whose record it is.
        buffer: Where it stands.
        offset: Where it begins, behind the stream id.
        prefixes: What stands before the stream id.
        source: Address of the sender of the frame: a server's records are answers.
    """
    if isinstance(stream.spec, ServiceSpec):
        server, offset = server_of(stream.spec, buffer, offset)
        return _measure_call(stream, buffer, offset, answers=source == server)
    if isinstance(stream.spec, ActionSpec):
        # A sender that is not known, in `zacoustic decode`, is taken for the server.
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
    """Return the server that a record of a service concerns, and where the rest begins.

    Args:
        spec: The service.
        buffer: Where the content stands.
        offset: Where it begins.

    Returns:
        The address, None where the record is cut off; and the position of the call byte.
    """
    if spec.server != EVERY_NODE:
        return spec.server, offset
    return (buffer[offset] if offset < len(buffer) else None), offset + SERVER_BYTES


def server_bytes(stream: Stream, server: int) -> bytes:
    """Return what names the server in front of a call byte, where each node serves."""
    is_named = isinstance(stream.spec, ServiceSpec) and stream.spec.server == EVERY_NODE
    return bytes((server,)) if is_named else b""


def split_age(stream: Stream, payload: bytes) -> tuple[float | None, bytes]:
    """Take the age from before a payload, s; None: the service has no stamp, or it is cut off."""
    if stream.qos.stamp is not Stamp.AGE or not payload:
        return None, payload
    return decode_age_s(payload[0]), payload[1:]


def _measure_call(stream: Stream, buffer: bytes, offset: int, *, answers: bool) -> int | None:
    if offset >= len(buffer):
        return None
    kind, _ = decode_call_byte(buffer[offset])
    offset += 1
    if answers and kind is NAMED:
        if offset >= len(buffer):
            return None
        kind, offset = CallKind(buffer[offset] >> 6), offset + NAME_BYTES
    if kind is CallKind.ERROR:
        return None
    if kind is CallKind.CONFIRM:
        return offset
    offset += stream.qos.stamp is Stamp.AGE
    codec = stream.response_codec if kind is CallKind.RESPONSE else stream.codec
    return codec.measure(buffer, offset) if codec.delimits_itself else None
