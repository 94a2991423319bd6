"""Section 5: the content of a service. Written from docs/wire.md alone."""

from dataclasses import dataclass

from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError

REQUEST, RESPONSE, ERROR, CONFIRM = 0, 1, 2, 3
NAMED = 0
FAILURES = {
    1: "the handler failed",
    2: "nobody serves",
    3: "the request does not decode",
    4: "the tables define the stream differently",
    5: "the response does not decode",
    6: "timed out",
    7: "cancelled",
    8: "the server ended without an answer and may have executed the call",
}
TEXT_LIMIT = 48
HANDLER = 1


@dataclass(frozen=True)
class Head:
    """What stands before the payload of a call's record.

    `epoch`: the lower six bits of the client's epoch, of a named answer or confirm.
    """

    kind: int
    number: int
    from_server: bool
    epoch: int | None = None

    def write(self) -> bytes:
        if self.epoch is None:
            return bytes((self.kind << 6 | self.number,))
        return bytes((NAMED << 6 | self.number, self.kind << 6 | self.epoch & 63))


@dataclass(frozen=True)
class Failure:
    """The payload of an error."""

    code: int
    text: str

    def write(self) -> bytes:
        return bytes((self.code,)) + self.text.encode()


def read_head(cursor: Cursor, *, from_server: bool) -> Head:
    """Take the call byte, and the name of a named answer."""
    first = cursor.take(1)[0]
    kind, number = first >> 6, first & 63
    if from_server and kind == NAMED:
        name = cursor.take(1)[0]
        if not name >> 6:
            raise ReadError("a name has the kind 1, 2 or 3")
        return Head(name >> 6, number, True, name & 63)
    if not from_server and kind in (RESPONSE, ERROR):
        raise ReadError("no record to a server")
    return Head(kind, number, from_server)


def read_failure(cursor: Cursor) -> Failure:
    """Take the payload of an error, to the end."""
    code = cursor.take(1)[0]
    text = read_text(cursor)
    return Failure(code, text) if code in FAILURES else Failure(HANDLER, "")


def read_text(cursor: Cursor) -> str:
    """Take a text of at most 48 bytes, to the end; one that is no UTF-8 counts as none."""
    raw = cursor.rest()
    if len(raw) > TEXT_LIMIT:
        raise ReadError("a text has at most 48 bytes")
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return ""


def first_number(epoch: int) -> int:
    """Return the number of the first call of an epoch."""
    return (epoch - 1) * 23 % 64
