"""The channel between emulated modems: the medium of a scenario, with signals of any length.

The medium knows one kind of frame, whose length follows from its bytes. A modem has signals of
several kinds, so their duration is given here, and the bytes only decide how vulnerable they are.
The modem's source level lowers the received level everywhere.
"""

import math
from typing import Final

import msgspec

from zacoustic.channel.arrival import Arrival, Reception
from zacoustic.channel.medium import Medium
from zacoustic.channel.scenario import Scenario
from zacoustic.core.clock import NS_PER_S
from zacoustic_evologics.emulator.airtime import equivalent_bytes
from zacoustic_evologics.emulator.observation import (
    Observer,
    SignalArrived,
    SignalEmitted,
    ignore,
)
from zacoustic_evologics.emulator.signals import Hearing, Signal

SOURCE_LEVELS_DB: Final = (0.0, -6.0, -12.0, -20.0)
"""What `AT!L0`…`AT!L3` do to the level of the profile."""

_RSSI_AT_ZERO_DB: Final = 204.0  # received level, dB re 1 µPa, that is 0 dB re 1 V
_RSSI_LIMITS_DB: Final = (-100, -10)
_INTEGRITY_AT_ZERO_DB: Final = 60.0
_INTEGRITY_PER_DB: Final = 3.0
_INTEGRITY_LIMITS: Final = (20, 255)


class Sound(msgspec.Struct, frozen=True, gc=False):
    """A signal on its way to one modem."""

    signal: Signal
    """What was sent."""
    arrival: Arrival
    """When it comes, and how."""
    is_noticed: bool
    """Whether a modem that listens notices it."""


class EmulatedMedium(Medium):
    """The shared channel of one scenario.

    Args:
        scenario: Who is where, with which modem, and what goes wrong.
        observer: Gets every transmission with its outcome.
    """

    def __init__(self, scenario: Scenario, observer: Observer = ignore) -> None:
        super().__init__(scenario)
        self._observe = observer

    def reach_s(self, now: int) -> float:
        """Return the longest propagation delay between two nodes at an instant, s."""
        positions = [self.position(address, now) for address in self.addresses]
        farthest_m = max(math.dist(a, b) for a in positions for b in positions)
        return farthest_m / self.scenario.sound_speed_m_s

    def emit(self, node: int, signal: Signal, now: int) -> tuple[Sound, ...]:
        """Let a node transmit a signal; give each sound to `hear` when it has ended.

        Args:
            node: The sender's place in the scenario, which need not be its network address.
            signal: What it sends.
            now: Instant of the first sound, ns, not before that of any earlier call.
        """
        site = self._site(node)
        sequence = site.sequence
        site.sequence += 1
        frame_bytes = equivalent_bytes(signal.duration_ns)
        ends_at = now + signal.duration_ns
        site.transmits_until = ends_at
        site.receiver.transmits(now, ends_at)
        self._observe(SignalEmitted(at=now, node=node, sequence=sequence, signal=signal))
        level_db = SOURCE_LEVELS_DB[signal.level]
        sounds = []
        for hop in self._hops_of(site):
            arrival = hop.arrival(sequence, frame_bytes, now, signal.duration_ns)
            if level_db:
                arrival = _lowered(arrival, level_db)
            receiver = self._sites[hop.node].receiver
            is_decodable = receiver.profile is site.profile
            receiver.expect(arrival, now, is_decodable=is_decodable)
            if is_decodable:
                is_noticed = arrival.snr_db >= receiver.profile.detection_snr_db
                sounds.append(Sound(signal, arrival, is_noticed))
        return tuple(sounds)

    def hear(self, sound: Sound) -> Hearing:
        """Return the outcome of a sound at its modem; call it once, when the sound ends."""
        arrival = sound.arrival
        reception = self.finish(arrival)
        self._observe(
            SignalArrived(
                at=arrival.ends_at,
                node=arrival.node,
                source=arrival.source,
                sequence=arrival.sequence,
                signal=sound.signal,
                outcome=reception.outcome,
                snr_db=arrival.snr_db,
                propagation_s=arrival.propagation_s,
            )
        )
        return Hearing(
            sound=sound_id(arrival),
            signal=sound.signal,
            is_received=reception.is_received,
            starts_at=arrival.starts_at,
            duration_ns=arrival.ends_at - arrival.starts_at,
            rssi_db=_limited(arrival.received_level_db - _RSSI_AT_ZERO_DB, _RSSI_LIMITS_DB),
            integrity=_integrity(reception),
            snr_db=arrival.snr_db,
            velocity_m_s=arrival.range_rate_m_s,
            propagation_us=round(arrival.propagation_s * 1e6),
            offset_m=self._offset_m(arrival),
            sound_speed_m_s=self.scenario.sound_speed_m_s,
            corrupt_seed=reception.corrupt_seed,
            duplicates_after_s=reception.duplicates_after_s,
        )

    def _offset_m(self, arrival: Arrival) -> tuple[float, float, float]:
        left_at = arrival.starts_at - round(arrival.propagation_s * NS_PER_S)
        here = self.position(arrival.node, arrival.starts_at)
        there = self.position(arrival.source, max(0, left_at))
        return there[0] - here[0], there[1] - here[1], here[2] - there[2]


def sound_id(arrival: Arrival) -> int:
    """Return a number for a sound, unique at its modem."""
    return arrival.sequence << 8 | arrival.source


def _lowered(arrival: Arrival, level_db: float) -> Arrival:
    return msgspec.structs.replace(
        arrival,
        received_level_db=arrival.received_level_db + level_db,
        snr_db=arrival.snr_db + level_db,
        effective_snr_db=arrival.effective_snr_db + level_db,
    )


def _integrity(reception: Reception) -> int:
    return _limited(
        _INTEGRITY_AT_ZERO_DB + _INTEGRITY_PER_DB * reception.sinr_db, _INTEGRITY_LIMITS
    )


def _limited(value: float, limits: tuple[int, int]) -> int:
    low, high = limits
    return round(min(max(value, low), high))
