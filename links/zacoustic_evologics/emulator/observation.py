"""Events on the channel between emulated modems, for an observer of all of them.

No modem knows them: the outcome of a signal is known where it arrives, and a modem learns nothing
of lost ones. The observer is called as they happen; it must not call the fleet.
"""

from collections.abc import Callable
from typing import TypeAlias

import msgspec

from zacoustic.channel.arrival import Outcome
from zacoustic_evologics.emulator.hardware.signals import Signal


class SignalEmitted(msgspec.Struct, frozen=True, kw_only=True):
    """A modem begins a signal."""

    at: int
    """Instant of the first sound, ns."""
    node: int
    """Address of the modem in the scenario."""
    sequence: int
    """Number of the signal at that modem, from 0."""
    signal: Signal
    """The signal."""


class SignalArrived(msgspec.Struct, frozen=True, kw_only=True):
    """A signal has ended at another modem."""

    at: int
    """Instant of the last sound there, ns."""
    node: int
    """Address of that modem in the scenario."""
    source: int
    """Address of the sender in the scenario."""
    sequence: int
    """Number of the emission."""
    signal: Signal
    """The signal."""
    outcome: Outcome
    """Its outcome on the channel."""
    snr_db: float
    """Level over noise, dB."""
    propagation_s: float
    """Propagation delay, one way, s."""


Observation: TypeAlias = SignalEmitted | SignalArrived
"""All observations."""
Observer: TypeAlias = Callable[[Observation], None]
"""Takes observations."""


def ignore(observation: Observation) -> None:
    """Discard an observation."""
