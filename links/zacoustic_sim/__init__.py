"""The simulator as a link: modems on a channel in this process or in another."""

from zacoustic_sim.link import SimConfig, SimLink
from zacoustic_sim.medium import SimMedium

__all__ = ["SimConfig", "SimLink", "SimMedium"]
