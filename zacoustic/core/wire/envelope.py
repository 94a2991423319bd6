"""The envelope of a frame's records: exactly what the link lacks, and nothing else.

Every frame needs three things, each of which a link may bring: who sent it and to whom, whether it
is intact, and where it ends. The envelope knows from `LinkCapabilities` which are missing:

- not ``addressed``: destination and source, one byte each, in front;
- not ``checked``: a CRC-32, big-endian, at the end. It also covers the addresses, even those that
  the link carries, so that a frame with a damaged address is not accepted by another node; a sealed
  frame has a tag in its place (`zacoustic.core.wire.seal`);
- not ``framed``: the link is a byte stream. The frame is stuffed by COBS (no zero byte inside, one
  more byte per 254) and stands between two zero bytes. The leading one costs a byte and saves a
  frame: without it, noise before a frame would be read as its beginning.

COBS is twenty lines; packages for it need a compiler or add nothing, and the core must import with
two dependencies only. A frame that cannot be opened is reported with a reason; no error is raised.
The buffer of a byte stream holds the longest frame of any link, for the other end's may be longer
than this one's, and never more.

Source:
    S. Cheshire and M. Baker, Consistent Overhead Byte Stuffing, IEEE/ACM Transactions on Networking
    7(2), 1999.
"""

import zlib
from typing import Final

import msgspec

from zacoustic.core.base.linktypes import BROADCAST, LinkCapabilities, ReceivedFrame

_ADDRESS_BYTES: Final = 2
_CHECK_BYTES: Final = 4
_DELIMITER: Final = b"\x00"
_LONGEST_BYTES: Final = 4096
"""The longest frame in a byte stream, bytes, if frames of this node are not longer."""


class Opened(msgspec.Struct, frozen=True, kw_only=True):
    """The content of a frame that arrived intact."""

    source: int
    """Address of the sender, 1…254."""
    destination: int
    """Address it was sent to, or `BROADCAST`."""
    records: bytes
    """The records; on a sealed link those of a sealed frame."""
    life: int | None = None
    """The boot epoch of the sender that has sealed it; None: it was not sealed."""
    digest: bytes = b""
    """Digest of the sender's table as the seal states it; empty: none."""
    strong: bool = False
    """Whether it had the long tag."""


class Damaged(msgspec.Struct, frozen=True, kw_only=True):
    """Received bytes that are no frame."""

    reason: str
    """One word for the statistics: ``short``, ``check``, ``stuffing``, ``overlong``,
    ``address``."""
    size_bytes: int
    """Number of bytes."""


