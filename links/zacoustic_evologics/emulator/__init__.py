"""Emulated S2C modems: they answer a host's commands and transmit on one simulated channel.

From the bottom up:

- `hardware`: signals and their durations, settings, the differences between a real modem's versions
  (`firmware`); `chassis` and `transducer` are shared by all parts of a modem.
- `exchanges`: deliveries over several signals: `instant`, `bursts` out of a `pool`, `usblhead`.
- `observation`, `medium`: the channel, and the events for an observer of all modems.
- `modem`: one modem, sans-IO: `queries`, `actions`, `listening`, `levelcontrol`.
- `station`: a modem with its ports, and their `faults`.
- `fleet`: many modems in virtual time (`EmulatedFleet`), for tests without a loop.
- `serving`, `command`: the same on a loop, behind TCP ports and pseudo-terminals.
"""

from zacoustic_evologics.emulator.fleet import EmulatedFleet, scenario_of
from zacoustic_evologics.emulator.guesses import BurstGuess, burst_guess
from zacoustic_evologics.emulator.hardware.chassis import Behaviour
from zacoustic_evologics.emulator.observation import Observation, SignalArrived, SignalEmitted
from zacoustic_evologics.emulator.station.faults import FaultKind, FaultPlan, ScriptedFault
from zacoustic_evologics.emulator.station.station import (
    FleetOutput,
    ModemDown,
    ModemUp,
    PortBytes,
    PortClosed,
)

__all__ = [
    "Behaviour",
    "BurstGuess",
    "EmulatedFleet",
    "FaultKind",
    "FaultPlan",
    "FleetOutput",
    "ModemDown",
    "ModemUp",
    "Observation",
    "PortBytes",
    "PortClosed",
    "ScriptedFault",
    "SignalArrived",
    "SignalEmitted",
    "burst_guess",
    "scenario_of",
]
