"""Section 13: SUBSCRIBE. Written from docs/wire.md alone."""

from dataclasses import dataclass

from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError

SUBSCRIBE = 0xBC
_ANSWER, _HEARD, _PROVED = 0x80, 0x40, 0x20


@dataclass(frozen=True)
class Subscribe:
    """A subscribe message, or its answer."""

    page: int
    version: int
    mask: int
    heard: int | None = None
    answer: bool = False
    proved: bool = False

    @property
    def wanted(self) -> tuple[int, ...]:
        """The streams that it names."""
        return tuple(8 * self.page + bit for bit in range(8) if self.mask >> bit & 1)

    def write(self) -> bytes:
        flags = _ANSWER * self.answer | _HEARD * (self.heard is not None) | _PROVED * self.proved
        heard = b"" if self.heard is None else self.heard.to_bytes(2, "big")
        return bytes((SUBSCRIBE, flags | self.page, self.version, self.mask)) + heard


def read(cursor: Cursor) -> Subscribe:
    """Take the body of SUBSCRIBE."""
    page, version, mask = cursor.take(3)
    heard = cursor.number(2) if page & _HEARD else None
    if page & _PROVED and not page & _ANSWER:
        raise ReadError("only an answer says what is proved")
    return Subscribe(page & 0x1F, version, mask, heard, bool(page & _ANSWER), bool(page & _PROVED))
