"""What follows a stream id: where the content of a record ends, and what it consists of.

======================  ==========================================================================
best-effort sample      wildcards, age where stamped, payload
reliable sample         wildcards, number, age where stamped, payload
delete                  as a sample, without age and payload
ACK                     wildcards, then `zacoustic.core.arq.numbers.Ack`
call                    call byte, payload
action                  operation and goal, payload (`zacoustic.core.actions.wire`)
======================  ==========================================================================
"""

from zacoustic.core.actions.wire import measure_message
from zacoustic.core.arq.numbers import NUMBER_BYTES, measure_ack
from zacoustic.core.calls import NAME_BYTES, NAMED, CallKind, decode_call_byte
from zacoustic.core.frame import Prefixes
from zacoustic.core.qos import Reliability, Stamp
from zacoustic.core.streams import ActionSpec, ServiceSpec, Stream


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
        return _measure_call(stream, buffer, offset, answers=source == stream.spec.server)
    if isinstance(stream.spec, ActionSpec):
        return measure_message(stream, buffer, offset)
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
    codec = stream.response_codec if kind is CallKind.RESPONSE else stream.codec
    return codec.measure(buffer, offset) if codec.delimits_itself else None
