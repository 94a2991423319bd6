"""The controls by which a frame says who its sender is and what it knows of its hearers.

Two of them are frozen: HELLO and TAG never change in any version. They let two ends find out that
they speak different versions or hold different tables.
"""

from typing import Final

import msgspec

from zacoustic.core.wire.controls import Form, fixed

WIRE_VERSION: Final = 2
"""Version of this wire format, in every HELLO."""
ASSURED: Final = 0
"""Address of a CONFIRM in a unicast frame: for the destination, which has confirmed the sender."""
PROVISIONAL: Final = 0xFF
"""Address of a CONFIRM in a unicast frame: a provisional confirm for the destination."""
ABSENT_DIGEST: Final = bytes(4)
"""Digest in a `TableRow` for a stream that the sender's table lacks."""

HELLO_CODE: Final = 0xB0
TAG_CODE: Final = 0xB1
CONFIRM_CODE: Final = 0xB5
ASK_CODE: Final = 0xB6
TABLE_CODE: Final = 0xB7
HELLO_BYTES: Final = 8
TAG_BYTES: Final = 3
CONFIRM_BYTES: Final = 4
ASK_BYTES: Final = 3
ROW_BYTES: Final = 8
"""Sizes with the code, bytes."""


class Hello(msgspec.Struct, frozen=True):
    """The sender, with its table."""

    version: int
    epoch: int
    digest: bytes

    def encode(self) -> bytes:
        """Return the 8 bytes of the control."""
        return bytes((HELLO_CODE, self.version)) + self.epoch.to_bytes(2, "big") + self.digest

    @staticmethod
    def decode(body: bytes) -> "Hello":
        """Decode the seven bytes after the code."""
        return Hello(body[0], int.from_bytes(body[1:3], "big"), body[3:7])


class Tag(msgspec.Struct, frozen=True):
    """The sender's epoch, where its table may be unknown."""

    epoch: int

    def encode(self) -> bytes:
        """Return the 3 bytes of the control."""
        return bytes((TAG_CODE,)) + self.epoch.to_bytes(2, "big")

    @staticmethod
    def decode(body: bytes) -> "Tag":
        """Decode the two bytes after the code."""
        return Tag(int.from_bytes(body, "big"))


class Confirm(msgspec.Struct, frozen=True):
    """The sender knows the table of a node's epoch, and has the same."""

    address: int
    """The node, `ASSURED`, or `PROVISIONAL`."""
    epoch: int

    def encode(self) -> bytes:
        """Return the 4 bytes of the control."""
        return bytes((CONFIRM_CODE, self.address)) + self.epoch.to_bytes(2, "big")

    @staticmethod
    def decode(body: bytes) -> "Confirm":
        """Decode the three bytes after the code."""
        return Confirm(body[0], int.from_bytes(body[1:3], "big"))


class Ask(msgspec.Struct, frozen=True):
    """A request to a node for its HELLO (stream id 0) or for one row of its table."""

    address: int
    stream_id: int

    def encode(self) -> bytes:
        """Return the 3 bytes of the control."""
        return bytes((ASK_CODE, self.address, self.stream_id))

    @staticmethod
    def decode(body: bytes) -> "Ask":
        """Decode the two bytes after the code."""
        return Ask(body[0], body[1])


class TableRow(msgspec.Struct, frozen=True):
    """The digest of one stream in the sender's table; four zero bytes if it has none."""

    epoch: int
    stream_id: int
    digest: bytes

    def encode(self) -> bytes:
        """Return the 8 bytes of the control."""
        epoch = self.epoch.to_bytes(2, "big")
        return bytes((TABLE_CODE,)) + epoch + bytes((self.stream_id,)) + self.digest

    @staticmethod
    def decode(body: bytes) -> "TableRow":
        """Decode the seven bytes after the code."""
        return TableRow(int.from_bytes(body[0:2], "big"), body[2], body[3:7])


FORMS: Final[tuple[Form, ...]] = (
    fixed(HELLO_CODE, "HELLO", HELLO_BYTES, Hello.decode),
    fixed(TAG_CODE, "TAG", TAG_BYTES, Tag.decode),
    fixed(CONFIRM_CODE, "CONFIRM", CONFIRM_BYTES, Confirm.decode),
    fixed(ASK_CODE, "ASK", ASK_BYTES, Ask.decode),
    fixed(TABLE_CODE, "TABLE", ROW_BYTES, TableRow.decode),
)
