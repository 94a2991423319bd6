"""What happens on the channel between emulated modems, for an observer of all of them.

No modem knows this: the outcome of a signal is known where it arrives, and a modem learns nothing
of lost ones. An observer is called as it happens; it must not call the fleet.
"""

from collections.abc import Callable
from typing import TypeAlias

import msgspec

from zacoustic.channel.arrival import Outcome
from zacoustic_evologics.emulator.hardware.signals import Signal


class SignalEmitted(msgspec.Struct, frozen=True, kw_only=True):
    """A modem begins to send a signal."""

    at: int
    """Instant of the first sound, ns."""
    node: int
    """Address of the modem in the scenario."""
    sequence: int
    """Counts the signals of that modem, from 0."""
    signal: Signal
    """What it sends."""


class SignalArrived(msgspec.Struct, frozen=True, kw_only=True):
    """A signal has ended at another modem."""

    at: int
    """Instant of the last sound there, ns."""
    node: int
    """Address of that modem in the scenario."""
    source: int
    """Address of the sender in the scenario."""
    sequence: int
    """That of the emission."""
    signal: Signal
    """What was sent."""
    outcome: Outcome
    """Its outcome on the channel."""
    snr_db: float
    """Level over noise, dB."""
    propagation_s: float
    """How long the sound was on its way, s."""


Observation: TypeAlias = SignalEmitted | SignalArrived
"""All observations."""
Observer: TypeAlias = Callable[[Observation], None]
"""Takes each of them."""


def ignore(observation: Observation) -> None:
    """Watch nothing."""
