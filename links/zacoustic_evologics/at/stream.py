"""The rule of all decoders of a connection: the same bytes in any pieces give the same messages.

A decision waits for the bytes that it depends on, and depends on no others. So the same bytes give
the same messages in one piece or one by one, pieces of `RawData` apart.
"""

from collections.abc import Callable
from typing import Generic, TypeVar

from zacoustic_evologics.at.framing import PACKET_START, Framing
from zacoustic_evologics.at.messages import RawData

M = TypeVar("M")


class StreamDecoder(Generic[M]):
    """Takes the bytes of a connection, in any pieces, and finds messages in them.

    Args:
        framing: Framing of the connection.
    """

    def __init__(self, framing: Framing) -> None:
        self.framing = framing
        self._buffer = bytearray()

    @property
    def held_bytes(self) -> int:
        """Number of bytes waiting for more; bounded."""
        return len(self._buffer)

    def feed(self, received: bytes) -> list[M | RawData]:
        """Take bytes, return the messages that they complete. Never raises on their content."""
        self._buffer += received
        return self._read_all(self._read)

    def _read_all(self, read: Callable[[], M | RawData | None]) -> list[M | RawData]:
        """Read messages until there is none; join raw data that follow each other."""
        messages: list[M | RawData] = []
        while (message := read()) is not None:
            previous = messages[-1] if messages else None
            if isinstance(message, RawData) and isinstance(previous, RawData):
                messages[-1] = RawData(previous.content + message.content)
            else:
                messages.append(message)
        return messages

    def _read(self) -> M | RawData | None:
        """Take the next message from the buffer; None: more bytes must come."""
        raise NotImplementedError

    def _read_raw(self) -> RawData | None:
        """Take the raw data before all that is or may become a packet; None: there is none."""
        start = self._buffer.find(PACKET_START)
        if start < 0:
            parts = (PACKET_START[:count] for count in range(len(PACKET_START) - 1, 0, -1))
            begun = next((part for part in parts if self._buffer.endswith(part)), b"")
            start = len(self._buffer) - len(begun)
        return RawData(self._take(start)) if start > 0 else None

    def _take(self, count: int) -> bytes:
        """Remove bytes from the buffer."""
        taken = bytes(self._buffer[:count])
        del self._buffer[:count]
        return taken
