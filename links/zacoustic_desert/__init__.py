"""DESERT Underwater as a link: a client of its application socket, and a stand-in for it."""

from zacoustic_desert.config import DesertConfig
from zacoustic_desert.link import DesertLink

__all__ = ["DesertConfig", "DesertLink"]
