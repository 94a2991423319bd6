"""Bit strings: numbers of any width, most significant bit first, padded with zeros to a byte."""

from abc import ABC, abstractmethod

from zacoustic.core.values.payload.codec import PayloadError


class BitSink(ABC):
    """The destination of numbers."""

    @abstractmethod
    def write(self, number: int, width: int) -> None:
        """Append `number`, 0…2**width-1, in `width` bits."""


class BitSource(ABC):
    """The source of numbers; raises `PayloadError` where there are none."""

    @property
    @abstractmethod
    def bits_left(self) -> int:
        """Bits after the current position."""

    @abstractmethod
    def read(self, width: int) -> int:
        """Return the next `width` bits as a number."""

    @abstractmethod
    def skip(self, width: int) -> int:
        """Skip the next `width` bits; the return value has no meaning here."""


class BitWriter(BitSink):
    """Collects numbers as bits."""

    def __init__(self) -> None:
        self._full = bytearray()
        self._rest = 0
        self._rest_bits = 0

    def write(self, number: int, width: int) -> None:
        """Append `number`, 0…2**width-1, in `width` bits."""
        self._rest = self._rest << width | number
        self._rest_bits += width
        if self._rest_bits >= 64:  # seldom, so that appending stays cheap at any length
            spare = self._rest_bits & 7
            self._full += (self._rest >> spare).to_bytes(self._rest_bits >> 3, "big")
            self._rest &= (1 << spare) - 1
            self._rest_bits = spare

    def to_bytes(self) -> bytes:
        """Return all bits; zeros fill the last byte."""
        padding = -self._rest_bits % 8
        tail = (self._rest << padding).to_bytes((self._rest_bits + padding) >> 3, "big")
        return bytes(self._full) + tail


class BitReader(BitSource):
    """Reads the numbers of a bit string.

    Args:
        buffer: The bytes with the bit string.
        offset: Its first byte.
    """

    def __init__(self, buffer: bytes, offset: int = 0) -> None:
        self._buffer = buffer
        self._position = offset * 8
        self._end = len(buffer) * 8

    @property
    def bits_left(self) -> int:
        """Bits after the current position."""
        return self._end - self._position

    @property
    def next_byte(self) -> int:
        """Offset in the buffer of the first unread byte."""
        return (self._position + 7) >> 3

    def read(self, width: int) -> int:
        """Return the next `width` bits as a number.

        Raises:
            PayloadError: Fewer are left.
        """
        position = self._position
        end = self.skip(width)
        window = int.from_bytes(self._buffer[position >> 3 : (end + 7) >> 3], "big")
        return window >> (-end & 7) & ((1 << width) - 1)

    def skip(self, width: int) -> int:
        """Skip the next `width` bits; return the position after them, bits.

        Raises:
            PayloadError: Fewer are left.
        """
        end = self._position + width
        if end > self._end:
            raise PayloadError("the payload ends inside a value")
        self._position = end
        return end

    def finish(self) -> None:
        """Check that only padding is left.

        Raises:
            PayloadError: More is left, or the padding is not zero.
        """
        if self.bits_left >= 8:
            raise PayloadError(f"{self.bits_left >> 3} bytes behind the value")
        if self.read(self.bits_left):
            raise PayloadError("padding that is not zero")
