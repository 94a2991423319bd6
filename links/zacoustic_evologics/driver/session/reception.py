"""From a modem's received sounds to frames, readings and the carrier.

Three choices:

- *Velocity.* No source defines the sign of the modem's relative velocity. The driver passes it on
  unchanged, as positive when the distance grows; the emulator does the same. A test with two modems
  and a boat can settle it.
- *Repetitions.* A message repeated by a modem looks like one that a host has sent again, so most
  cannot be detected. Three are certain: the same bytes from the same sender sooner than they can
  have been on the air again; the same bytes without any sound since, if a sound preceded the first
  ones; and a synchronous message with the same instant of start.
- *Carrier.* Besides others' sounds it includes the modem's own (acknowledgements), since the
  channel is not free then either. A cable may lose the end of a sound, so a carrier counts as ended
  after `CARRIER_LIMIT_S`.
"""

from typing import Final

from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.linktypes import BROADCAST, LinkMetrics, ReceivedFrame, Service
from zacoustic_evologics.at import notifications as said
from zacoustic_evologics.at.usbl import UsblAngles, UsblLong
from zacoustic_evologics.driver.events import CarrierChanged, Event, FrameHeard, Measured
from zacoustic_evologics.driver.session.measuring import (
    measured_direction,
    measured_position,
    modem_read,
)
from zacoustic_evologics.driver.session.session import ModemSession

CARRIER_LIMIT_S: Final = 3.0
"""Longer than any instant message with its delay, s; a burst reports each new beginning."""
LEAST_REPEAT_S: Final = 0.1
"""No message follows an equal one sooner, whatever its reported duration: preambles are longer."""

Received = said.RecvIm | said.RecvIms | said.RecvPbm | said.Recv


class Reception:
    """Handles received messages.

    Args:
        session: Takes readings and counts.
    """

    def __init__(self, session: ModemSession) -> None:
        self.is_busy = False
        """A sound of another node is audible."""
        self.due_at: int | None = None
        """When to call `handle_timeout`, ns."""
        self._session = session
        self._last: dict[int, tuple[Received, int, int]] = {}
        # Number of reported sounds, and of those before the last message.
        self._sounds = self._sounds_before = 0

    def handle(self, record: said.Notification, *, is_sending: bool, now: int) -> list[Event]:
        """Take a notification.

        Args:
            record: A message of the modem.
            is_sending: The modem is sending a frame of ours.
            now: The instant, ns.
        """
        session = self._session
        if isinstance(record, said.RecvStart | said.RecvEnd | said.RecvFailed):
            self._sounds += 1
        if isinstance(record, said.SendStart) and session.answer_owed is not None:
            session.note_answering(record.destination)
        match record:
            case said.RecvIm() | said.RecvIms() | said.RecvPbm() | said.Recv():
                return self._receive(record, now)
            case said.RecvStart():
                return self._sense(True, now)
            case said.SendStart() if not is_sending:
                return self._sense(True, now)
            case said.RecvEnd():
                self._note_signal(record.rssi_db, record.integrity)
                return self._sense(False, now)
            case said.RecvFailed():
                session.count("receptions_failed")
                self._note_signal(record.rssi_db, record.integrity)
                return self._sense(False, now)
            case said.SendEnd() if not is_sending:
                return self._sense(False, now)
            case UsblLong():
                session.note_position(record)
                return [Measured(measured_position(session, record, now))]
            case UsblAngles():
                session.note_angles(record)
                found = measured_direction(record, now)
                return [Measured(found)] if found is not None else []
            case said.SourceLevel():
                session.source_level = record.level
                return [Measured(modem_read(session, now))]
            case said.DropCount():
                session.count("raw_bytes_dropped", record.dropped_bytes)
            case said.AsyncError():
                overload = record.fault is said.FaultKind.OVERLOAD
                session.count("overloads" if overload else "faults")
            case _:
                pass
        return []

    def handle_timeout(self, now: int) -> list[Event]:
        """Handle a sound whose end was not reported in time."""
        if self.due_at is None or now < self.due_at:
            return []
        return self._sense(False, now)

    def stop(self, now: int) -> list[Event]:
        """Note that the modem is gone: nothing is audible any more."""
        self._last.clear()
        return self._sense(False, now)

    def _sense(self, busy: bool, now: int) -> list[Event]:
        self.due_at = now + seconds_to_ns(CARRIER_LIMIT_S) if busy else None
        if busy == self.is_busy:
            return []
        self.is_busy = busy
        return [CarrierChanged(busy)] if self._session.has_extended_notifications else []

    def _receive(self, record: Received, now: int) -> list[Event]:
        session = self._session
        events = self._sense(False, now)
        self._note_signal(record.rssi_db, record.integrity)
        session.readings["range_rate_m_s"] = record.velocity_m_s
        if record.destination not in (session.address, BROADCAST):
            session.count("for_others")
            return events
        is_asking = isinstance(record, said.RecvIm) and record.flag is said.ImFlag.ACK
        if is_asking or isinstance(record, said.Recv):
            session.note_owed(record.source, now)
        if isinstance(record, said.Recv):
            session.note_burst(record.source, now)
        if self._is_repetition(record, now):
            session.count("repetitions")
        elif record.payload:
            session.count("received")
            events.append(FrameHeard(self._frame(record, now)))
        return events

    def _is_repetition(self, record: Received, now: int) -> bool:
        last, last_at, last_sounds = self._last.get(record.source, (None, 0, -1))
        # If a firmware does not report a sound before each message, silence proves nothing.
        is_told = self._sounds > self._sounds_before
        self._sounds_before = self._sounds
        if last is None or type(last) is not type(record) or last.payload != record.payload:
            self._last[record.source] = record, now, self._sounds if is_told else -1
            return False
        self._last[record.source] = record, now, self._sounds if is_told else last_sounds
        if isinstance(record, said.RecvIms) and isinstance(last, said.RecvIms):
            return record.timestamp_us == last.timestamp_us
        duration_us = getattr(record, "duration_us", None) or 0
        least_ns = max(duration_us * 1000, seconds_to_ns(LEAST_REPEAT_S))
        is_too_soon = now - last_at < least_ns or self._sounds == last_sounds
        return last.destination == record.destination and is_too_soon

    def _frame(self, record: Received, now: int) -> ReceivedFrame:
        session = self._session
        delay_us = getattr(record, "propagation_us", None)
        is_bulk = isinstance(record, said.Recv) and session.has_bulk
        propagation_s = delay_us / 1e6 if delay_us and delay_us > 0 else None
        if delay_us:
            session.note_delay(record.source, delay_us)
        return ReceivedFrame(
            frame_bytes=record.payload,
            received_at=now,
            source=record.source,
            destination=record.destination,
            service=Service.BULK if is_bulk else Service.PLAIN,
            metrics=LinkMetrics(
                received_level_db=float(record.rssi_db),
                integrity=float(record.integrity),
                propagation_s=propagation_s,
                range_m=session.range_m(propagation_s),
                range_rate_m_s=record.velocity_m_s,
            ),
        )

    def _note_signal(self, rssi_db: int, integrity: int) -> None:
        self._session.readings["received_level_db_re_1v"] = rssi_db
        self._session.readings["integrity"] = integrity
