"""The simulator as a link: a channel in this process or in another, with its modems."""

from zacoustic_sim.link import SimConfig, SimLink

__all__ = ["SimConfig", "SimLink"]
