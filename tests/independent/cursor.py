"""Bytes from left to right, and bits. Written from docs/wire.md alone."""

from tests.independent.errors import ReadError


class Cursor:
    """Takes bytes, and refuses to take what is not there."""

    def __init__(self, data: bytes, position: int = 0) -> None:
        self.data = data
        self.position = position

    @property
    def left(self) -> int:
        return len(self.data) - self.position

    def peek(self) -> int | None:
        return self.data[self.position] if self.left else None

    def take(self, count: int) -> bytes:
        if count > self.left:
            raise ReadError(f"{count} bytes wanted, {self.left} left")
        start = self.position
        self.position += count
        return self.data[start : self.position]

    def number(self, count: int) -> int:
        """Take an unsigned big-endian integer of so many bytes."""
        return int.from_bytes(self.take(count), "big")

    def rest(self) -> bytes:
        return self.take(self.left)

    def end(self) -> None:
        if self.left:
            raise ReadError(f"{self.left} bytes left over")


class Bits:
    """Takes bits from a cursor, the most significant first."""

    def __init__(self, cursor: Cursor) -> None:
        self._cursor = cursor
        self._held = 0
        self._count = 0

    def take(self, count: int) -> int:
        missing = (count - self._count + 7) // 8
        if missing > 0:
            self._held = self._held << (8 * missing) | self._cursor.number(missing)
            self._count += 8 * missing
        self._count -= count
        value = self._held >> self._count
        self._held &= (1 << self._count) - 1
        return value

    def bytes(self, count: int) -> bytes:
        if count > self._cursor.left + 1:
            raise ReadError(f"{count} bytes wanted, {self._cursor.left} left")
        return self.take(8 * count).to_bytes(count, "big")

    @property
    def left(self) -> int:
        return self._count + 8 * self._cursor.left

    def end(self) -> None:
        """Take the padding up to the next byte, which must be zero."""
        if self._held:
            raise ReadError("padding is not zero")
        self._count = 0


class BitOutput:
    """Collects bits, the most significant first."""

    def __init__(self) -> None:
        self._value = 0
        self._count = 0

    def put(self, value: int, count: int) -> None:
        self._value = self._value << count | value
        self._count += count

    def done(self) -> bytes:
        padding = -self._count % 8
        return (self._value << padding).to_bytes((self._count + padding) // 8, "big")
