"""Iridium Short Burst Data as a link: a modem at sea, DirectIP on shore, an emulator of both."""

from zacoustic_iridium.config import IridiumConfig
from zacoustic_iridium.link import IridiumLink

__all__ = ["IridiumConfig", "IridiumLink"]
