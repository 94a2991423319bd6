"""The host's side of an SBD modem, without input and output: AT commands as scripts.

A *script* is a generator: it yields commands and gets their answers, one at a time. There are
three, chosen whenever none runs:

===========  ====================================  =============================================
script       runs when                             does
===========  ====================================  =============================================
set up       the port has opened, or a command     echo off, ring alert and signal reports on
             had no answer
send         a frame waits, and its pause is over  clear the buffer, write, session, clear
fetch        the modem rings, more wait, or it is  session without a message
             time to look
===========  ====================================  =============================================

A session brings at most one message, whichever script has begun it; then it is read. A message that
may have been sent stays in the buffer for the next session. Its number tells what became of it: the
modem counts on when a session has succeeded, also if its answer was lost. Before each session the
modem says whether it still has the message: one that has lost its power has not, and would report
the success of a session without one. The buffer is cleared after a success, or the next session
would send it again.
"""

from collections import deque
from collections.abc import Callable, Generator
from typing import Final, TypeAlias

import msgspec

from zacoustic.core.clock import NS_PER_S
from zacoustic_iridium.budget import Budget
from zacoustic_iridium.config import MOST_SENT_BYTES
from zacoustic_iridium.sbd import (
    LENGTH_BYTES,
    MAYBE_SENT,
    SENT,
    Buffers,
    Session,
    buffers_in,
    checked,
    session_in,
    status_words,
    take_message,
)

_ANSWER_S: Final = 5.0
_WRITE_S: Final = 60.0
_SESSION_S: Final = 120.0
_PAUSES_S: Final = (3.0, 10.0, 30.0, 60.0)
"""Pauses between sessions that failed, s; the last one repeats."""
_SET_UP_AGAIN_S: Final = 2.0
_MOST_BUFFERED: Final = 4096
_MOST_READS: Final = 3
_FINALS: Final = ("OK", "ERROR", "READY")


class Ready(msgspec.Struct, frozen=True):
    """The modem has answered and is set up."""


class Silent(msgspec.Struct, frozen=True):
    """The modem does not answer."""

    reason: str
    """What was asked."""


class Arrived(msgspec.Struct, frozen=True):
    """A message has come."""

    data: bytes
    """Its content."""
    at: int
    """Instant of its last byte, ns."""


class Ended(msgspec.Struct, frozen=True):
    """The frame was sent, or not."""

    is_sent: bool
    """Whether the gateway has it."""
    detail: str
    """Why it was not, in words."""


Event: TypeAlias = Ready | Silent | Arrived | Ended


class _Ask(msgspec.Struct, frozen=True):
    """A command, and how long its answer may take."""

    line: bytes
    limit_s: float = _ANSWER_S
    is_binary: bool = False
    """Whether the answer is a message, not lines."""


class _Answer(msgspec.Struct, frozen=True):
    """An answer; `final` is empty if none came in time."""

    final: str = ""
    lines: tuple[str, ...] = ()
    data: bytes | None = None


_Script: TypeAlias = Generator[_Ask, _Answer, None]


