"""Sends a signal when it can, repeats it until it is answered, and gives up at last.

::

    WAITING ──free──► SENDING ──sent──► AWAITING ──answer──► ended: ANSWERED
       ▲                  │                 │
       │                  │ no answer asked └──time over──► ended: UNANSWERED
       │                  └──► ended: SENT      │
       └──────────── attempts left ─────────────┘

It can: the modem does not transmit, is not in the pause behind its last signal, owes no answer,
awaits none of another exchange, and nothing comes in. With `force` only the first two count.

The owner of an exchange calls `look` whenever something may have changed; it gets the outcome
once. A cancelled exchange has none.
"""

import enum
from collections.abc import Callable

from zacoustic.channel.agenda import Entry
from zacoustic_evologics.emulator.hardware.airtime import TURNAROUND_NS
from zacoustic_evologics.emulator.hardware.chassis import Chassis
from zacoustic_evologics.emulator.hardware.signals import Hearing, Signal, SignalKind
from zacoustic_evologics.emulator.hardware.transducer import Transducer


class ExchangeState(enum.Enum):
    """Where an exchange is."""

    WAITING = "waiting"
    """Until it can be sent."""
    SENDING = "sending"
    """It goes out."""
    AWAITING = "awaiting"
    """It has gone out without an answer."""
    ENDED = "ended"
    """Nothing happens any more."""


class Ending(enum.Enum):
    """How an exchange has ended."""

    SENT = "sent"
    """It has gone out, and asks for no answer."""
    ANSWERED = "answered"
    """The other modem has it."""
    UNANSWERED = "unanswered"
    """Nobody answered any attempt."""


class Exchange:
    """One signal with its repetitions.

    Args:
        chassis: Of the modem.
        transducer: Of the modem.
        signal: What is sent.
        answer: What answers it; None: nothing does.
        attempts: How often it may be sent; None: for ever.
        force: Sent even while something comes in.
        ended: Told how it has ended, with the instant.
    """

    def __init__(
        self,
        chassis: Chassis,
        transducer: Transducer,
        signal: Signal,
        *,
        answer: SignalKind | None,
        attempts: int | None,
        force: bool = False,
        ended: Callable[[Ending, int], None],
    ) -> None:
        self.signal = signal
        self.state = ExchangeState.WAITING
        self._chassis = chassis
        self._transducer = transducer
        self._answer = answer
        self._attempts = attempts
        self._force = force
        self._ended = ended
        self._timer: Entry | None = None
        self._sent_at = 0
        self._is_late = False

    @property
    def is_acknowledged(self) -> bool:
        """Whether it asks for an answer."""
        return self._answer is not None

    def look(self, now: int) -> None:
        """Go on, if an awaited event has happened."""
        if self.state is ExchangeState.WAITING and self._is_free(now):
            self._begin(now)
        elif self._is_late and not self._transducer.is_receiving:
            self._is_late = False
            self._give_up_attempt(now)

    def handle_sent(self, signal: Signal, now: int) -> None:
        """Take note that a signal has left."""
        if self.state is not ExchangeState.SENDING or signal is not self.signal:
            return
        if self._answer is None:
            self._end(Ending.SENT, now)
            return
        self.state = ExchangeState.AWAITING
        self._transducer.awaiting = self
        self._set_timer(now + self._chassis.answer_wait_ns, self._expire)

    def handle_answer(self, hearing: Hearing, now: int) -> bool:
        """Take an answer, if it is the one to this; return whether."""
        answer = hearing.signal
        if self.state is not ExchangeState.AWAITING or answer.kind is not self._answer:
            return False
        if (answer.number, answer.source) != (self.signal.number, self.signal.destination):
            return False
        self._chassis.measured.propagation_us = self._measured_us(hearing)
        self._end(Ending.ANSWERED, now)
        return True

    def cancel(self) -> None:
        """Stop; a signal that goes out still does."""
        self.state = ExchangeState.ENDED
        self._release()

    def _is_free(self, now: int) -> bool:
        transducer = self._transducer
        if now < transducer.ready_at:
            self._set_timer(transducer.ready_at, self.look)
            return False
        if self._force:
            return True
        return not (transducer.is_receiving or transducer.owed or transducer.awaiting)

    def _begin(self, now: int) -> None:
        self.state = ExchangeState.SENDING
        if self._attempts is not None:
            self._attempts -= 1
        self._transducer.transmit(self.signal, now)
        self._sent_at = now

    def _expire(self, now: int) -> None:
        if self.state is not ExchangeState.AWAITING:
            return
        # What comes in at this moment may be the answer.
        if self._transducer.is_receiving:
            self._is_late = True
        else:
            self._give_up_attempt(now)

    def _give_up_attempt(self, now: int) -> None:
        if self._attempts == 0:
            self._end(Ending.UNANSWERED, now)
            return
        self._release()
        self.state = ExchangeState.WAITING
        self.look(now)

    def _measured_us(self, hearing: Hearing) -> int:
        round_trip_ns = hearing.starts_at - self._sent_at - self.signal.duration_ns - TURNAROUND_NS
        return max(0, round(round_trip_ns / 2000))

    def _end(self, ending: Ending, now: int) -> None:
        self.cancel()
        self._ended(ending, now)

    def _release(self) -> None:
        self._is_late = False
        if self._transducer.awaiting is self:
            self._transducer.awaiting = None
        self._stop_timer()

    def _set_timer(self, at: int, action: Callable[[int], None]) -> None:
        self._stop_timer()
        self._timer = self._chassis.agenda.push(at, action, at)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._chassis.agenda.cancel(self._timer)
            self._timer = None
