"""One frame, from the first question to its one report.

::

    CHECKING ─LISTENING─► PREPARING ─PREPARED─► GIVING ─ACCEPTED─► FLYING ─PROVEN─► OVER
      ▲  │ OCCUPIED           ▲ DONE             │  │               │ ▲ │
      │  ▼                    │                  │  │    RUMOUR, DUE▼ │ └EXPIRED─► DROPPING ─► OVER
    PAUSING ◄─────────────────┼─────────NOT_NOW──┤  │UNANSWERED  POLLING
                           MENDING ◄──MENDABLE───┘  ▼               │ IDLE
                                                 DOUBTING ─► OVER   └► VERIFYING ─► OVER

What must never happen, and what prevents it:

- *A frame is sent twice.* It is given again only after the modem has refused it in words. Once it
  may have it (an answer that got lost is enough), it is never given again.
- *An old word is taken for a new one.* See `sending_evidence`. What is left of a frame that was
  given up is dropped in the modem (DROPPING), and after a loss of the connection `startup` waits
  for it.
- *A frame is called sent that was not.* When the modem stops saying what it always says, it may
  have been restarted with the frame in it. So before silence is taken for success, it is asked
  whether it still has the extended notifications switched on (VERIFYING).
"""

from typing import Final

from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.linktypes import Transmission, TransmitOutcome, TransmitReport
from zacoustic_evologics.at.commands import Command, Query, Set
from zacoustic_evologics.at.notifications import (
    Notification,
    RecvEnd,
    RecvFailed,
    SendEnd,
    SendStart,
    Status,
)
from zacoustic_evologics.at.replies import DeliveryReply, DeliveryState, Number, Refused
from zacoustic_evologics.config import IN_AIR_SOURCE_LEVEL
from zacoustic_evologics.driver.channel import Answer, CommandChannel
from zacoustic_evologics.driver.sending_answers import read_answer, said
from zacoustic_evologics.driver.sending_evidence import Evidence
from zacoustic_evologics.driver.sending_service import (
    Carriage,
    Remedy,
    Service,
    remedy_command,
    remedy_for,
)
from zacoustic_evologics.driver.sending_states import HAS_FRAME, TRANSITIONS, Phase, Word
from zacoustic_evologics.driver.sending_times import BUSY_PAUSE_S, Timetable
from zacoustic_evologics.driver.session import ModemSession

_STIRRING: Final = (RecvEnd, RecvFailed, SendEnd, Status)


