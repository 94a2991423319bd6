"""The simulator as a link: water in this process or in another, and modems in it."""

from zacoustic_sim.link import SimConfig, SimLink

__all__ = ["SimConfig", "SimLink"]
