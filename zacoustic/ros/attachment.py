"""The attachment of rmw_zenoh to each message, request and response: 33 bytes.

========  ==========================================================================
bytes     content
========  ==========================================================================
8         sequence number of the publisher or client, from 1; little endian, signed
8         source time stamp, ns since 1970; little endian, signed
1         16: the length of what follows
16        gid of the publisher or client (`zacoustic.ros.tokens.gid_of`)
========  ==========================================================================

The attachment of a response repeats the number and the gid of its request.
"""

import struct
from typing import Final

import msgspec

GID_BYTES: Final = 16
"""Size of a gid."""
ATTACHMENT_BYTES: Final = 33
"""Size of an attachment; later bytes are ignored, as rmw_zenoh does."""

_FORM: Final = struct.Struct("<qqB16s")


class Attachment(msgspec.Struct, frozen=True, kw_only=True):
    """The attachment of a message."""

    sequence: int
    """Number of the message, counted by its sender."""
    stamp_ns: int
    """When it was sent, ns since 1970."""
    gid: bytes
    """Gid of its sender, 16 bytes."""

    def encode(self) -> bytes:
        """Return the bytes."""
        return _FORM.pack(self.sequence, self.stamp_ns, GID_BYTES, self.gid)


def read_attachment(content: bytes) -> Attachment | None:
    """Read an attachment; None: it is not one of rmw_zenoh."""
    if len(content) < ATTACHMENT_BYTES:
        return None
    sequence, stamp_ns, length, gid = _FORM.unpack_from(content)
    if length != GID_BYTES:
        return None
    return Attachment(sequence=sequence, stamp_ns=stamp_ns, gid=gid)
