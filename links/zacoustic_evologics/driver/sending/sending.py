"""One frame, from the first query to its one report.

::

    CHECKING ─LISTENING─► PREPARING ─PREPARED─► GIVING ─ACCEPTED─► FLYING ─PROVEN─► OVER
      ▲  │ OCCUPIED           ▲ DONE             │  │               │ ▲ │
      │  ▼                    │                  │  │    RUMOUR, DUE▼ │ └EXPIRED─► DROPPING ─► OVER
    PAUSING ◄─────────────────┼─────────NOT_NOW──┤  │UNANSWERED  POLLING
                           MENDING ◄──MENDABLE───┘  ▼               │ IDLE
                                                 DOUBTING ─► OVER   └► VERIFYING ─► OVER

What must never happen, and what prevents it:

- *A frame is sent twice.* It is given again only after the modem has explicitly refused it or
  returned it unsent. Once the modem may have it (a lost answer is enough), it is never given again.
- *An old message is taken for a new one.* See `evidence`. A frame that was given up is dropped in
  the modem (DROPPING), and after a loss of the connection `startup` waits for it.
- *A piggyback message stays behind.* Its success is silent, and it could leave at any later time.
  So the driver tells the modem to drop it once it should have left (POLLING); the answer then shows
  whether it had. If not, it goes as an instant message, or waits for an opportunity (RETURNED).
- *An unsent frame is reported as sent.* If the modem's usual messages stop, it may have been
  restarted with the frame in it. So before silence counts as success, the driver asks whether the
  extended notifications are still switched on (VERIFYING).
"""

from typing import Final

from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.linktypes import Transmission, TransmitOutcome, TransmitReport
from zacoustic_evologics.at import notifications as said
from zacoustic_evologics.at.commands import Command, Query, Set
from zacoustic_evologics.at.encoder import encode_command
from zacoustic_evologics.at.framing import Framing
from zacoustic_evologics.at.replies import (
    Accepted,
    DeliveryReply,
    DeliveryState,
    Number,
    Refused,
)
from zacoustic_evologics.config import IN_AIR_SOURCE_LEVEL
from zacoustic_evologics.driver.channel import FENCE, Answer, CommandChannel
from zacoustic_evologics.driver.sending.answers import in_words, read_answer
from zacoustic_evologics.driver.sending.evidence import Evidence
from zacoustic_evologics.driver.sending.service import (
    DROP_MESSAGES,
    Carriage,
    Remedy,
    Service,
    remedy_command,
    remedy_for,
)
from zacoustic_evologics.driver.sending.states import HAS_FRAME, TRANSITIONS, Phase, Word
from zacoustic_evologics.driver.sending.times import BURSTS_BUSY_S, BUSY_PAUSE_S, Timetable
from zacoustic_evologics.driver.session.session import ModemSession

_STIRRING: Final = (said.RecvEnd, said.RecvFailed, said.SendEnd, said.Status)


