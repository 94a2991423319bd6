"""Commands at the autopilot, until each has ended with an answer that is true.

MAVLink has two traps. A command is sent again until it is acknowledged, so one command may have
several acknowledgements, and an acknowledgement names the command's id alone. So:

- Every sending is noted, and an acknowledgement belongs to the oldest one of its id without one:
  autopilots answer in the order in which they are asked. A late second acknowledgement of one
  command so never ends the next one. A lost acknowledgement costs a repetition, and so does one
  that is taken for a copy.
- A command is accepted if one of its sendings was. It is refused if all were: a refusal of a
  repetition says nothing about the first.

Commands go one after the other, in their order. An abort waits for none, and nothing that was given
before it is sent after it, neither for the first time nor again.
"""

from collections import deque
from collections.abc import Callable
from typing import Final

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.mavlink.commands import IN_PROGRESS, Answer, answer_of_code, command_id
from zacoustic.mavlink.dialect import Message
from zacoustic.mavlink.entries import ABORT

RETRY_NS: Final = seconds_to_ns(1.5)
"""Time for an acknowledgement of an autopilot, which is on a cable."""
TRIES: Final = 5
"""How often a command is sent without an acknowledgement."""
PROGRESS_NS: Final = seconds_to_ns(20.0)
"""Time from an acknowledgement "in progress" to the next one or the last one."""
LATE_NS: Final = seconds_to_ns(30.0)
"""An acknowledgement that is later than this is lost."""
COPIES: Final = 8
"""A copy of so many last acknowledgements of a command is recognised by its packet's number."""
REASON_NS: Final = seconds_to_ns(1.0)
"""An autopilot says at most this long before a refusal why it refuses."""

NO_ANSWER: Final = "the autopilot does not answer; it may have done it"
OVERTAKEN: Final = Answer("superseded", "an abort came later; it was not executed")
EXPIRED: Final = Answer("expired", "too late, or from before a restart: not executed")


class Command:
    """A command for the autopilot.

    Args:
        number: Names the call.
        service: One of `entries.SERVICES`.
        message: Returns the message for it; `confirmation` is the number of its repetition.
        expires_at: Instant after which it is not sent; None: there is none.
    """

    def __init__(
        self,
        number: int,
        service: str,
        message: Callable[..., Message],
        expires_at: int | None,
    ) -> None:
        self.number = number
        self.service = service
        self.message = message
        self.expires_at = expires_at
        self.id = command_id(message(confirmation=0))
        self.sent = self.limit = 0
        self.sent_at = self.due_at = 0
        self.is_in_progress = False
        self.is_held = False
        """It is not sent again."""
        self.refusal: Answer | None = None
        self.has_ended = False

    def is_expired(self, now: int) -> bool:
        """Return whether it may no longer be sent."""
        return self.expires_at is not None and now >= self.expires_at