class SbdModem:
    """One modem.

    Args:
        budget: What may be paid for.
        give_up_s: How long to try to send a frame, s.
        check_s: Look for messages so often, s; 0: only when it rings.
    """

    def __init__(self, budget: Budget, *, give_up_s: float = 300.0, check_s: float = 0.0) -> None:
        self._budget = budget
        self._give_up_ns = round(give_up_s * NS_PER_S)
        self._check_ns = round(check_s * NS_PER_S)
        self.bars: int | None = None
        """Signal, 0…5; None: unknown."""
        self.sessions = 0
        """How many sessions were begun."""
        self.failed_sessions = 0
        """How many of them have brought nothing."""
        self._writes: deque[bytes] = deque()
        self._events: deque[Event] = deque()
        self._buffer = bytearray()
        self._is_connected = self._is_ready = False
        self._frame: bytes | None = None
        self._number: int | None = None
        """Number of the frame, from its first session on."""
        self._give_up_at = 0
        self._tries = 0
        self._next_try_at = 0
        self._waiting = 0
        self._rings = False
        self._forgot = False
        self._is_unread = False
        """Whether a message has come that could not be read yet."""
        self._check_at: int | None = None
        self._script: _Script | None = None
        self._asked: _Ask | None = None
        self._lines: list[str] = []
        self._data: bytes | None = None
        self._due_at = 0
        self._set_up_at = 0
        self._now = 0

    # Inputs

    def connected(self, now: int) -> None:
        """The port has opened."""
        self._drop()
        self._is_connected, self._set_up_at = True, now
        self._go_on(now)

    def lost(self, now: int) -> None:
        """The port is gone."""
        self._drop()
        self._is_connected = False
        self._end(is_sent=False, detail="the port is gone")

    def send(self, frame: bytes, now: int) -> None:
        """Send a frame; `Ended` follows. Only one at a time."""
        self._frame, self._number = frame, None
        self._tries, self._next_try_at = 0, now
        self._give_up_at = now + self._give_up_ns
        self._go_on(now)

    def received(self, data: bytes, now: int) -> None:
        """Take bytes of the modem."""
        self._buffer += data
        del self._buffer[:-_MOST_BUFFERED]
        self._now = now
        while self._take_one():
            pass
        self._go_on(now)

    def timeout(self, now: int) -> None:
        """The instant of `poll_timeout` has come."""
        if self._asked is not None and now >= self._due_at:
            self._answer(_Answer(), now)
        self._go_on(now)

    # Outputs

    def poll_write(self) -> bytes | None:
        """Return the next bytes for the modem."""
        return self._writes.popleft() if self._writes else None

    def poll_event(self) -> Event | None:
        """Return the next event."""
        return self._events.popleft() if self._events else None

    def poll_timeout(self) -> int | None:
        """Return the instant of the next `timeout`, ns."""
        if self._asked is not None:
            return self._due_at
        if not self._is_connected:
            return None
        if not self._is_ready:
            return self._set_up_at
        instants = [self._check_at] if self._check_at is not None else []
        if self._frame is not None:
            instants.append(self._next_try_at)
        return min(instants, default=None)

    # Below the methods above

    def _drop(self) -> None:
        """Forget what was under way: nobody will answer."""
        self._script = self._asked = None
        self._buffer.clear()
        self._writes.clear()
        self._is_ready = False

    def _go_on(self, now: int) -> None:
        """Begin the next script, if none runs."""
        self._now = now
        if self._script is not None or not self._is_connected:
            return
        begin: Callable[[], _Script] | None = None
        if not self._is_ready:
            begin = self._set_up if now >= self._set_up_at else None
        elif self._frame is not None and now >= self._next_try_at:
            begin = self._send
        elif self._wants_look(now):
            begin = self._fetch
        if begin is not None:
            self._script = begin()
            self._ask(next(self._script, None), now)

    def _wants_look(self, now: int) -> bool:
        is_time = self._check_at is not None and now >= self._check_at
        if (
            not (self._rings or self._waiting or self._is_unread or is_time)
            or self._frame is not None
        ):
            return False
        if is_time:
            self._check_at = now + self._check_ns
        return self._budget.allows(0, now)

    def _ask(self, ask: _Ask | None, now: int) -> None:
        """Write the next command of the script; None: it is over."""
        self._asked = ask
        if ask is None:
            self._script = None
            self._is_ready &= not self._forgot
            self._go_on(now)
            return
        self._lines.clear()
        self._data = None
        self._due_at = now + round(ask.limit_s * NS_PER_S)
        self._writes.append(ask.line)

    def _answer(self, answer: _Answer, now: int) -> None:
        """Give the answer to the script."""
        script, self._now = self._script, now
        if script is None:
            return
        try:
            ask = script.send(answer)
        except StopIteration:
            self._ask(None, now)
        else:
            self._ask(ask, now)

    def _take_one(self) -> bool:
        """Take a line or a message from the buffer; return False when it needs more bytes."""
        if self._expects_message():
            taken = take_message(bytes(self._buffer))
            if taken is None:
                return False
            data, size_bytes = taken
            del self._buffer[:size_bytes]
            self._data = b"" if data is None else data
            self._lines.append("ok" if data is not None else "damaged")
            return True
        ends = [at for at in (self._buffer.find(b"\r"), self._buffer.find(b"\n")) if at >= 0]
        if not ends:
            return False
        line = self._buffer[: min(ends)].decode("ascii", "replace").strip()
        del self._buffer[: min(ends) + 1]
        self._take_line(line)
        return True

    def _expects_message(self) -> bool:
        """Return whether a message is next; a line, such as a ring, may come before it."""
        if self._asked is None or not self._asked.is_binary or self._data is not None:
            return False
        return int.from_bytes(self._buffer[:LENGTH_BYTES], "big") <= MOST_SENT_BYTES

    def _take_line(self, line: str) -> None:
        if not line:
            return
        if line.startswith("AT"):
            self._forgot = True  # it says again what it hears: it has lost its settings
            return
        if line == "SBDRING":
            self._rings = True
        elif line.startswith("+CIEV:0,") and line[8:].isdigit():
            self.bars = int(line[8:])
        elif self._asked is None:
            return
        elif line in _FINALS:
            self._answer(_Answer(line, tuple(self._lines), self._data), self._now)
        else:
            self._lines.append(line)

    # Scripts

    def _set_up(self) -> _Script:
        for line in (b"AT\r", b"ATE0\r", b"AT&K0\r", b"AT+SBDMTA=1\r", b"AT+CIER=1,1,0,0\r"):
            answer = yield _Ask(line)
            if not answer.final:
                self._fell_silent(line)
                return
        self._is_ready, self._forgot = True, False
        if self._check_ns:
            self._check_at = self._now + self._check_ns
        self._events.append(Ready())

    def _fell_silent(self, line: bytes) -> None:
        self._is_ready, self._set_up_at = False, self._now + round(_SET_UP_AGAIN_S * NS_PER_S)
        self._events.append(Silent(f"no answer to {line.decode().strip()}"))

    def _send(self) -> _Script:
        frame = self._frame
        assert frame is not None
        if not self._budget.allows(len(frame), self._now):
            self._end(is_sent=False, detail="the budget of the day is spent")
            return
        yield from self._read()
        buffers = yield from self._buffers()
        if buffers is None:
            self._failed("the modem does not say what it holds")
            return
        if self._number is not None and buffers.next_number != self._number:
            yield from self._is_through()  # only the answer of that session was lost
            return
        has_it = self._number is not None and buffers.has_message
        if not has_it and not (yield from self._write(frame)):
            self._failed("the modem has not taken the message")
            return
        self._number = buffers.next_number
        session = yield from self._session(len(frame))
        if session is None:
            self._failed("the modem has not answered in a session")
        elif session.sent in SENT:
            yield from self._is_through()
        else:
            self._failed(status_words(session.sent))

    def _buffers(self) -> "Generator[_Ask, _Answer, Buffers | None]":
        """Ask what the modem holds."""
        answer = yield _Ask(b"AT+SBDS\r")
        if not answer.final:
            self._fell_silent(b"AT+SBDS")
        return next(filter(None, map(buffers_in, answer.lines)), None)

    def _write(self, frame: bytes) -> "Generator[_Ask, _Answer, bool]":
        """Write a frame into the modem's buffer; return whether it has taken it."""
        yield _Ask(b"AT+SBDD0\r")
        ready = yield _Ask(b"AT+SBDWB=%d\r" % len(frame), _WRITE_S)
        taken = _Answer()
        if ready.final == "READY":
            taken = yield _Ask(checked(frame), _WRITE_S)
        if not ready.final or (ready.final == "READY" and not taken.final):
            self._fell_silent(b"AT+SBDWB")
        return "0" in taken.lines

    def _is_through(self) -> _Script:
        """Report the frame as sent, and clear the buffer."""
        self._end(is_sent=True, detail="")
        yield _Ask(b"AT+SBDD0\r")

    def _fetch(self) -> _Script:
        yield from self._read()
        yield _Ask(b"AT+SBDD0\r")
        session = yield from self._session(0)
        if session is None or session.received != 1:
            self._rings = False
            self._waiting = 0 if session is None or session.sent in SENT else self._waiting
            if session is not None and session.sent not in SENT:  # it will ring again, or be asked
                self._check_at = self._now + round(_PAUSES_S[-1] * NS_PER_S)

    def _session(self, sent_bytes: int) -> "Generator[_Ask, _Answer, Session | None]":
        """Begin a session, read what it brings, and pay for it."""
        self.sessions += 1
        line = b"AT+SBDIXA\r" if self._rings else b"AT+SBDIX\r"
        answer = yield _Ask(line, _SESSION_S)
        session = next(filter(None, map(session_in, answer.lines)), None)
        if not answer.final:
            self._fell_silent(line)
        if session is None:
            self.failed_sessions += 1
            return None
        if session.sent in SENT or session.sent in MAYBE_SENT:
            self._budget.spend(sent_bytes, self._now)
        if session.sent not in SENT:
            self.failed_sessions += 1
        if session.sent in SENT:
            self._waiting = session.waiting
            self._rings = False
        if session.received == 1 and session.received_bytes:
            self._budget.spend(session.received_bytes, self._now)
            self._is_unread = True
            yield from self._read()
        return session

    def _read(self) -> _Script:
        """Read the message that has come; the modem keeps it until the next one comes."""
        for _ in range(_MOST_READS if self._is_unread else 0):
            answer = yield _Ask(b"AT+SBDRB\r", is_binary=True)
            if answer.data:
                self._is_unread = False
                self._events.append(Arrived(answer.data, self._now))
                return
            self._buffer.clear()

    def _failed(self, detail: str) -> None:
        """Try again after a pause, or give up."""
        pause_s = _PAUSES_S[min(self._tries, len(_PAUSES_S) - 1)]
        self._tries += 1
        self._next_try_at = self._now + round(pause_s * NS_PER_S)
        if self._next_try_at >= self._give_up_at:
            self._end(is_sent=False, detail=detail)

    def _end(self, *, is_sent: bool, detail: str) -> None:
        if self._frame is None:
            return
        self._frame = None
        self._events.append(Ended(is_sent, detail))
