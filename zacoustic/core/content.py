"""What follows a stream id: where the content of a record ends, and what it consists of.

======================  ==========================================================================
best-effort sample      wildcards, age where stamped, payload
reliable sample         wildcards, number, age where stamped, payload
delete                  as a sample, without age and payload
ACK                     wildcards, then `zacoustic.core.arq.numbers.Ack`
call                    call byte, payload
======================  ==========================================================================
"""

from zacoustic.core.arq.numbers import NUMBER_BYTES, measure_ack
from zacoustic.core.calls import CallKind, decode_call_byte
from zacoustic.core.frame import Prefixes
from zacoustic.core.qos import Reliability, Stamp
from zacoustic.core.streams import ServiceSpec, Stream


def measure_content(stream: Stream, buffer: bytes, offset: int, prefixes: Prefixes) -> int | None:
    """Find the end of a content; None: it does not delimit itself.

    Args:
        stream: Whose record it is.
        buffer: Where it stands.
        offset: Where it begins, behind the stream id.
        prefixes: What stands before the stream id.
    """
    if isinstance(stream.spec, ServiceSpec):
        return _measure_call(stream, buffer, offset)
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


def _measure_call(stream: Stream, buffer: bytes, offset: int) -> int | None:
    if offset >= len(buffer):
        return None
    kind, _ = decode_call_byte(buffer[offset])
    if kind is CallKind.ERROR:
        return None
    if kind is CallKind.CONFIRM:
        return offset + 1
    codec = stream.codec if kind is CallKind.REQUEST else stream.response_codec
    return codec.measure(buffer, offset + 1) if codec.delimits_itself else None
