"""Single questions that belong to no state: nobody waits for their answers.

- After an exchange: how long the sound took (`AT?T`).
- When something arrives that a modem in order does not say: whether it has been restarted. A
  restarted one has forgotten that this port wants extended notifications (`AT?ZX`); where they are
  not wanted, that it answers as before must do.
- On deck, when somebody has made it louder: set it back (`AT!L3`).
"""

from collections.abc import Callable
from typing import Final

from zacoustic.core.clock import seconds_to_ns
from zacoustic_evologics.at.commands import Command, Query, Set
from zacoustic_evologics.at.replies import Accepted, CommandReply, Number
from zacoustic_evologics.config import IN_AIR_SOURCE_LEVEL
from zacoustic_evologics.driver.channel import FENCE, Answer, CommandChannel
from zacoustic_evologics.driver.session import ModemSession

CHECK_PAUSE_S: Final = 10.0
"""Between two checks, s: data from the water may look like a restart for as long as it comes."""

See = Callable[[CommandReply | None, int], str]


class Errands:
    """Asks, and reads the answers.

    Args:
        channel: Where commands go.
        session: Where what is read goes.
    """

    def __init__(self, channel: CommandChannel, session: ModemSession) -> None:
        self._channel = channel
        self._session = session
        self._sent: dict[int, See] = {}
        self._checked_at: int | None = None

    def forget(self) -> None:
        """The connection is another one."""
        self._sent.clear()
        self._checked_at = None

    def measure_delay(self, address: int, now: int) -> None:
        """Ask how long the sound took in the exchange with another modem that has just ended."""

        def see(reply: CommandReply | None, at: int) -> str:
            if isinstance(reply, Number):
                self._session.note_delay(address, reply.value, at)
            return ""

        self._send(Query("T"), see, now)

    def check(self, now: int) -> None:
        """Ask whether the modem has been restarted, if that was not asked lately."""
        if self._checked_at is not None and now - self._checked_at < seconds_to_ns(CHECK_PAUSE_S):
            return
        self._checked_at = now
        is_told = self._session.has_extended_notifications
        self._send(Query("ZX") if is_told else FENCE, _see_options, now)

    def silence(self, now: int) -> None:
        """Set the source level back to what is allowed in air."""

        def see(reply: CommandReply | None, at: int) -> str:
            if not isinstance(reply, Accepted):
                return "the source level on deck cannot be set back"
            self._session.source_level = IN_AIR_SOURCE_LEVEL
            return ""

        self._send(Set("L", IN_AIR_SOURCE_LEVEL), see, now)

    def handle_answer(self, answer: Answer, now: int) -> str:
        """Take an answer; returns why the modem is not to be trusted any more, or nothing."""
        see = self._sent.pop(answer.ticket, None)
        return see(answer.reply, now) if see is not None else ""

    def _send(self, command: Command, see: See, now: int) -> None:
        self._sent[self._channel.ask(command, now)] = see


def _see_options(reply: CommandReply | None, now: int) -> str:
    if reply is None:
        return "the modem does not answer"
    if isinstance(reply, Number) and reply.value == 0:
        return "the modem has been restarted"
    return ""