class Envelope:
    """Wraps and opens the frames of one node on one link.

    Args:
        capabilities: What the link can do.
        address: Address of this node, 1…254.
        sealed: Whether frames have a tag, which is the check.
    """

    def __init__(
        self, capabilities: LinkCapabilities, address: int, *, sealed: bool = False
    ) -> None:
        self._address = address
        self._addressed = capabilities.addressed
        self._checked = capabilities.checked or sealed
        self._has_check = not capabilities.checked
        self._framed = capabilities.framed
        self._longest_bytes = capabilities.receives_bytes or capabilities.mtu_bytes
        self._buffer = bytearray()
        self._overlong = False
        room_bytes = capabilities.mtu_bytes
        if not self._framed:
            # COBS turns n bytes, addresses and check included, into at most n + 1 + n // 254.
            room_bytes -= 2 * len(_DELIMITER) + 1
            room_bytes -= (room_bytes + 1) // 255
        room_bytes -= 0 if self._addressed else _ADDRESS_BYTES
        room_bytes -= 0 if self._checked else _CHECK_BYTES
        self.room_bytes: int = room_bytes
        """Bytes of records that fit a frame."""

    def wrap(self, records: bytes, destination: int) -> bytes:
        """Make a frame of at most `mtu_bytes` from at most `room_bytes` of records."""
        frame = records
        if not self._addressed:
            frame = bytes((destination, self._address)) + frame
        if not self._checked:
            frame += self._check(records, destination, self._address)
        if not self._framed:
            frame = _DELIMITER + stuff(frame) + _DELIMITER
        return frame

    def open(self, received: ReceivedFrame) -> list[Opened | Damaged]:
        """Open received bytes: one result for a link with frames, any number for a byte stream."""
        if self._framed:
            return [self._open_frame(received.frame_bytes, received)]
        return self._open_stream(received)

    def unsealed(self, opened: Opened) -> Opened | None:
        """Return the content of an unsealed frame; None: its check fails.

        Args:
            opened: The result of `open` on a sealed link.
        """
        if not self._has_check:
            return opened
        records, check = opened.records[:-_CHECK_BYTES], opened.records[-_CHECK_BYTES:]
        if check != self._check(records, opened.destination, opened.source):
            return None
        return msgspec.structs.replace(opened, records=records)

    def _open_frame(self, frame: bytes, received: ReceivedFrame) -> Opened | Damaged:
        size_bytes = len(frame)
        source, destination = received.source, received.destination
        if not self._addressed:
            if size_bytes < _ADDRESS_BYTES:
                return Damaged(reason="short", size_bytes=size_bytes)
            destination, source, frame = frame[0], frame[1], frame[_ADDRESS_BYTES:]
        if not self._checked:
            if len(frame) < _CHECK_BYTES:
                return Damaged(reason="short", size_bytes=size_bytes)
            frame, check = frame[:-_CHECK_BYTES], frame[-_CHECK_BYTES:]
            if check != self._check(frame, destination, source):
                return Damaged(reason="check", size_bytes=size_bytes)
        if not 1 <= source < BROADCAST or not 1 <= destination <= BROADCAST:
            return Damaged(reason="address", size_bytes=size_bytes)
        return Opened(source=source, destination=destination, records=frame)

    def _open_stream(self, received: ReceivedFrame) -> list[Opened | Damaged]:
        results: list[Opened | Damaged] = []
        *ended, rest = received.frame_bytes.split(_DELIMITER)
        for piece in ended:
            self._take(piece)
            stuffed, overlong = bytes(self._buffer), self._overlong
            self._buffer.clear()
            self._overlong = False
            if overlong:
                results.append(Damaged(reason="overlong", size_bytes=len(stuffed)))
            elif stuffed:
                frame = unstuff(stuffed)
                if frame is None:
                    results.append(Damaged(reason="stuffing", size_bytes=len(stuffed)))
                else:
                    results.append(self._open_frame(frame, received))
        self._take(rest)
        return results

    def _take(self, piece: bytes) -> None:
        room = max(self._longest_bytes, _LONGEST_BYTES) - len(self._buffer)
        self._buffer += piece[:room]
        self._overlong = self._overlong or len(piece) > room

    @staticmethod
    def _check(records: bytes, destination: int, source: int) -> bytes:
        return zlib.crc32(records, zlib.crc32(bytes((destination, source)))).to_bytes(
            _CHECK_BYTES, "big"
        )


def stuff(frame: bytes) -> bytes:
    """Encode by COBS: no zero byte in the result, at most one more byte per 254 plus one."""
    stuffed = bytearray()
    for block in frame.split(_DELIMITER):
        while len(block) >= 254:
            stuffed.append(255)
            stuffed += block[:254]
            block = block[254:]
        stuffed.append(len(block) + 1)
        stuffed += block
    return bytes(stuffed)


def unstuff(stuffed: bytes) -> bytes | None:
    """Decode COBS; return None when a length byte is zero or points beyond the end."""
    frame = bytearray()
    position = 0
    while position < len(stuffed):
        length = stuffed[position]
        block = stuffed[position + 1 : position + length]
        if length == 0 or len(block) != length - 1:
            return None
        frame += block
        position += length
        if length < 255 and position < len(stuffed):
            frame.append(0)
    return bytes(frame)
