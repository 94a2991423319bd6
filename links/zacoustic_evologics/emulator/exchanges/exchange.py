"""Sends a signal when possible, repeats it until it is answered, and finally gives up.

::

    WAITING ──free──► SENDING ──sent──► AWAITING ──answer──► ended: ANSWERED
       ▲                  │                 │
       │                  │ no answer asked └──time over──► ended: UNANSWERED
       │                  └──► ended: SENT      │
       └──────────── attempts left ─────────────┘

Sending is possible if the modem does not transmit, is not in the pause after its last signal, owes
no answer, awaits none of another exchange, and receives nothing. With `force` only the first two
conditions count.

The owner of an exchange calls `look` whenever something may have changed, and gets the outcome
once. A cancelled exchange has none.
"""

import enum
from collections.abc import Callable

from zacoustic.channel.agenda import Entry
from zacoustic_evologics.airtime import TURNAROUND_NS
from zacoustic_evologics.emulator.hardware.chassis import Chassis
from zacoustic_evologics.emulator.hardware.signals import Hearing, Signal, SignalKind
from zacoustic_evologics.emulator.hardware.transducer import Transducer


class ExchangeState(enum.Enum):
    """The state of an exchange."""

    WAITING = "waiting"
    """It waits until it can be sent."""
    SENDING = "sending"
    """Its signal is being transmitted."""
    AWAITING = "awaiting"
    """It was sent and not answered yet."""
    ENDED = "ended"
    """It is over."""


class Ending(enum.Enum):
    """The outcome of an exchange."""

    SENT = "sent"
    """It was sent, and asks for no answer."""
    ANSWERED = "answered"
    """The other modem has it."""
    UNANSWERED = "unanswered"
    """No attempt was answered."""


class Exchange:
    """One signal with its repetitions.

    Args:
        chassis: Chassis of the modem.
        transducer: Transducer of the modem.
        signal: The signal to send.
        answer: The kind of its answer; None: it has none.
        attempts: Most transmissions; None: no limit.
        force: Send it even during a reception.
        ended: Takes the outcome and the instant.
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
        """Advance if an awaited event has happened."""
        if self.state is ExchangeState.WAITING and self._is_free(now):
            self._begin(now)
        elif self._is_late and not self._transducer.is_receiving:
            self._is_late = False
            self._give_up_attempt(now)

    def handle_sent(self, signal: Signal, now: int) -> None:
        """Note that a signal has left."""
        if self.state is not ExchangeState.SENDING or signal is not self.signal:
            return
        if self._answer is None:
            self._end(Ending.SENT, now)
            return
        self.state = ExchangeState.AWAITING
        self._transducer.awaiting = self
        self._set_timer(now + self._chassis.answer_wait_ns, self._expire)

    def handle_answer(self, hearing: Hearing, now: int) -> bool:
        """Take an answer; return whether it belongs to this exchange."""
        answer = hearing.signal
        if self.state is not ExchangeState.AWAITING or answer.kind is not self._answer:
            return False
        if (answer.number, answer.source) != (self.signal.number, self.signal.destination):
            return False
        self._chassis.measured.propagation_us = self._measured_us(hearing)
        self._end(Ending.ANSWERED, now)
        return True

    def cancel(self) -> None:
        """Stop; a signal being transmitted goes on."""
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
        # A signal received at this moment may be the answer.
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
