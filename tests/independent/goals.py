"""Section 12: the content of an action. Written from docs/wire.md alone."""

from dataclasses import dataclass

from tests.independent.calls import read_text
from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError

GOAL, CLAIM, NO_REQUEST, CONFIRM, CANCEL, CANCEL_AGAIN, NO_RESULT, FORMER = range(8)
SUCCEEDED, ACCEPTED, REFUSED, _, WILL_END, FEEDBACK, RESULT, _ = range(8)
TO_SERVER = ("GOAL", "CLAIM", None, "CONFIRM", "CANCEL", "CANCEL AGAIN", None, "FORMER")
FROM_SERVER = (
    "SUCCEEDED",
    "ACCEPTED",
    "REFUSED",
    "CONFIRM",
    "CANCEL",
    "FEEDBACK",
    "RESULT",
    "FORMER",
)
STATUSES = {4: "succeeded", 5: "canceled", 6: "aborted"}
UNKNOWN, REMINDER = 0x80, 0x81
NO_RESULT_FOLLOWS = 0x80
FAILURES = range(1, 11)
_REJECTED = 1
CANCEL_AGAIN_REFUSED = 10


@dataclass(frozen=True)
class Head:
    """What stands before the payload of a goal's record. `epoch`: that of FORMER."""

    operation: str
    number: int
    from_server: bool
    epoch: int | None = None

    def write(self) -> bytes:
        names = FROM_SERVER if self.from_server else TO_SERVER
        code = names.index(self.operation)
        if self.epoch is None:
            return bytes((code << 5 | self.number,))
        former = bytes((FORMER << 5 | self.number,)) + self.epoch.to_bytes(2, "big")
        return former + bytes((code << 5,))


@dataclass(frozen=True)
class Refusal:
    """The payload of REFUSED."""

    failure: int
    attempt: int | None
    text: str

    def write(self) -> bytes:
        attempt = b"" if self.attempt is None else bytes((self.attempt,))
        return bytes((self.failure,)) + attempt + self.text.encode()


def read_head(cursor: Cursor, *, from_server: bool) -> Head:
    """Take the operation and the number, and what FORMER adds."""
    names = FROM_SERVER if from_server else TO_SERVER
    first = cursor.take(1)[0]
    code, number = first >> 5, first & 31
    epoch = None
    if code == FORMER:
        epoch = cursor.number(2)
        inner = cursor.take(1)[0]
        code = inner >> 5
        if inner & 31 or code == FORMER:
            raise ReadError("the operation of FORMER is alone in its byte")
    operation = names[code]
    if operation is None:
        raise ReadError("no operation to a server")
    return Head(operation, number, from_server, epoch)


def read_refusal(cursor: Cursor) -> Refusal:
    """Take the payload of REFUSED, to the end."""
    failure = cursor.take(1)[0]
    attempt = cursor.take(1)[0] if failure == CANCEL_AGAIN_REFUSED else None
    text = read_text(cursor)
    if failure not in FAILURES:
        return Refusal(_REJECTED, None, "")
    return Refusal(failure, attempt, text)


def has_result(status: int) -> bool:
    return not status & NO_RESULT_FOLLOWS


def first_number(epoch: int) -> int:
    """Return the number of the first goal of an epoch."""
    return (epoch - 1) * 11 % 32
