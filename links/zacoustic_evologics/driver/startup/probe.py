r"""Finding a modem in any state: interpreter, mode, line end.

The question is `+++AT?MODE`, repeated in different forms:

- A modem in data mode answers with a packet.
- One that reads lines (NET interpreter, or AT interpreter in command mode) answers with an error,
  and what somebody has typed half before ends with the error too.
- One that reads lines of the other kind answers nothing; so the other line end is tried. The
  question that it has taken for the beginning of a line costs an error.
- One that waits for the rest of a payload swallows all that. So at last, once for each loss of the
  modem, it gets more bytes than any payload has, none of them a line end: then none stands where
  the payload must end, and the modem refuses the message instead of sending it.

In data mode such a filler would be data for the channel, which is why it comes last, and why
`startup` clears the buffer after it.
"""

from typing import Final

from zacoustic_evologics.at.commands import Query
from zacoustic_evologics.at.encoder import BURST_LIMIT_BYTES, encode_command
from zacoustic_evologics.at.framing import SERIAL_LINE_END, TCP_LINE_END, Framing
from zacoustic_evologics.at.messages import Message, Reply
from zacoustic_evologics.at.replies import RefusalKind

FILLER: Final = b"A" * (BURST_LIMIT_BYTES + 1)
"""Ends the longest payload that may be waited for."""

_QUESTION: Final = Query("MODE")
_REFUSALS: Final = tuple(kind.value for kind in RefusalKind)
_PLAIN_ANSWERS: Final = ("AT", "NET")


class Probe:
    """Asks until the modem gives a sign.

    Args:
        is_serial: The port is a serial one: carriage return is tried first.
        may_fill: The filler may be used.
        reply_ns: How long an answer may take, ns.
        byte_ns: What each byte takes to reach the modem, ns.
    """

    def __init__(self, *, is_serial: bool, may_fill: bool, reply_ns: int, byte_ns: int) -> None:
        usual, other = SERIAL_LINE_END, TCP_LINE_END
        if not is_serial:
            usual, other = other, usual
        self.framing: Framing | None = None
        """How the modem divides; None while nothing is known."""
        self.line_end = usual
        """Line end of the question that was asked last."""
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
        """Return the first question."""
        return self._ask(now) or b""

    def handle_message(self, message: Message) -> bool:
        """Take a message of the modem; True when it was the sign."""
        if not isinstance(message, Reply):
            return False
        if message.command is not None:
            self.framing = Framing.PACKETS
        elif message.text.startswith(_REFUSALS) or message.text in _PLAIN_ANSWERS:
            self.framing = Framing.LINES
        return self.framing is not None

    def handle_timeout(self, now: int) -> bytes | None:
        """Return the next question; None when all have been asked."""
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
