"""A modem's messages about the end of one frame, and how reliable they are.

Messages about instant messages name a destination but no frame, and one about an earlier frame may
come late. So a message is *certain* or a *rumour*, and after a rumour the driver asks the modem:

- A message sooner than half the frame's airtime after it was given does not count.
- `SENDEND` has the beginning of the sound by the modem's clock: it is certain if that is not before
  the frame was given; otherwise it is about another frame.
- `DELIVEREDIM` is certain after the `SENDEND` of the frame and the `RECVEND` of a later sound,
  which then was the acknowledgement. Without extended notifications it is a rumour.
- `FAILEDIM`, `CANCELED…` and `EXPIRED…` are rumours: no other message precedes them.
- Messages about bursts carry a number, and are certain.
- A piggyback message goes with anything that the modem sends to its receiver, so the `SENDEND` of
  that is a rumour. `CANCELEDPBM` is certain: the message has not left. But if a sound to the
  receiver has begun since, it may be about an earlier message.
"""

from zacoustic.core.linktypes import TransmitOutcome
from zacoustic_evologics.at import notifications as said
from zacoustic_evologics.at.encoder import encode_message
from zacoustic_evologics.driver.sending.service import Carriage, Service
from zacoustic_evologics.driver.sending.states import Word
from zacoustic_evologics.driver.session.session import ModemSession


class Evidence:
    """The messages about one frame.

    Args:
        carriage: How the frame is carried.
        session: State of the modem.
        airtime_ns: Airtime of the frame, ns.
    """

    def __init__(self, carriage: Carriage, session: ModemSession, airtime_ns: int) -> None:
        self.outcome: TransmitOutcome | None = None
        """The outcome; None while unknown."""
        self.is_certain = False
        """The outcome needs no query."""
        self.words = ""
        """The modem's own words."""
        self.given_at = self.started_at = 0
        """When the frame was given to the modem, and when its sound began, ns."""
        self.ends_at: int | None = None
        """When its sound ends, ns, if the modem has reported it."""
        self.answer: said.RecvEnd | None = None
        """The last sound received after it: for a message, its acknowledgement."""
        self._carriage = carriage
        self._session = session
        self._airtime_ns = airtime_ns
        self.is_accepted = False
        """The modem has accepted the frame."""
        self._has_left = self._has_heard = self._has_begun = False

    def begin(self, now: int) -> None:
        """Note that the frame is given: no earlier message is about it."""
        self.given_at = self.started_at = now
        self.ends_at = None
        self.answer = None
        self.is_accepted = False
        self._has_left = self._has_heard = self._has_begun = False
        self.forget()

    def forget(self) -> None:
        """Discard the messages: they were not about this frame."""
        self.outcome, self.is_certain, self.words = None, False, ""

    def handle(self, record: said.Notification, counter: int | None, now: int) -> Word | None:
        """Take a notification.

        Args:
            record: A message of the modem.
            counter: Number of a burst.
            now: The instant, ns.

        Returns:
            PROVEN or RUMOUR if it is about the end of the frame.
        """
        if isinstance(record, said.SendStart) and self._carriage.begins(record):
            self.started_at = now + record.delay_us * 1000
            self.ends_at = self.started_at + record.duration_us * 1000
            self._has_begun = self.is_accepted
        if isinstance(record, said.SendEnd) and not self._take_end(record, now):
            return None
        if isinstance(record, said.RecvEnd) and self._has_left:
            self._has_heard = True
            self.answer = record
        outcome = self._carriage.verdict(record, counter)
        if outcome is None or self.is_certain or self.is_too_soon(now):
            return None
        if isinstance(record, said.CanceledPbm) and not self.is_accepted:
            return None
        if isinstance(record, said.CanceledPbm) and self._has_begun:
            outcome = TransmitOutcome.ABORTED
        self.outcome = outcome
        self.is_certain = self._is_certain(record)
        self.words = encode_message(record).decode("ascii", "replace").strip()
        return Word.PROVEN if self.is_certain else Word.RUMOUR

    def is_too_soon(self, now: int) -> bool:
        """Tell whether the frame cannot have left yet."""
        # An acknowledgement that ends too soon for the piggyback message: the message missed it.
        is_message = self._carriage.service in (Service.IM, Service.IMS)
        return is_message and 2 * (now - self.given_at) < self._airtime_ns

    def _take_end(self, record: said.SendEnd, now: int) -> bool:
        """Take the end of a sound; return whether it can be that of the frame."""
        session, carriage = self._session, self._carriage
        is_like_it = carriage.is_sound(record.kind, record.destination)
        if not is_like_it or session.was_before(record.clock_us, self.given_at, now):
            return False
        if not self.is_too_soon(now):
            self._has_left = True
            self.started_at = max(self.given_at, now - record.duration_us * 1000)
        return True

    def _is_certain(self, record: said.Notification) -> bool:
        if self._carriage.service is Service.PIGGYBACK:
            return isinstance(record, said.CanceledPbm)
        if self._carriage.service is Service.BURST or isinstance(record, said.SendEnd):
            return True
        return isinstance(record, said.DeliveredIm) and self._has_heard
