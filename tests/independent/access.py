"""Section 10: CLOCK and TURN. Written from docs/wire.md alone."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError

CLOCK, TURN = 0xBD, 0xBE
CODES = (CLOCK, TURN)
PAUSE = 0xFF
BACK = 0
SPAN_S = 0.02
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True)
class Clock:
    """Network time at the first bit, in 100 µs since 1970; its error in ms, None: unknown."""

    ticks: int
    error_ms: int | None

    @property
    def utc(self) -> datetime:
        return _EPOCH + timedelta(microseconds=100 * self.ticks)

    def write(self) -> bytes:
        error = 0xFF if self.error_ms is None else self.error_ms
        return bytes((CLOCK,)) + self.ticks.to_bytes(6, "big") + bytes((error,))


@dataclass(frozen=True)
class Turn:
    """Who may transmit, and how long, in steps of 20 ms."""

    node: int
    span: int

    @property
    def span_s(self) -> float:
        return self.span * SPAN_S

    def write(self) -> bytes:
        return bytes((TURN, self.node, self.span))


def read(code: int, cursor: Cursor) -> Clock | Turn:
    """Take the body of a control of medium access."""
    if code == CLOCK:
        ticks, error = cursor.number(6), cursor.number(1)
        return Clock(ticks, None if error == 0xFF else error)
    turn = Turn(cursor.number(1), cursor.number(1))
    if turn.node == BACK and turn.span:
        raise ReadError("the span of a turn given back is 0")
    return turn
