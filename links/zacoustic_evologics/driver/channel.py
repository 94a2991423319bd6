"""One command in flight, and its answer distinguished from all others.

Outside of packets an answer carries no name; only the order relates it to the last command. So a
late answer may be taken for that of the next command. Therefore the channel puts a *fence* after
each unanswered command: `AT?MODE`, whose answer (`NET`, `AT`) no other command gives. All answers
before that one are late; the caller gets them as `late`, and they complete no command. If the fence
is not answered, the modem is gone.

The channel ignores an impossible answer (a word to the query of a number): ports are noisy.

The channel repeats nothing: the caller decides what a missing answer means.
"""

from collections import deque
from typing import Final

import msgspec

from zacoustic_evologics.at import commands as asked
from zacoustic_evologics.at.answers import ReplyCollector, answers_to, decode_reply
from zacoustic_evologics.at.encoder import command_name, encode_command
from zacoustic_evologics.at.framing import Framing, Interpreter
from zacoustic_evologics.at.messages import Reply
from zacoustic_evologics.at.replies import (
    Accepted,
    CommandReply,
    Refused,
)
from zacoustic_evologics.at.settings import SETTINGS

FENCE: Final = asked.Query("MODE")
"""The query whose answer cannot be mistaken for another."""
FENCE_TICKET: Final = 0
"""Ticket of the channel's own fences."""


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a command."""

    ticket: int
    """The number returned by `ask`; FENCE_TICKET for the channel's own query."""
    command: asked.Command
    """The command."""
    reply: CommandReply | None
    """The answer; None: none came in time."""
    late: bool = False
    """It came after None had been returned."""


class _Pending(msgspec.Struct):
    """A command that is written and not answered yet."""

    ticket: int
    command: asked.Command
    due_at: int
    collector: ReplyCollector


class CommandChannel:
    """Writes commands one after the other.

    Args:
        reply_ns: Time limit of an answer, ns.
        byte_ns: Time of each byte on the port, ns; 0 on TCP.
    """

    def __init__(self, *, reply_ns: int, byte_ns: int) -> None:
        self.interpreter = Interpreter.NET
        self.framing = Framing.LINES
        self.line_end = b"\n"
        self.stray_replies = 0
        """Number of answers without a pending command."""
        self.missed_replies = 0
        """Number of commands not answered in time."""
        self._reply_ns = reply_ns
        self._byte_ns = byte_ns
        self._waiting: deque[tuple[int, asked.Command]] = deque()
        self._pending: _Pending | None = None
        self._doubted: tuple[int, asked.Command] | None = None
        self._output: deque[bytes] = deque()
        self._next_ticket = FENCE_TICKET + 1

    @property
    def due_at(self) -> int | None:
        """When to call `handle_timeout`, ns; None while nothing is in flight."""
        return self._pending.due_at if self._pending else None

    def reset(self) -> None:
        """Discard all state: the connection is new."""
        self.interpreter = Interpreter.NET
        self.framing = Framing.LINES
        self._waiting.clear()
        self._pending = None
        self._doubted = None
        self._output.clear()

    def ask(self, command: asked.Command, now: int) -> int:
        """Send a command after those that wait; return its ticket.

        Raises:
            ValueError: The command cannot be written.
        """
        encode_command(command, self.framing, self.line_end)
        ticket = self._next_ticket
        self._next_ticket += 1
        self._waiting.append((ticket, command))
        self._send_next(now)
        return ticket

    def tell(self, command: asked.Command) -> None:
        """Send a command that has no answer; no other may be in flight."""
        self.write(encode_command(command, self.framing, self.line_end))

    def write(self, raw: bytes) -> None:
        """Send bytes as they are."""
        self._output.append(raw)

    def poll_output(self) -> bytes | None:
        """Return the bytes to write next."""
        return self._output.popleft() if self._output else None

    def handle_reply(self, reply: Reply, now: int) -> Answer | None:
        """Take an answer, or one line of it; return what it completes."""
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
        command: asked.Command
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


def _is_named_for(reply: Reply, command: asked.Command) -> bool:
    return reply.command is None or reply.command == command_name(command)


def _can_answer(command: asked.Command, meaning: CommandReply) -> bool:
    """Tell whether this can be the answer; otherwise it is noise, or answers something else."""
    if isinstance(meaning, Refused):
        return command != FENCE
    if isinstance(command, asked.Query) and command.name in _CERTAIN:
        return isinstance(meaning, answers_to(command))
    if isinstance(command, asked.Query):
        return not isinstance(meaning, Accepted)
    is_reset = isinstance(command, asked.Act) and command.action is asked.Action.RESET
    if is_reset or isinstance(command, asked.PayloadCommand | asked.Set | asked.SetOption):
        return isinstance(meaning, Accepted)
    return True


_CERTAIN: Final = frozenset(SETTINGS) | {"MODE", "DI", "CLOCK", "PC", "T"}
"""Queries whose answers have one form in all sources."""