class Sending:
    """One frame on its way.

    Args:
        transmission: What is to be sent.
        carriage: By which service.
        channel: Where commands go.
        session: What is known of the modem.
        now: Instant of the call of `transmit`, ns.
    """

    def __init__(
        self,
        transmission: Transmission,
        carriage: Carriage,
        channel: CommandChannel,
        session: ModemSession,
        now: int,
    ) -> None:
        self._is_burst = carriage.service is Service.BURST
        self.phase = Phase.CHECKING if self._is_burst else Phase.PREPARING
        self.carriage = carriage
        self.ticket: int | None = None
        """Of the command whose answer is waited for."""
        self.due_at: int | None = None
        """When `handle_timeout` is to be called, ns."""
        self.report: TransmitReport | None = None
        """There in the phase OVER."""
        self.suspicion = ""
        """Why the modem is not to be trusted any more; empty if it is."""
        self._transmission = transmission
        self._channel = channel
        self._session = session
        self._called_at = now
        self._times = Timetable(carriage, session)
        self._evidence = Evidence(carriage, session, self._times.airtime_ns)
        self._busy_until = now + self._times.busy_ns
        self._limit_at = 0
        self._preparations: list[Command] = []
        self._counter: int | None = None
        self._has_asked = False
        self._answer = self._asked = ""
        self._refusal = ""
        self._state: DeliveryState | None = None
        self._remedy = Remedy.NONE
        self._mended: set[Remedy] = set()
        self._loss = ""

    def start(self, now: int) -> None:
        """Begin."""
        self._enter(now)

    def handle_answer(self, answer: Answer, now: int) -> None:
        """Take the answer to the command of `ticket`."""
        reply = answer.reply
        self.ticket = None
        self._answer = said(reply) if reply is not None else "no answer"
        word = read_answer(self.phase, answer, self.carriage, self._counter)
        if isinstance(reply, Refused) and word in (Word.NOT_NOW, Word.MENDABLE):
            self._remedy = remedy_for(reply)
            self._refusal = self._answer
            word = Word.NOT_NOW if self._remedy in self._mended else word
        elif isinstance(reply, Number) and self.phase is Phase.PREPARING:
            self._counter = reply.value
        elif self.phase is Phase.POLLING:
            self._has_asked = True
            self._asked = self._answer
            self._state = reply.state if isinstance(reply, DeliveryReply) else None
        if word is Word.PREPARED and self._preparations:
            self._prepare(now)
        else:
            self._step(word, now)

    def handle_notification(self, record: Notification, now: int) -> None:
        """Take what the modem says; most of it is about something else."""
        if isinstance(record, _STIRRING):
            self._step(Word.STIRRED, now)
        if self.phase not in HAS_FRAME:
            return
        word = self._evidence.handle(record, self._counter, now)
        if word is not None:
            self._step(word, now)
        elif isinstance(record, SendStart) and self.phase is Phase.FLYING:
            self.due_at = self._first_poll_at(now)

    def handle_timeout(self, now: int) -> None:
        """The time of the phase is over."""
        if self.due_at is None or now < self.due_at:
            return
        end_at = self._busy_until if self.phase is Phase.PAUSING else self._limit_at
        self._step(Word.EXPIRED if now >= end_at else Word.DUE, now)

    def handle_lost(self, reason: str, now: int) -> None:
        """The connection, or the modem, is gone."""
        self._loss = reason
        self._step(Word.LOST, now)

    def _step(self, word: Word, now: int) -> None:
        """Look the next phase up, and do what it is for."""
        before = self.phase
        after = TRANSITIONS.get((before, word))
        if after is None or after is before:
            return
        self.phase = after
        self.due_at = None
        if after is Phase.OVER:
            self._conclude(before, word, now)
        else:
            self._enter(now)

    def _enter(self, now: int) -> None:
        """Do what the phase is for."""
        match self.phase:
            case Phase.CHECKING:
                self._ask(Query("S"), now)
            case Phase.PREPARING:
                self._preparations = self._to_prepare()
                self._prepare(now)
            case Phase.GIVING:
                self._evidence.begin(now)
                self._limit_at = 0
                self._has_asked = False
                self._ask(self.carriage.command(), now)
            case Phase.DOUBTING | Phase.POLLING:
                self._ask(self.carriage.state_query(), now)
            case Phase.PAUSING:
                self._evidence.forget()
                self.due_at = min(now + seconds_to_ns(BUSY_PAUSE_S), self._busy_until)
            case Phase.MENDING:
                self._evidence.forget()
                self._mended.add(self._remedy)
                self._ask(remedy_command(self._remedy), now)
            case Phase.FLYING:
                self._fly(now)
            case Phase.VERIFYING if self._is_silence_suspect():
                self._ask(Query("ZX"), now)
            case Phase.VERIFYING:
                self._step(Word.DONE, now)
            case Phase.DROPPING:
                self._ask(self.carriage.drop_command(), now)
            case Phase.OVER:
                pass

    def _to_prepare(self) -> list[Command]:
        """What is asked before the frame is given."""
        # A modem that was switched off and on since the start is as loud as it was stored.
        on_deck = self._session.config.deck
        preparations: list[Command] = [Set("L", IN_AIR_SOURCE_LEVEL)] if on_deck else []
        return [*preparations, Query("PC")] if self._is_burst else preparations

    def _prepare(self, now: int) -> None:
        if self._preparations:
            self._ask(self._preparations.pop(0), now)
        else:
            self._step(Word.PREPARED, now)

    def _ask(self, command: Command, now: int) -> None:
        self.ticket = self._channel.ask(command, now)

    def _fly(self, now: int) -> None:
        """Wait for the end, at first for as long as it takes."""
        if self._evidence.outcome is not None and not self._has_asked:
            self._step(Word.PROVEN if self._evidence.is_certain else Word.RUMOUR, now)
        elif self._limit_at:
            self.due_at = min(now + self._times.poll_ns, self._limit_at)
        else:
            self._limit_at = self._evidence.given_at + self._times.limit_ns
            self.due_at = self._first_poll_at(now)

    def _first_poll_at(self, now: int) -> int:
        given_at, ends_at = self._evidence.given_at, self._evidence.ends_at
        return min(max(now, self._times.first_poll_at(given_at, ends_at)), self._limit_at)

    def _conclude(self, before: Phase, word: Word, now: int) -> None:
        """Make the report."""
        outcome, detail = self._judge(before, word)
        is_silent = outcome is TransmitOutcome.REJECTED or before not in HAS_FRAME
        started_at = self._called_at if is_silent else self._evidence.started_at
        self.report = TransmitReport(
            transmission_id=self._transmission.transmission_id,
            outcome=outcome,
            started_at=min(now, max(self._called_at, started_at)),
            finished_at=now,
            detail=detail,
        )

    def _judge(self, before: Phase, word: Word) -> tuple[TransmitOutcome, str]:
        """Return what is to be reported, and the modem's words."""
        evidence = self._evidence
        if evidence.outcome is not None and evidence.is_certain and word is not Word.REFUSED:
            return evidence.outcome, evidence.words
        match before, word:
            case _, Word.REFUSED:
                return TransmitOutcome.REJECTED, self._answer
            case _, Word.EXPIRED:
                waited_s = self._session.config.busy_s
                return (
                    TransmitOutcome.REJECTED,
                    f"{self._refusal or 'no time'}, {waited_s:g} s long",
                )
            case Phase.VERIFYING, Word.DONE:
                return self._judge_silence()
            case Phase.DROPPING, _:
                return TransmitOutcome.ABORTED, "the modem says nothing of its end; dropped"
            case _, Word.LOST:
                return TransmitOutcome.ABORTED, self._loss
            case Phase.DOUBTING, Word.IDLE:
                asked = self.carriage.state_query().name
                return TransmitOutcome.ABORTED, f"no answer; then AT?{asked}: {self._answer}"
            case _, Word.RESTARTED:
                self.suspicion = "the modem has been restarted"
            case _:
                self.suspicion = "the modem does not answer"
        return TransmitOutcome.ABORTED, self.suspicion

    def _is_silence_suspect(self) -> bool:
        """The modem has said nothing, and should have."""
        return self._session.has_extended_notifications and self._evidence.outcome is None

    def _judge_silence(self) -> tuple[TransmitOutcome, str]:
        """The modem is done with the frame; it was asked, and there may be a rumour."""
        state, rumour = self._state, self._evidence.outcome
        outcome = TransmitOutcome.SENT
        if self.carriage.acknowledged:
            outcome = _OUTCOME_OF_ACKNOWLEDGED.get(state, rumour or TransmitOutcome.ABORTED)
        elif state is DeliveryState.EXPIRED:
            outcome = TransmitOutcome.REJECTED
        elif rumour is not None:
            outcome = rumour
        # Without either: also a firmware that does not know AT?DI has taken the message, and the
        # time is over.
        asked = f"AT?{self.carriage.state_query().name}: {self._asked}"
        return outcome, self._evidence.words if outcome is rumour else asked


_OUTCOME_OF_ACKNOWLEDGED: Final[dict[DeliveryState | None, TransmitOutcome]] = {
    DeliveryState.DELIVERED: TransmitOutcome.DELIVERED,
    DeliveryState.FAILED: TransmitOutcome.NOT_DELIVERED,
}
