"""Sections 3 and 8: HELLO, TAG, CONFIRM, ASK, TABLE, and what may be decoded.

Written from docs/wire.md alone.
"""

from dataclasses import dataclass, field
from enum import Enum

from tests.independent.cursor import Cursor

VERSION = 2
HELLO, TAG, CONFIRM, ASK, TABLE = 0xB0, 0xB1, 0xB5, 0xB6, 0xB7
CODES = (HELLO, TAG, CONFIRM, ASK, TABLE)
DESTINATION = 0
PROVISIONAL = 0xFF


@dataclass(frozen=True)
class Hello:
    """The sender's epoch and table."""

    version: int
    epoch: int
    digest: bytes

    def write(self) -> bytes:
        return bytes((HELLO, self.version)) + self.epoch.to_bytes(2, "big") + self.digest


@dataclass(frozen=True)
class Tag:
    """The sender's epoch."""

    epoch: int

    def write(self) -> bytes:
        return bytes((TAG,)) + self.epoch.to_bytes(2, "big")


@dataclass(frozen=True)
class Confirm:
    """The sender knows the table of that epoch of a node, and has the same."""

    node: int
    epoch: int

    def write(self) -> bytes:
        return bytes((CONFIRM, self.node)) + self.epoch.to_bytes(2, "big")


@dataclass(frozen=True)
class Ask:
    """Asks a node for its HELLO (0), or for a row of its table."""

    node: int
    stream: int

    def write(self) -> bytes:
        return bytes((ASK, self.node, self.stream))


@dataclass(frozen=True)
class Row:
    """TABLE: a row of the sender's table; without digest: it has no such stream."""

    epoch: int
    stream: int
    digest: bytes

    def write(self) -> bytes:
        return bytes((TABLE,)) + self.epoch.to_bytes(2, "big") + bytes((self.stream,)) + self.digest


Control = Hello | Tag | Confirm | Ask | Row


def read(code: int, cursor: Cursor) -> Control:
    """Take the body of a control of agreement."""
    if code == HELLO:
        return Hello(cursor.number(1), cursor.number(2), cursor.take(4))
    if code == TAG:
        return Tag(cursor.number(2))
    if code == CONFIRM:
        return Confirm(cursor.number(1), cursor.number(2))
    if code == ASK:
        return Ask(cursor.number(1), cursor.number(1))
    return Row(cursor.number(2), cursor.number(1), cursor.take(4))


class Verdict(Enum):
    """What section 8 says of a record."""

    DECODE = "decode"
    UNCONFIRMED = "unconfirmed"
    DIFFERS = "differs"


@dataclass
class Known:
    """What a receiver knows of the source of a frame, by the HELLOs and rows that it has heard.

    `own`: the digest of its own table; `own_rows`: those of its streams. Times are in seconds.
    """

    own: bytes
    own_rows: dict[int, bytes] = field(default_factory=dict)
    settling_s: float = 0.0
    hello: Hello | None = None
    since_s: float = 0.0
    rows: dict[int, bytes] = field(default_factory=dict)

    def take(self, control: Control, now_s: float) -> None:
        """Take a control of agreement of the source."""
        if isinstance(control, Hello) and control.version == VERSION:
            if control != self.hello:
                if self.hello is None or control.epoch != self.hello.epoch:
                    self.rows.clear()
                self.hello = control
                self.since_s = now_s
        elif isinstance(control, Tag):
            if self.hello is not None and control.epoch != self.hello.epoch:
                self.hello = None
                self.rows.clear()
        elif isinstance(control, Row) and self.hello and control.epoch == self.hello.epoch:
            self.rows[control.stream] = control.digest

    def vouched(self, tag: Tag, now_s: float) -> None:
        """Take a TAG with a confirm of the own present epoch for a HELLO with the own digest."""
        self.take(Hello(VERSION, tag.epoch, self.own), now_s)

    def equal(self, stream: int) -> bool:
        if self.hello is None:
            return False
        if self.hello.digest == self.own:
            return True
        own = self.own_rows.get(stream)
        return own is not None and self.rows.get(stream) == own

    def verdict(self, introduction: Hello | Tag | None, stream: int, now_s: float) -> Verdict:
        """Return whether a record may be decoded: rules 1 to 3."""
        if self.hello is None:
            return Verdict.UNCONFIRMED
        if introduction is None:
            if self.hello.digest != self.own:
                return Verdict.DIFFERS
            settled = now_s >= self.since_s + self.settling_s
            return Verdict.DECODE if settled else Verdict.UNCONFIRMED
        if introduction.epoch != self.hello.epoch:
            return Verdict.UNCONFIRMED
        return Verdict.DECODE if self.equal(stream) else Verdict.DIFFERS
