"""The packets of rmw_desert on a byte stream, such as that of DESERT's socket.

They are::

    99 99 | LEN | payload, LEN bytes | 55

LEN is the length of the payload modulo 256, and rmw_desert sends payloads of up to 512 bytes. There
is no check and no escaping: any byte may be in a payload, markers too. So:

- This node *sends* only payloads of 1…255 bytes; the receiver may cut longer ones short.
- It *receives* all that rmw_desert sends. If the end marker is not at LEN, the payload may have
  LEN + 256 bytes, or may be damaged. It counts as the longer one if the end marker is there, and no
  whole short packet lies inside; that one would be swallowed.
- Bytes that are no packet cost one byte: the search continues after their first marker byte. So a
  damaged packet destroys no intact one, with one exception: its LEN may, by chance, point at a 55
  in or at the end of a later packet. Without a check that cannot be told from a payload with
  markers in it; the check of the core finds the false packet, and what it has swallowed is lost.
- Whether the head is a packet may be known only when 516 bytes have come. `flush` decides without
  them, when nothing has come for a while.

The result depends only on the bytes and on `flush`, not on how the bytes were cut into pieces.

Source:
    Measured on the wire of rmw_desert 4.0.2.
"""

from typing import Final

PAYLOAD_LIMIT_BYTES: Final = 255
"""Longest payload that LEN can state, bytes."""
RECEIVED_LIMIT_BYTES: Final = 512
"""Longest payload that rmw_desert sends, bytes."""
OVERHEAD_BYTES: Final = 4
"""Bytes of the start markers, LEN and the end marker."""

_START: Final = b"\x99\x99"
_END: Final = 0x55
_HEAD_BYTES: Final = len(_START) + 1


def encode_packet(payload: bytes) -> bytes:
    """Return a payload of 1…255 bytes as a packet.

    Raises:
        ValueError: Another length.
    """
    if not 1 <= len(payload) <= PAYLOAD_LIMIT_BYTES:
        raise ValueError(f"payload of {len(payload)} bytes; allowed: 1..{PAYLOAD_LIMIT_BYTES}")
    return _START + bytes((len(payload),)) + payload + bytes((_END,))


class PacketDecoder:
    """Finds packets in a byte stream; buffers less than one packet of the longest kind."""

    def __init__(self) -> None:
        self.discarded_bytes = 0
        """Bytes that belonged to no packet."""
        self._buffer = bytearray()

    @property
    def is_waiting(self) -> bool:
        """Whether bytes are kept that may become a packet: `flush` after a silence."""
        return bool(self._buffer)

    def feed(self, data: bytes) -> list[bytes]:
        """Add bytes; return the payloads that they complete."""
        self._buffer += data
        return self._take(is_over=False)

    def flush(self) -> list[bytes]:
        """Give up an incomplete packet, and return the payloads that it hid."""
        return self._take(is_over=True)

    def _take(self, *, is_over: bool) -> list[bytes]:
        payloads: list[bytes] = []
        position = 0
        while (start := self._buffer.find(_START, position)) >= 0:
            self.discarded_bytes += start - position
            position = start
            end = self._end_of_packet(start)
            if end is None and not is_over:
                break
            if end:
                payloads.append(bytes(self._buffer[start + _HEAD_BYTES : end - 1]))
                position = end
            else:
                self.discarded_bytes += 1
                position += 1
        else:
            # The first half of a start marker may be there already.
            keep = not is_over and self._buffer.endswith(_START[:1], position)
            rest = len(self._buffer) - position - keep
            self.discarded_bytes += rest
            position += rest
        del self._buffer[:position]
        return payloads

    def _end_of_packet(self, start: int) -> int | None:
        """Return the index after the packet that starts here; 0: none; None: not known yet."""
        if len(self._buffer) < start + _HEAD_BYTES:
            return None
        length = self._buffer[start + 2]
        for size_bytes in range(length or 256, RECEIVED_LIMIT_BYTES + 1, 256):
            end = start + _HEAD_BYTES + size_bytes + 1
            if len(self._buffer) < end:
                return None
            is_ended = self._buffer[end - 1] == _END
            if is_ended and (size_bytes <= PAYLOAD_LIMIT_BYTES or not self._hides(start, end)):
                return end
        return 0

    def _hides(self, start: int, end: int) -> bool:
        """Return whether a whole short packet lies inside, which a long one would swallow."""
        inner = start + 1
        while (inner := self._buffer.find(_START, inner, end)) >= 0:
            length = self._buffer[inner + 2] if inner + 2 < end else 0
            behind = inner + _HEAD_BYTES + length + 1
            if length and behind <= end and self._buffer[behind - 1] == _END:
                return True
            inner += 1
        return False
