"""The acoustic end of a modem: one outgoing signal at a time, and the received ones.

Half-duplex: a transmitting modem receives nothing, and loses an incoming signal when it begins. The
medium decides such losses; this module only knows whether a sound is present.
"""

import enum
from collections.abc import Callable

from zacoustic_evologics.airtime import GAP_NS
from zacoustic_evologics.at.notifications import RecvEnd, RecvFailed, RecvStart, SendEnd, SendStart
from zacoustic_evologics.emulator.hardware.chassis import Chassis
from zacoustic_evologics.emulator.hardware.signals import Hearing, Signal


class PhyState(enum.Enum):
    """States of the physical layer; the value is `AT?S`'s word."""

    LISTEN = "INITIATION LISTEN"
    """Full operation."""
    NOISE = "INITIATION NOISE"
    """Measures noise, receives nothing."""
    DEAF = "INITIATION DEAF"
    """Receives nothing."""
    OFF = "PHY"
    """Handed over to another protocol."""


class Transducer:
    """Transmits and listens.

    Args:
        chassis: Chassis of the modem.
        sent: Called when a signal has left.
    """

    def __init__(self, chassis: Chassis, sent: Callable[[Signal, int], None]) -> None:
        self.state = PhyState.LISTEN
        self.transmits_until = 0
        self.ready_at = 0
        # Set by the burst service: until then it accepts only forced signals.
        self.backoff_until = 0
        # Answers of this modem that are due soon; and the exchange that awaits one of another.
        self.owed = 0
        self.awaiting: object = None
        self._chassis = chassis
        self._sent = sent
        self._sounds: set[int] = set()
        self._following: int | None = None

    @property
    def is_on(self) -> bool:
        """Whether it can transmit at all."""
        return self.state is not PhyState.OFF

    @property
    def is_receiving(self) -> bool:
        """Whether a signal is being received."""
        return bool(self._sounds) and self.state is PhyState.LISTEN

    def is_transmitting(self, now: int) -> bool:
        """Whether a signal is being transmitted."""
        return now < self.transmits_until

    def announce(self, signal: Signal, now: int, starts_at: int) -> None:
        """Announce the beginning of a signal."""
        delay_us = (starts_at - now) // 1000
        self._chassis.say(
            SendStart(
                destination=signal.destination,
                kind=signal.kind.value,
                duration_us=signal.duration_ns // 1000,
                delay_us=delay_us,
            )
        )

    def transmit(self, signal: Signal, now: int, *, is_announced: bool = False) -> None:
        """Begin a signal; only while none is transmitted."""
        assert not self.is_transmitting(now)
        if not is_announced:
            self.announce(signal, now, now)
        self.transmits_until = now + signal.duration_ns
        self.ready_at = self.transmits_until + GAP_NS
        self._following = None
        self._chassis.signals.append(signal)
        self._chassis.agenda.push(self.transmits_until, self._end, signal, self.transmits_until)

    def hear_begin(self, sound: int, now: int) -> None:
        """Note the beginning of a sound."""
        self._sounds.add(sound)
        hears = self.state is PhyState.LISTEN and not self.is_transmitting(now)
        if hears and self._following is None:
            self._following = sound
            self._chassis.say(RecvStart())

    def hear_end(self, hearing: Hearing) -> bool:
        """Note the end of a sound; return whether it was received."""
        was_there = hearing.sound in self._sounds
        self._sounds.discard(hearing.sound)
        was_followed = self._following == hearing.sound
        if was_followed:
            self._following = None
        if self.state is not PhyState.LISTEN:
            return False
        measured = self._chassis.measured
        if hearing.is_received and was_there:
            measured.rssi_db = hearing.rssi_db
            measured.integrity = hearing.integrity
            measured.velocity_m_s = hearing.velocity_m_s
            clock_us = self._chassis.clock_us(hearing.starts_at)
            duration_us = hearing.duration_ns // 1000
            self._chassis.say(hearing.told(RecvEnd, clock_us=clock_us, duration_us=duration_us))
            return True
        if was_followed:
            self._chassis.say(hearing.told(RecvFailed))
        return False

    def restart(self) -> None:
        """Discard receptions; an outgoing signal goes on."""
        self.state = PhyState.LISTEN
        self.owed = 0
        self.backoff_until = 0
        self.awaiting = None
        self._sounds.clear()
        self._following = None

    def _end(self, signal: Signal, at: int) -> None:
        self._chassis.say(
            SendEnd(
                destination=signal.destination,
                kind=signal.kind.value,
                clock_us=self._chassis.clock_us(at - signal.duration_ns),
                duration_us=signal.duration_ns // 1000,
            )
        )
        self._sent(signal, at)
