"""Emulated S2C modems: they answer a host's commands and transmit on one simulated channel.

From the bottom up:

- `hardware`: signals, settings; `chassis` and `transducer` are shared by all parts of a modem.
- `exchanges`: deliveries over several signals: `instant`, `bursts` out of a `pool`, `usblhead`.
- `observation`, `medium`: the channel, and the events for an observer of all modems.
- `modem`: one modem, sans-IO: `queries`, `actions`, `listening`, `levelcontrol`.
- `station`: a modem with its ports, and their `faults`.
- `fleet`: many modems in virtual time (`EmulatedFleet`), for tests without a loop.
- `command`: the verb. `zacoustic.link.emulation` has the loop, TCP ports and pseudo-terminals.
"""

from zacoustic.link.emulation import ModemDown, ModemOutput, ModemUp, PortBytes, PortClosed
from zacoustic.link.emulation.placing import scenario_of
from zacoustic_evologics.emulator.fleet import EmulatedFleet
from zacoustic_evologics.emulator.guesses import BurstGuess, burst_guess
from zacoustic_evologics.emulator.hardware.chassis import Behaviour
from zacoustic_evologics.emulator.observation import Observation, SignalArrived, SignalEmitted
from zacoustic_evologics.emulator.station.faults import FaultKind, FaultPlan, ScriptedFault

__all__ = [
    "Behaviour",
    "BurstGuess",
    "EmulatedFleet",
    "FaultKind",
    "FaultPlan",
    "ModemDown",
    "ModemOutput",
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