class Execution:
    """Sends commands until they end.

    Args:
        send: Sends a message to the autopilot.
        reply: Takes each command with its answer, once.
    """

    def __init__(
        self, send: Callable[[Message], None], reply: Callable[[Command, Answer], None]
    ) -> None:
        self._send_message = send
        self._reply = reply
        self._waiting: deque[Command] = deque()
        self._active: list[Command] = []
        # By the command's id: what was sent, oldest first, and has no acknowledgement; and the
        # numbers of the packets with the last ones.
        self._sent: dict[int, deque[tuple[Command, int]]] = {}
        self._numbers: dict[int, deque[int]] = {}
        # Until then, an acknowledgement may be of a command that has ended and is in progress.
        self._doubtful_until: dict[int, int] = {}
        self._text, self._text_at = "", 0

    def begin(self, command: Command, now: int) -> None:
        """Execute a command after all that came before; an abort at once."""
        if command.service != ABORT:
            self._waiting.append(command)
            self._advance(now)
            return
        overtaken = [*self._waiting]
        self._waiting.clear()
        for each in self._active:
            each.is_held = True
        self._start(command, now)
        for each in overtaken:
            self._end(each, OVERTAKEN)

    def handle_acknowledgement(
        self, command: int, result: int, sequence: int | None, now: int
    ) -> None:
        """Take a COMMAND_ACK for this ground station.

        Args:
            command: The command's id.
            result: MAV_RESULT.
            sequence: Number of its packet; None: not known.
            now: The instant.
        """
        sent = self._sent_unanswered(command, now)
        if not sent or self._is_copy(command, sequence):
            return
        owner = sent[0][0]
        if result == IN_PROGRESS:
            owner.is_in_progress, owner.due_at = True, now + PROGRESS_NS
            if owner.has_ended:
                self._doubtful_until[command] = now + PROGRESS_NS
            self._advance(now)
            return
        is_doubtful = self._is_doubtful(command, now)
        sent.popleft()
        if owner.has_ended:
            return
        if is_doubtful:
            self._end(owner, Answer("no_answer", NO_ANSWER))
            self._advance(now)
            return
        answer = answer_of_code(result, "" if result == 0 else self._reason(owner, now))
        if answer.result == "accepted" or all(each is not owner for each, _ in sent):
            self._end(owner, answer)
            self._advance(now)
        else:
            owner.refusal, owner.is_held = answer, True

    def handle_text(self, text: str, now: int) -> None:
        """Note what the autopilot says: it may be why it refuses what comes next."""
        self._text, self._text_at = text, now

    def handle_timeout(self, now: int) -> None:
        """Do what is due."""
        for command in [*self._active]:
            if command.due_at <= now:
                self._try_again(command, now)
        self._advance(now)

    def poll_timeout(self) -> int | None:
        """Return the instant of the next `handle_timeout`."""
        return min((command.due_at for command in self._active), default=None)

    def _advance(self, now: int) -> None:
        """Start what may go now."""
        while self._waiting and not self._is_blocked(self._waiting[0]):
            command = self._waiting.popleft()
            if command.is_expired(now):
                self._end(command, EXPIRED)
            else:
                self._start(command, now)

    def _is_blocked(self, command: Command) -> bool:
        return any(not each.is_in_progress or each.id == command.id for each in self._active)

    def _is_copy(self, command: int, sequence: int | None) -> bool:
        if sequence is None:
            return False
        numbers = self._numbers.setdefault(command, deque(maxlen=COPIES))
        is_copy = sequence in numbers
        numbers.append(sequence)
        return is_copy

    def _start(self, command: Command, now: int) -> None:
        # What others of this id have not got answered takes the first acknowledgements.
        command.limit = TRIES + len(self._sent_unanswered(command.id, now))
        command.sent_at = now
        self._active.append(command)
        self._send(command, now)

    def _send(self, command: Command, now: int) -> None:
        self._sent.setdefault(command.id, deque()).append((command, now))
        self._send_message(command.message(confirmation=command.sent))
        command.sent += 1
        command.due_at = now + RETRY_NS

    def _try_again(self, command: Command, now: int) -> None:
        is_over = command.is_in_progress or command.is_held or command.is_expired(now)
        if not is_over and command.sent < command.limit:
            self._send(command, now)
        elif command.refusal is not None:
            text = f"{command.refusal.result} once; another try may have been done"
            self._end(command, Answer("no_answer", text))
        else:
            self._end(command, Answer("no_answer", NO_ANSWER))

    def _sent_unanswered(self, command: int, now: int) -> deque[tuple[Command, int]]:
        sent = self._sent.get(command, deque())
        while sent and sent[0][0].has_ended and now - sent[0][1] >= LATE_NS:
            sent.popleft()
        return sent

    def _is_doubtful(self, command: int, now: int) -> bool:
        """Return whether an acknowledgement may be of another command, which is in progress.

        That one ends later, out of order, and meanwhile the autopilot refuses the others.
        """
        owners = {each for each, _ in self._sent[command]}
        if len(owners) > 1 and any(each.is_in_progress for each in owners):
            self._doubtful_until[command] = now + PROGRESS_NS
        return now < self._doubtful_until.get(command, now)

    def _reason(self, command: Command, now: int) -> str:
        is_of_it = self._text_at >= max(command.sent_at, now - REASON_NS)
        return self._text if is_of_it else ""

    def _end(self, command: Command, answer: Answer) -> None:
        command.has_ended = True
        if command in self._active:
            self._active.remove(command)
        self._reply(command, answer)
