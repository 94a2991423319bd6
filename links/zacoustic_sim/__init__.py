"""The simulator as a link: modems on a channel in this process or in another."""

from zacoustic_sim.link import SimConfig, SimLink

__all__ = ["SimConfig", "SimLink"]
