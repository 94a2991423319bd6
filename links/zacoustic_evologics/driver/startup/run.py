"""Runs a start-up: the probe until the modem gives a sign, then its stages."""

from zacoustic.core.clock import seconds_to_ns
from zacoustic_evologics.at.commands import Query
from zacoustic_evologics.at.messages import Message
from zacoustic_evologics.at.replies import CommandReply
from zacoustic_evologics.driver.channel import Answer, CommandChannel
from zacoustic_evologics.driver.session.session import ModemSession
from zacoustic_evologics.driver.startup.probe import Probe
from zacoustic_evologics.driver.startup.startup import (
    SILENT,
    Pause,
    Reached,
    Stages,
    StartupError,
)
from zacoustic_evologics.driver.states import Input


class StartupRun:
    """One start-up. Its methods return the stages that they have completed.

    All of them raise `StartupError` if the modem does not answer, or cannot serve this node.

    Args:
        channel: Takes commands.
        session: Takes the values.
        probe: Not started yet.
        stages: Not started yet.
    """

    def __init__(
        self, channel: CommandChannel, session: ModemSession, probe: Probe, stages: Stages
    ) -> None:
        self.ticket: int | None = None
        """Ticket of the awaited answer's command."""
        self._channel = channel
        self._session = session
        self._probe: Probe | None = probe
        self._stages = stages
        self._resume_at: int | None = None

    @property
    def due_at(self) -> int | None:
        """When to call `handle_timeout`, ns."""
        return self._resume_at if self._probe is None else self._probe.due_at

    @property
    def is_probing(self) -> bool:
        """The modem has not answered yet."""
        return self._probe is not None

    def start(self, now: int) -> None:
        """Send the first query."""
        if self._probe is not None:
            self._channel.write(self._probe.start(now))

    def handle_message(self, message: Message, now: int) -> list[Input]:
        """Take a message of the modem during the probe."""
        probe = self._probe
        if probe is None or not probe.handle_message(message) or probe.framing is None:
            return []
        self._channel.framing = probe.framing
        self._channel.line_end = probe.line_end
        self._probe = None
        return self._advance(None, now)

    def handle_answer(self, answer: Answer, now: int) -> list[Input]:
        """Take the answer to the command of `ticket`."""
        self.ticket = None
        if answer.command == Query("CLOCK"):
            self._session.clock_read_at = now
        return self._advance(answer.reply, now)

    def handle_timeout(self, now: int) -> list[Input]:
        """Handle the end of a pause, or of the time for a query of the probe."""
        if self.due_at is None or now < self.due_at:
            return []
        if self._probe is None:
            self._resume_at = None
            return self._advance(None, now)
        question = self._probe.handle_timeout(now)
        if question is None:
            raise StartupError(SILENT)
        if self._probe.has_filled:
            self._session.may_fill = False
            self._session.needs_clearing = True
        self._channel.write(question)
        return []

    def _advance(self, reply: CommandReply | None, now: int) -> list[Input]:
        """Advance to the next command or pause."""
        reached: list[Input] = []
        try:
            step = self._stages.send(reply)
            while isinstance(step, Reached):
                reached.append(step.stage)
                step = self._stages.send(None)
        except StopIteration:
            return reached
        if isinstance(step, Pause):
            self._resume_at = now + seconds_to_ns(step.duration_s)
        else:
            self.ticket = self._channel.ask(step, now)
        return reached