class Sending:
    """One frame under way.

    Args:
        transmission: The frame to send.
        carriage: The service that carries it.
        channel: Takes commands.
        session: State of the modem.
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
        self.phase = Phase.CHECKING if carriage.service is Service.BURST else Phase.PREPARING
        self.carriage = carriage
        """Its service; another one if the modem returns it."""
        self.ticket: int | None = None
        """Ticket of the awaited answer's command."""
        self.due_at: int | None = None
        """When to call `handle_timeout`, ns."""
        self.report: TransmitReport | None = None
        """Its report, in the phase OVER."""
        self.has_begun = False
        """Whether it was started."""
        self.suspicion = ""
        """Why the modem is not trustworthy any more; empty: it is."""
        self._transmission = transmission
        self._channel = channel
        self._session = session
        self._called_at = now
        self._times = Timetable(carriage, session, now)
        self._evidence = Evidence(carriage, session, self._times.airtime_ns)
        self._limit_at = 0
        self._preparations: list[Command] = []
        self._counter: int | None = None
        self._has_asked = False
        self._answer = self._asked = ""
        self._refusal = self._doubted = ""
        self._state: DeliveryState | None = None
        self._remedy = Remedy.NONE
        self._mended: set[Remedy] = set()
        self._loss = ""

    @property
    def answer(self) -> said.RecvEnd | None:
        """The sound of the acknowledgement, if the modem has reported it."""
        return self._evidence.answer

    def start(self, now: int) -> None:
        """Begin."""
        self.has_begun = True
        self._enter(now)

    def handle_answer(self, answer: Answer, now: int) -> None:
        """Take the answer to the command of `ticket`."""
        reply = answer.reply
        self.ticket = None
        self._answer = in_words(reply) if reply is not None else "no answer"
        if answer.command == DROP_MESSAGES and isinstance(reply, Accepted):
            self._session.has_piggyback = False
        if isinstance(reply, Accepted) and answer.command == Set(
            "RI", self._session.config.retries
        ):
            self._session.may_repeat = False
        word = read_answer(self.phase, answer, self.carriage, self._counter)
        is_refused = isinstance(reply, Refused) and self.phase is Phase.GIVING
        if is_refused and word is Word.UNANSWERED:
            self._doubted = self._answer
        elif is_refused and self.carriage.alternative:
            word = Word.RETURNED
        elif isinstance(reply, Refused) and word in (Word.NOT_NOW, Word.MENDABLE):
            self._remedy = remedy_for(reply)
            self._refusal = self._answer
            word = Word.NOT_NOW if self._remedy in self._mended else word
        elif isinstance(reply, Number) and self.phase is Phase.PREPARING:
            self._counter = reply.value
        elif self.phase is Phase.DOUBTING and word is Word.IDLE and self._was_refused(now):
            word, self._answer = Word.REFUSED, self._doubted
        elif self.phase is Phase.POLLING:
            self._has_asked = True
            self._asked = self._answer
            self._state = reply.state if isinstance(reply, DeliveryReply) else None
            if self._is_piggyback and word is Word.UNANSWERED:
                # The modem may have dropped the message, and said so in what was lost with the
                # answer: that it has none any more will not prove that a sound took it along.
                self._evidence.forget()
        if word is Word.PREPARED and self._preparations:
            self._prepare(now)
        else:
            self._step(word, now)

    def _was_refused(self, now: int) -> bool:
        """Tell whether unknown words were a refusal: the modem cannot have sent the frame."""
        is_burst = self.carriage.service is Service.BURST
        return bool(self._doubted) and (is_burst or self._evidence.is_too_soon(now))

    def handle_notification(self, record: said.Notification, now: int) -> None:
        """Take a message of the modem; most are about other matters."""
        if isinstance(record, _STIRRING):
            self._step(Word.STIRRED, now)
        if self.phase not in HAS_FRAME:
            return
        word = self._evidence.handle(record, self._counter, now)
        if word is Word.PROVEN and self._can_be_given_again(now):
            word = Word.RETURNED
        if word is not None:
            self._step(word, now)
        elif isinstance(record, said.SendStart) and self.phase is Phase.FLYING:
            self.due_at = self._first_poll_at(now)

    def handle_timeout(self, now: int) -> None:
        """Handle the end of the phase's time."""
        if self.due_at is None or now < self.due_at:
            return
        is_pausing = self.phase is Phase.PAUSING
        end_at = self._later(self._times.busy_until) if is_pausing else self._limit_at
        if self.phase is Phase.FLYING:
            end_at = self._later(end_at)
        self._step(Word.EXPIRED if now >= end_at else Word.DUE, now)

    def handle_lost(self, reason: str, now: int) -> None:
        """Handle the loss of the connection or the modem."""
        self._loss = reason
        self._step(Word.LOST, now)

    def _step(self, word: Word, now: int) -> None:
        """Look the next phase up and enter it."""
        before = self.phase
        after = TRANSITIONS.get((before, word))
        if after is None or after is before:
            return
        self.phase = after
        self.due_at = None
        if word is Word.RETURNED:
            self._use(self._next_carriage(now))
        if after is Phase.OVER:
            self._conclude(before, word, now)
        else:
            self._enter(now)

    def _next_carriage(self, now: int) -> Carriage:
        """Return the service by which a frame that the modem has returned goes next."""
        carriage, session = self.carriage, self._session
        if carriage.rides_back and session.is_receiving_bursts(carriage.destination, now):
            return carriage  # the next train is acknowledged as well
        return carriage.alternative or carriage

    def _use(self, carriage: Carriage) -> None:
        """Begin again with this service; earlier messages do not count."""
        self.carriage = carriage
        self._times = Timetable(carriage, self._session, self._called_at)
        self._evidence = Evidence(carriage, self._session, self._times.airtime_ns)

    def _can_be_given_again(self, now: int) -> bool:
        """Tell whether a piggyback message certainly has not left, and may go another way."""
        is_back = self._evidence.outcome is TransmitOutcome.REJECTED
        if not (self._is_piggyback and is_back):
            return False
        return self.carriage.alternative is not None or now < self._times.busy_until

    def _enter(self, now: int) -> None:
        """Do the work of the phase."""
        match self.phase:
            case Phase.CHECKING:
                self._ask(Query("S"), now)
            case Phase.PREPARING:
                self._preparations = self._to_prepare(now)
                self._prepare(now)
            case Phase.GIVING:
                self._evidence.begin(now)
                self._doubted = ""
                self._limit_at = 0
                self._has_asked = False
                self._session.has_piggyback |= self._is_piggyback
                self._ask(self.carriage.command(), now)
            case Phase.DOUBTING | Phase.POLLING:
                self._ask(self.carriage.state_query(), now)
            case Phase.PAUSING:
                self._evidence.forget()
                pause_ns = seconds_to_ns(self._session.rng.uniform(*BUSY_PAUSE_S))
                self.due_at = min(now + pause_ns, self._later(self._times.busy_until))
            case Phase.MENDING:
                self._evidence.forget()
                self._mended.add(self._remedy)
                self._ask(remedy_command(self._remedy), now)
            case Phase.FLYING:
                self._fly(now)
            case Phase.VERIFYING if self._is_silence_suspect():
                is_told = self._session.has_extended_notifications
                self._ask(Query("ZX") if is_told else FENCE, now)
            case Phase.VERIFYING:
                self._step(Word.DONE, now)
            case Phase.DROPPING:
                self._ask(self.carriage.drop_command(), now)
            case Phase.OVER:
                pass

    def _to_prepare(self, now: int) -> list[Command]:
        """Return the queries and settings before the frame is given."""
        # A modem that was switched off and on since the start has its stored source level and
        # number of repetitions.
        on_deck = self._session.config.deck
        preparations: list[Command] = [Set("L", IN_AIR_SOURCE_LEVEL)] if on_deck else []
        is_message = self.carriage.service is Service.IM and self.carriage.acknowledged
        if is_message and self._session.must_set_retries(now):
            preparations.append(Set("RI", self._session.config.retries))
        if self._is_piggyback and self._session.has_piggyback:
            preparations.append(DROP_MESSAGES)  # else its end would be taken for this frame's
        if self.carriage.service is Service.BURST:
            preparations.append(Query("PC"))
        return preparations

    def _prepare(self, now: int) -> None:
        if self._preparations:
            self._ask(self._preparations.pop(0), now)
        else:
            self._step(Word.PREPARED, now)

    def _ask(self, command: Command, now: int) -> None:
        self.ticket = self._channel.ask(command, now)

    def _fly(self, now: int) -> None:
        """Wait for the end, at first for the airtime."""
        self._evidence.is_accepted = True
        if self._evidence.outcome is not None and not self._has_asked:
            self._step(Word.PROVEN if self._evidence.is_certain else Word.RUMOUR, now)
        elif self._limit_at:
            self.due_at = min(now + self._times.poll_ns, self._later(self._limit_at))
        else:
            self._limit_at = self._evidence.given_at + self._times.limit_ns
            self.due_at = self._first_poll_at(now)

    def _later(self, limit_at: int) -> int:
        """Return a limit as it is because of burst data that the modem sends before this frame, ns.

        Once it has none any more, the frame has as much time as it has without any.
        """
        latest_at = limit_at + seconds_to_ns(BURSTS_BUSY_S)
        if self._session.has_bursts:
            return latest_at
        had_until = self._session.had_bursts_until
        if had_until is None:
            return limit_at
        return min(latest_at, max(limit_at, had_until + self._times.limit_ns))

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
        """Return the outcome, with the modem's words."""
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
                return TransmitOutcome.ABORTED, f"no answer; then {self._question}: {self._answer}"
            case _, Word.RESTARTED:
                self.suspicion = "the modem has been restarted"
            case _:
                self.suspicion = "the modem does not answer"
        return TransmitOutcome.ABORTED, self.suspicion

    @property
    def _is_piggyback(self) -> bool:
        return self.carriage.service is Service.PIGGYBACK

    @property
    def _question(self) -> str:
        """Return the query about the frame, as text."""
        return encode_command(self.carriage.state_query(), Framing.LINES, b"").decode("ascii")

    def _is_silence_suspect(self) -> bool:
        """Tell whether the modem is silent although it should not be, or its silence is a proof."""
        if self._is_piggyback:
            return True
        return self._session.has_extended_notifications and self._evidence.outcome is None

    def _judge_silence(self) -> tuple[TransmitOutcome, str]:
        """Return the outcome if the modem has no frame any more; there may be a rumour."""
        state, rumour = self._state, self._evidence.outcome
        outcome = TransmitOutcome.SENT
        if self.carriage.acknowledged:
            outcome = _OUTCOME_OF_ACKNOWLEDGED.get(state, rumour or TransmitOutcome.ABORTED)
        elif state is DeliveryState.EXPIRED:
            outcome = TransmitOutcome.REJECTED
        elif rumour is not None:
            outcome = rumour
        elif self._is_piggyback:
            outcome = TransmitOutcome.ABORTED  # it has not reported any sound to that destination
        # Without either: even a firmware that does not know AT?DI has taken the message, and the
        # time is over.
        asked = f"{self._question}: {self._asked}"
        return outcome, self._evidence.words if outcome is rumour else asked


_OUTCOME_OF_ACKNOWLEDGED: Final[dict[DeliveryState | None, TransmitOutcome]] = {
    DeliveryState.DELIVERED: TransmitOutcome.DELIVERED,
    DeliveryState.FAILED: TransmitOutcome.NOT_DELIVERED,
}
