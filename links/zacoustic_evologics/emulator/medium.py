"""The channel between emulated modems: the medium of a scenario, with signals of any length.

A modem has signals of several kinds, so their duration is an argument, and the bytes only decide
how vulnerable they are. The modem's source level lowers the received level everywhere.
"""

from collections.abc import Callable
from typing import Final

from zacoustic.channel.agenda import Agenda
from zacoustic.channel.arrival import Arrival, Reception
from zacoustic.channel.driver import Driver
from zacoustic.channel.medium import Medium
from zacoustic.channel.scenario import Scenario
from zacoustic.core.clock import NS_PER_S
from zacoustic_evologics.airtime import equivalent_bytes
from zacoustic_evologics.at.settings import SOURCE_LEVELS_DB
from zacoustic_evologics.emulator.hardware.signals import Hearing, Signal
from zacoustic_evologics.emulator.observation import (
    Observer,
    SignalArrived,
    SignalEmitted,
    ignore,
)

_RSSI_AT_ZERO_DB: Final = 204.0  # received level, dB re 1 µPa, that is 0 dB re 1 V
_RSSI_LIMITS_DB: Final = (-100, -10)
_INTEGRITY_AT_ZERO_DB: Final = 60.0
_INTEGRITY_PER_DB: Final = 3.0
_INTEGRITY_LIMITS: Final = (20, 255)


class EmulatedMedium(Driver[Signal]):
    """The shared channel of one scenario.

    Args:
        scenario: Positions, modems and faults of the nodes.
        agenda: Pending actions.
        begun: Takes the node and the number of a sound that it notices.
        heard: Takes the node and its hearing when a sound has ended.
        observer: Gets every transmission with its outcome.
    """

    def __init__(
        self,
        scenario: Scenario,
        agenda: Agenda,
        *,
        begun: Callable[[int, int], None],
        heard: Callable[[int, Hearing], None],
        observer: Observer = ignore,
    ) -> None:
        self.medium = Medium(scenario)
        super().__init__(self.medium, agenda)
        self._begun = begun
        self._heard = heard
        self._observe = observer

    def emit(self, node: int, signal: Signal) -> None:
        """Begin a node's signal now.

        Args:
            node: The sender's address in the scenario, which may differ from its network address.
            signal: The signal.
        """
        emission = self.medium.transmit(
            node,
            equivalent_bytes(signal.duration_ns),
            self.agenda.now,
            airtime_ns=signal.duration_ns,
            level_db=SOURCE_LEVELS_DB[signal.level],
        )
        self._observe(
            SignalEmitted(
                at=emission.started_at, node=node, sequence=emission.sequence, signal=signal
            )
        )
        self.spread(emission, signal)

    def notices(self, arrival: Arrival) -> bool:
        """Tell whether a listening modem notices a sound."""
        return self.medium.profile(arrival.node).notices(arrival.snr_db)

    def begin(self, arrival: Arrival, sent: Signal) -> None:
        """Report the beginning of a sound to a modem."""
        self._begun(arrival.node, _sound_id(arrival))

    def end(self, reception: Reception, sent: Signal, is_noticed: bool) -> None:
        """Report a reception to a modem."""
        arrival = reception.arrival
        self._observe(
            SignalArrived(
                at=arrival.ends_at,
                node=arrival.node,
                source=arrival.source,
                sequence=arrival.sequence,
                signal=sent,
                outcome=reception.outcome,
                snr_db=arrival.snr_db,
                propagation_s=arrival.propagation_s,
            )
        )
        hearing = Hearing(
            sound=_sound_id(arrival),
            signal=sent,
            reception=reception,
            rssi_db=_limited(arrival.received_level_db - _RSSI_AT_ZERO_DB, _RSSI_LIMITS_DB),
            integrity=_integrity(reception),
            offset_m=self._offset_m(arrival),
            sound_speed_m_s=self.medium.scenario.sound_speed_m_s,
        )
        self._heard(arrival.node, hearing)

    def _offset_m(self, arrival: Arrival) -> tuple[float, float, float]:
        left_at = arrival.starts_at - round(arrival.propagation_s * NS_PER_S)
        here = self.medium.position(arrival.node, arrival.starts_at)
        there = self.medium.position(arrival.source, max(0, left_at))
        return there[0] - here[0], there[1] - here[1], here[2] - there[2]


def _sound_id(arrival: Arrival) -> int:
    """Return a number for a sound, unique at its modem."""
    return arrival.sequence << 8 | arrival.source


def _integrity(reception: Reception) -> int:
    return _limited(
        _INTEGRITY_AT_ZERO_DB + _INTEGRITY_PER_DB * reception.sinr_db, _INTEGRITY_LIMITS
    )


def _limited(value: float, limits: tuple[int, int]) -> int:
    low, high = limits
    return round(min(max(value, low), high))
