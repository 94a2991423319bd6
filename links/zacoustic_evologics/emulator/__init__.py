"""Emulated S2C modems: they answer a host's commands and transmit on one simulated channel.

From the bottom up:

- `airtime`, `signals`, `store`, `firmware`: durations, signals, settings, and the
  differences between the versions of a real one.
- `modem`, made of `chassis`, `transducer`, `exchange`, `instant`, `bursts`, `usblhead`,
  `levelcontrol`, `listening` and `queries`: one modem, sans-IO.
- `port`, `faults`, `station`: its ports and their faults.
- `medium`, `fleet`: many modems in virtual time (`EmulatedFleet`), for tests without a loop;
  `observation`: the events for an observer of all of them.
- `running`, `server`, `command`: the same on a loop, behind TCP ports and pseudo-terminals.
"""

from zacoustic_evologics.emulator.chassis import Behaviour
from zacoustic_evologics.emulator.faults import FaultKind, FaultPlan, ScriptedFault
from zacoustic_evologics.emulator.fleet import EmulatedFleet, scenario_of
from zacoustic_evologics.emulator.observation import Observation, SignalArrived, SignalEmitted
from zacoustic_evologics.emulator.station import (
    FleetOutput,
    ModemDown,
    ModemUp,
    PortBytes,
    PortClosed,
)

__all__ = [
    "Behaviour",
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
    "scenario_of",
]
