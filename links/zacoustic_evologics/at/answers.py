"""The meaning of an answer's text, by the command that was sent; and its text from the meaning.

One command is in flight at a time, so an answer carries no name: the dialogue collects it
(`ReplyCollector`) and reads it (`decode_reply`); an emulator writes it (`reply_text`).

In the LINES framing an empty line ends an answer of several lines; the collector joins the lines to
the text that a packet would have.
"""

from typing import Final

from zacoustic_evologics.at.commands import Command, Help, Query
from zacoustic_evologics.at.encoder import command_name
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.at.messages import Reply
from zacoustic_evologics.at.replies import (
    Accepted,
    CommandReply,
    LinkStatus,
    NetStatus,
    Number,
    Refused,
    TextReply,
)
from zacoustic_evologics.at.table import ANSWERS, ANSWERS_TO, SEVERAL_LINES

_LABELS: Final = (
    "Local Address",
    "Remote Address",
    "Acoustic Link Status",
    "Pool Status",
    "Promiscuous Mode",
)
"""Labels of `AT?S`; they are uncertain, so they are written and not read."""


def decode_reply(command: Command, text: str) -> CommandReply:
    """Read an answer by its command; an unexpected one becomes `TextReply`.

    Args:
        command: The answered command.
        text: The whole text; several lines with their line feeds.
    """
    for kind in (Accepted, Refused, *answers_to(command)):
        reply: CommandReply | None = ANSWERS[kind].read(_unlabelled(kind, text))
        if reply is not None:
            return reply
    return TextReply(text)


def answers_to(command: Command) -> tuple[type, ...]:
    """Return the kinds of answers that a command may have, besides those that fit every command."""
    default = (Number,) if isinstance(command, Query) else ()
    return ANSWERS_TO.get(command_name(command), default)


def reply_text(reply: CommandReply) -> str:
    """Write an answer; one of several lines ends with a line feed.

    Raises:
        ValueError: A value that its field does not allow.
    """
    if isinstance(reply, TextReply):
        return reply.text
    text = ANSWERS[type(reply)].write(reply)
    if isinstance(reply, NetStatus):
        lines = zip(_LABELS, text.split("\n"), strict=True)
        return "".join(f"{label}: {value}\n" for label, value in lines)
    return text


def _unlabelled(kind: type, text: str) -> str:
    """Return a text without the parts that mean nothing in this kind of answer."""
    if kind is LinkStatus:
        return text.removeprefix("[*]")
    if kind is NetStatus:
        lines = [line for line in text.splitlines() if line.strip()]
        return "\n".join(line.partition(":")[2].strip() for line in lines)
    return text


class ReplyCollector:
    """Joins the lines that answer one command.

    Args:
        command: The command that was sent.
        interpreter: The interpreter of the port.
    """

    def __init__(self, command: Command, interpreter: Interpreter) -> None:
        name = command_name(command)
        self._several = isinstance(command, Help) or name in SEVERAL_LINES
        if name == "?S":
            self._several = interpreter is Interpreter.NET
        self._lines: list[str] = []

    def add(self, reply: Reply) -> str | None:
        """Take a reply; return the whole text once it is complete.

        It skips an empty line where none is expected: one firmware adds one to its `OK`.
        """
        if reply.command is not None:
            return reply.text
        if self._several:
            if not self._lines and ANSWERS[Refused].read(reply.text):
                return reply.text
            if reply.text:
                self._lines.append(reply.text + "\n")
                return None
            return "".join(self._lines) or None
        return reply.text or None
