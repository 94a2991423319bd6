"""The times of a frame: how long it takes, and when to ask for its outcome."""

from typing import Final

from zacoustic.core.clock import seconds_to_ns
from zacoustic_evologics.airtime import TURNAROUND_NS
from zacoustic_evologics.driver.sending.service import Carriage, Service
from zacoustic_evologics.driver.session.session import ModemSession

BUSY_PAUSE_S: Final = (0.5, 1.5)
"""Random pause between two queries whether the modem has time, s; the vendor's middleware waits
1 s. Nodes that all heard the same sound would otherwise keep sending at the same instants."""
BURSTS_BUSY_S: Final = 50.0
"""How much longer than `busy_s` a message may wait while the modem has burst data, s: it may have
to send all of them first, up to 16 KiB."""
LEAVING_MARGIN_S: Final = 0.02
"""Error of the straight line through the published airtimes, s: 14 ms at most, and some margin."""
LEAVING_POLL_S: Final = 0.05
"""Pause between two queries whether a message has left, s, if the modem does not report it."""
FLYING_POLL_S: Final = 0.5
"""Pause between two queries for the outcome of a message that should be over, s."""
BURST_POLL_S: Final = 5.0
"""The same for a burst, s: its end is always reported, so this finds only a restarted modem."""
MARGIN_S: Final = 0.6
"""Margin for the modem's time between receiving and answering (0.25 s), and for the cable, s."""
TRAIN_S: Final = 8.0
"""How long a piggyback message waits for the acknowledgement of the next train of bursts, s."""
IM_LIMIT_S: Final = 15.0
"""Longest time for each attempt of an instant message, s: 8 km and back are 11 s."""
BURST_LIMIT_S: Final = 60.0
"""Longest time for a burst, s: several attempts to connect at up to 12 s, and 1024 bytes."""


class Timetable:
    """The times of one frame, all in ns.

    Args:
        carriage: How the frame is carried.
        session: State of the modem.
        called_at: Instant of the call of `transmit`, ns.
    """

    def __init__(self, carriage: Carriage, session: ModemSession, called_at: int) -> None:
        config = session.config
        self.airtime_ns = session.capabilities().airtime_ns(len(carriage.payload))
        self.busy_until = called_at + seconds_to_ns(config.busy_s)
        """How long it may wait until the modem has time, or for an opportunity."""
        self._waits_s = config.busy_s
        self._carriage = carriage
        self._is_told = carriage.acknowledged or session.has_extended_notifications
        self._attempts = 1 + config.retries
        self._round_trip_ns = seconds_to_ns(2 * config.propagation_s)

    @property
    def limit_ns(self) -> int:
        """Time after which a given frame is dropped."""
        if self._carriage.service is Service.BURST:
            return seconds_to_ns(BURST_LIMIT_S)
        if self._carriage.service is Service.PIGGYBACK:
            return seconds_to_ns(self._waits_s + IM_LIMIT_S)
        return self._attempts * seconds_to_ns(IM_LIMIT_S)

    @property
    def poll_ns(self) -> int:
        """Pause between two queries."""
        if self._carriage.service is Service.BURST:
            return seconds_to_ns(BURST_POLL_S)
        return seconds_to_ns(FLYING_POLL_S if self._is_told else LEAVING_POLL_S)

    def first_poll_at(self, given_at: int, ends_at: int | None) -> int:
        """Return when the first query is due.

        Args:
            given_at: When the frame was given to the modem.
            ends_at: When its sound ends, if the modem has reported it.
        """
        margin_ns = seconds_to_ns(MARGIN_S)
        if self._carriage.service is Service.BURST:
            return given_at + seconds_to_ns(BURST_POLL_S)
        if self._carriage.service is Service.PIGGYBACK and ends_at is None:
            if self._carriage.rides_back:
                return given_at + seconds_to_ns(TRAIN_S)
            is_owed = self._carriage.alternative is not None
            owed_ns = TURNAROUND_NS + self.airtime_ns + margin_ns
            return given_at + owed_ns if is_owed else self.busy_until
        if self._carriage.acknowledged:
            exchange_ns = self.airtime_ns + self._round_trip_ns + margin_ns
            return given_at + self._attempts * exchange_ns
        if not self._is_told:
            return given_at + self.airtime_ns + seconds_to_ns(LEAVING_MARGIN_S)
        # The airtimes of different firmwares differ by a tenth.
        return (ends_at or given_at + 5 * self.airtime_ns // 4) + margin_ns
