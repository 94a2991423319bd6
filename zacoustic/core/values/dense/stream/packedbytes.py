"""Bytes without a type, shrunk where possible: `codec: "packed"` for opaque streams.

The problem: a log line, or a payload in JSON or CBOR, takes three times its information, and its
stream has no type. The idea: the model of texts that the package ships (`text`: English, the sea,
names of fields) predicts the next octet, and an arithmetic coder makes a block of that. Octets that
do not shrink are sent unchanged.

Each payload is independent: nothing is learnt from one for the next, so it may be lost, late or
repeated, and streams of every kind can use it.

=========================  =======================================================================
first byte                 contents
=========================  =======================================================================
none                       no octets
`C0`…`FF`                  a block of `arithmetic` with this marker: the octets, in the form of
                           `text`
`00`                       the octets follow; only if their first one is one of the above
other                      the octets themselves
=========================  =======================================================================

So octets that do not shrink cost at most one more byte.
"""

from typing import Final

from zacoustic.core.values.dense.coder.reader import Reader
from zacoustic.core.values.dense.coder.shares import MARKER
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.dense.text.text import shipped_model
from zacoustic.core.values.payload import OpaqueCodec, PayloadError

_AS_THEY_ARE: Final = b"\0"


class PackedBytesCodec(OpaqueCodec):
    """Bytes in, the same bytes out; in between fewer if they are text, JSON or CBOR."""

    def encode(self, value: object) -> bytes:
        """Return the payload of bytes, a bytearray or a memoryview."""
        octets = super().encode(value)
        plain = octets
        if octets and (octets[0] >= MARKER or octets[:1] == _AS_THEY_ARE):
            plain = _AS_THEY_ARE + octets
        model = shipped_model()
        if len(octets) < 2 or not model.takes(octets):
            return plain
        writer = Writer()
        model.code(writer, octets, (), None)
        block = writer.finish(1, 0)
        return block if len(block) < len(plain) else plain

    def decode(self, payload: bytes) -> bytes:
        """Return the octets.

        Raises:
            PayloadError: The payload is invalid.
        """
        payload = super().decode(payload)
        if payload[:1] == _AS_THEY_ARE:
            octets = payload[1:]
            if not octets or not (octets[0] >= MARKER or octets[:1] == _AS_THEY_ARE):
                raise PayloadError("octets that need no mark in front")
            return octets
        if not payload or payload[0] < MARKER:
            return payload
        reader = Reader(payload)
        octets = shipped_model().code(reader, b"", (), None)
        reader.check(1, 0)
        return octets
