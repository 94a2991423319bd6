"""One command in flight, and its answer distinguished from all other answers.

Without packets an answer carries no name; only the order shows that it belongs to the last command.
So a late answer is a danger: it may be taken for that of the next command. Therefore the channel
puts a *fence* after each command without an answer: `AT?MODE`, whose answer (`NET`, `AT`) no other
command gives. All answers that come before it are late; the caller gets them as `late`, and they
end nothing. Without an answer to the fence the modem is gone.

An impossible answer (a word where a number was asked) is not taken: ports are noisy.

Nothing is ever sent again from here: the caller decides what a missing answer means.
"""

from collections import deque
from typing import Final

import msgspec

from zacoustic_evologics.at.answers import ReplyCollector, decode_reply
from zacoustic_evologics.at.commands import (
    Act,
    Action,
    Command,
    Query,
    SendBurst,
    SendIm,
    SendIms,
    SendPbm,
    Set,
    SetOption,
)
from zacoustic_evologics.at.encoder import command_name, encode_command
from zacoustic_evologics.at.framing import Framing, Interpreter
from zacoustic_evologics.at.messages import Reply
from zacoustic_evologics.at.replies import (
    Accepted,
    CommandReply,
    DeliveryReply,
    ModeReply,
    Number,
    Refused,
)
from zacoustic_evologics.at.settings import SETTINGS

FENCE: Final = Query("MODE")
"""The question whose answer cannot be mistaken for any other."""
FENCE_TICKET: Final = 0
"""Ticket of the fences that the channel itself puts."""


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """What became of a command."""

    ticket: int
    """The number that `ask` gave; FENCE_TICKET of the channel's own question."""
    command: Command
    """What was asked."""
    reply: CommandReply | None
    """The answer; None when none came in time."""
    late: bool = False
    """It came after None had been returned."""


class _Pending(msgspec.Struct):
    """A command that has been written and not been answered."""

    ticket: int
    command: Command
    due_at: int
    collector: ReplyCollector


class CommandChannel:
    """Writes commands one after the other.

    Args:
        reply_ns: How long an answer may take, ns.
        byte_ns: What each byte takes to reach the modem, ns; 0 on TCP.
    """

    def __init__(self, *, reply_ns: int, byte_ns: int) -> None:
        self.interpreter = Interpreter.NET
        self.framing = Framing.LINES
        self.line_end = b"\n"
        self.stray_replies = 0
        """Answers without a pending command."""
        self.missed_replies = 0
        """Commands that were not answered in time."""
        self._reply_ns = reply_ns
        self._byte_ns = byte_ns
        self._waiting: deque[tuple[int, Command]] = deque()
        self._pending: _Pending | None = None
        self._doubted: tuple[int, Command] | None = None
        self._output: deque[bytes] = deque()
        self._next_ticket = FENCE_TICKET + 1

    @property
    def due_at(self) -> int | None:
        """When to call `handle_timeout`, ns; None while nothing is in flight."""
        return self._pending.due_at if self._pending else None

    def reset(self) -> None:
        """Forget everything: the connection is new."""
        self.interpreter = Interpreter.NET
        self.framing = Framing.LINES
        self._waiting.clear()
        self._pending = None
        self._doubted = None
        self._output.clear()

    def ask(self, command: Command, now: int) -> int:
        """Send a command, behind those that wait; returns its ticket.

        Raises:
            ValueError: The command cannot be written.
        """
        encode_command(command, self.framing, self.line_end)
        ticket = self._next_ticket
        self._next_ticket += 1
        self._waiting.append((ticket, command))
        self._send_next(now)
        return ticket

    def tell(self, command: Command) -> None:
        """Send a command that is not answered; nothing else may be in flight."""
        self.write(encode_command(command, self.framing, self.line_end))

    def write(self, raw: bytes) -> None:
        """Send bytes as they are."""
        self._output.append(raw)

    def poll_output(self) -> bytes | None:
        """Return the bytes to write next."""
        return self._output.popleft() if self._output else None

    def handle_reply(self, reply: Reply, now: int) -> Answer | None:
        """Take an answer, or one line of it; returns what it completes."""
        pending = self._pending
        if pending is None or not _is_named_for(reply, pending.command):
            return self._be_late(reply)
        text = pending.collector.add(reply)
        if text is None:
            return None
        meaning = decode_reply(pending.command, text)
        if not _can_answer(pending.command, meaning):
            pending.collector = ReplyCollector(pending.command, self.interpreter)
            return self._be_late(Reply(text))
        if pending.command == FENCE:
            self._doubted = None
        self._pending = None
        self._send_next(now)
        return Answer(ticket=pending.ticket, command=pending.command, reply=meaning)

    def handle_timeout(self, now: int) -> Answer | None:
        """Give up a command whose time is over."""
        pending = self._pending
        if pending is None or now < pending.due_at:
            return None
        self._pending = None
        self.missed_replies += 1
        if pending.ticket != FENCE_TICKET:
            self._doubted = (pending.ticket, pending.command)
            self._send_next(now)
        return Answer(ticket=pending.ticket, command=pending.command, reply=None)

    def _send_next(self, now: int) -> None:
        if self._pending is not None or not self._waiting:
            return
        ticket: int
        command: Command
        if self._doubted is not None and self._waiting[0][1] != FENCE:
            ticket, command = FENCE_TICKET, FENCE
        else:
            ticket, command = self._waiting.popleft()
        written = encode_command(command, self.framing, self.line_end)
        self.write(written)
        self._pending = _Pending(
            ticket,
            command,
            now + self._reply_ns + self._byte_ns * len(written),
            ReplyCollector(command, self.interpreter),
        )

    def _be_late(self, reply: Reply) -> Answer | None:
        if not reply.text:
            return None  # one firmware sends an empty line after some answers
        self.stray_replies += 1
        if self._doubted is None or not _is_named_for(reply, self._doubted[1]):
            return None
        ticket, command = self._doubted
        meaning = decode_reply(command, reply.text)
        return Answer(ticket=ticket, command=command, reply=meaning, late=True)


def _is_named_for(reply: Reply, command: Command) -> bool:
    return reply.command is None or reply.command == command_name(command)


def _can_answer(command: Command, meaning: CommandReply) -> bool:
    """Tell whether this can be the answer; else it is noise on the line, or of something else."""
    if isinstance(meaning, Refused):
        return command != FENCE
    match command:
        case Query("MODE"):
            return isinstance(meaning, ModeReply)
        case Query("DI"):
            return isinstance(meaning, DeliveryReply)
        case Query(name) if name in _NUMBERS:
            return isinstance(meaning, Number)
        case Set() | SetOption() | Act(Action.RESET):
            return isinstance(meaning, Accepted)
        case SendIm() | SendIms() | SendPbm() | SendBurst():
            return isinstance(meaning, Accepted)
        case Query():
            return not isinstance(meaning, Accepted)
        case _:
            return True


_NUMBERS: Final = frozenset(SETTINGS) | {"CLOCK", "PC", "T"}
