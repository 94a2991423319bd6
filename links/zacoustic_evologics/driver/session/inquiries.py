"""Single queries that belong to no state: no caller waits for their answers.

- After an exchange: the propagation delay (`AT?T`). The answer is about the last exchange, so it is
  ignored if the modem has received a message meanwhile, or if it does not fit the duration of ours.
- After a frame, now and then: the supply voltage (`AT?BV`).
- After a message that a working modem does not send: whether it was restarted. A restarted modem
  has lost the request of this port for extended notifications (`AT?ZX`); if they are not wanted, an
  answer as before must do.
- On deck, after somebody has raised the source level: set it back (`AT!L3`).
"""

from collections.abc import Callable
from typing import Final

from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.linktypes import TransmitReport
from zacoustic_evologics.at.commands import Command, Query, Set
from zacoustic_evologics.at.notifications import RecvEnd
from zacoustic_evologics.at.replies import Accepted, CommandReply, Measurement, Number
from zacoustic_evologics.config import IN_AIR_SOURCE_LEVEL
from zacoustic_evologics.driver.channel import FENCE, Answer, CommandChannel
from zacoustic_evologics.driver.events import Event, Measured
from zacoustic_evologics.driver.session.measuring import measured_delay, modem_read
from zacoustic_evologics.driver.session.session import ModemSession

CHECK_PAUSE_S: Final = 10.0
"""Pause between two checks, s: received data may look like a restart while it comes."""

BATTERY_PAUSE_S: Final = 300.0
"""Pause between two readings of the supply voltage, s."""

See = Callable[[CommandReply | None, int], str]


class Inquiries:
    """Asks, and reads the answers.

    Args:
        channel: Takes commands.
        session: Takes the values.
        tell: Takes the events.
    """

    def __init__(
        self,
        channel: CommandChannel,
        session: ModemSession,
        tell: Callable[[list[Event]], None],
    ) -> None:
        self._channel = channel
        self._session = session
        self._tell = tell
        self._messages = 0
        self._battery_at: int | None = None
        self._sent: dict[int, See] = {}
        self._checked_at: int | None = None

    def forget(self) -> None:
        """Discard all state: the connection is new."""
        self._sent.clear()
        self._checked_at = self._battery_at = None

    def note_message(self) -> None:
        """Note a message: from now on the modem's measurements may be about its sender."""
        self._messages += 1

    def measure_delay(
        self, address: int, report: TransmitReport, answer: RecvEnd | None, now: int
    ) -> None:
        """Ask for the propagation delay of the exchange with another modem that has just ended.

        Args:
            address: The other modem.
            report: Report of our frame.
            answer: The sound of its acknowledgement, if the modem has reported it.
            now: The instant.
        """
        messages = self._messages
        longest_us = (report.finished_at - report.started_at) // 2000

        def see(reply: CommandReply | None, at: int) -> str:
            is_ours = isinstance(reply, Number) and messages == self._messages
            if not isinstance(reply, Number) or not is_ours or reply.value > longest_us:
                return ""
            self._session.note_delay(address, reply.value)
            found = measured_delay(self._session, address, reply.value, report.finished_at, answer)
            if found is not None:
                self._tell([Measured(found)])
            return ""

        self._send(Query("T"), see, now)

    def read_battery(self, now: int) -> None:
        """Ask for the supply voltage unless that was done recently; the start-up reads it too."""
        if self._battery_at is None:
            self._battery_at = now
        if now - self._battery_at < seconds_to_ns(BATTERY_PAUSE_S):
            return
        self._battery_at = now

        def see(reply: CommandReply | None, at: int) -> str:
            if isinstance(reply, Measurement):
                self._session.battery_v = reply.value
                self._tell([Measured(modem_read(self._session, at))])
            return ""

        self._send(Query("BV"), see, now)

    def check(self, now: int) -> None:
        """Ask whether the modem was restarted, unless that was done recently."""
        if self._checked_at is not None and now - self._checked_at < seconds_to_ns(CHECK_PAUSE_S):
            return
        self._checked_at = now
        is_told = self._session.has_extended_notifications
        self._send(Query("ZX") if is_told else FENCE, _see_options, now)

    def silence(self, now: int) -> None:
        """Set the source level back to that for air."""

        def see(reply: CommandReply | None, at: int) -> str:
            if not isinstance(reply, Accepted):
                return "the source level on deck cannot be set back"
            self._session.source_level = IN_AIR_SOURCE_LEVEL
            self._tell([Measured(modem_read(self._session, at))])
            return ""

        self._send(Set("L", IN_AIR_SOURCE_LEVEL), see, now)

    def handle_answer(self, answer: Answer, now: int) -> str:
        """Take an answer; return why the modem is not trustworthy any more, or an empty text."""
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
