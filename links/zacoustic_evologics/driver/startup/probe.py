r"""Finding a modem in any state: interpreter, mode, line end.

The query is `+++AT?MODE`, repeated in different forms:

- A modem in data mode answers with a packet.
- A modem that reads lines (NET interpreter, or AT interpreter in command mode) answers with an
  error, which also ends an unfinished line typed before.
- A modem that reads lines with the other line end does not answer; so the probe tries that line end
  next. The modem has taken the query for the beginning of a line, which costs an error.
- A modem that waits for the rest of a payload swallows all that. So as a last resort, once for each
  loss of the modem, the probe sends more bytes than any payload has, without a line end. Then none
  follows where the payload must end, and the modem refuses the message instead of sending it.

In data mode such a filler would be data for the channel; therefore it comes last, and `startup`
clears the buffer after it.
"""

from typing import Final

from zacoustic_evologics.at.commands import Query
from zacoustic_evologics.at.encoder import encode_command
from zacoustic_evologics.at.fields import BURST_LIMIT_BYTES
from zacoustic_evologics.at.framing import SERIAL_LINE_END, TCP_LINE_END, Framing, Interpreter
from zacoustic_evologics.at.messages import Message, Reply
from zacoustic_evologics.at.replies import RefusalKind

FILLER: Final = b"A" * (BURST_LIMIT_BYTES + 1)
"""Completes the longest payload that a modem may wait for."""

_QUESTION: Final = Query("MODE")
_REFUSALS: Final = tuple(kind.value for kind in RefusalKind)
_PLAIN_ANSWERS: Final = tuple(each.value for each in Interpreter)


class Probe:
    """Sends queries until the modem answers.

    Args:
        is_serial: The port is a serial port: carriage return comes first.
        may_fill: The filler may be used.
        reply_ns: Time limit of an answer, ns.
        byte_ns: Time of each byte on the port, ns.
    """

    def __init__(self, *, is_serial: bool, may_fill: bool, reply_ns: int, byte_ns: int) -> None:
        usual, other = SERIAL_LINE_END, TCP_LINE_END
        if not is_serial:
            usual, other = other, usual
        self.framing: Framing | None = None
        """Framing of the modem; None: unknown."""
        self.line_end = usual
        """Line end of the last query."""
        self.has_filled = False
        """The filler was sent."""
        self.due_at: int | None = None
        """When to call `handle_timeout`, ns."""
        self._reply_ns = reply_ns
        self._byte_ns = byte_ns
        self._attempts = [(usual, b""), (other, b"")]
        if may_fill:
            self._attempts += [(usual, FILLER), (other, b"")]

    def start(self, now: int) -> bytes:
        """Return the first query."""
        return self._ask(now) or b""

    def handle_message(self, message: Message) -> bool:
        """Take a message of the modem; return whether it was the expected sign."""
        if not isinstance(message, Reply):
            return False
        if message.command is not None:
            self.framing = Framing.PACKETS
        elif message.text.startswith(_REFUSALS) or message.text in _PLAIN_ANSWERS:
            self.framing = Framing.LINES
        return self.framing is not None

    def handle_timeout(self, now: int) -> bytes | None:
        """Return the next query; None: all have been sent."""
        return self._ask(now)

    def _ask(self, now: int) -> bytes | None:
        if not self._attempts:
            self.due_at = None
            return None
        self.line_end, before = self._attempts.pop(0)
        self.has_filled = self.has_filled or bool(before)
        end = self.line_end if before else b""
        question = before + end + encode_command(_QUESTION, Framing.PACKETS, self.line_end)
        self.due_at = now + self._reply_ns + self._byte_ns * len(question)
        return question
