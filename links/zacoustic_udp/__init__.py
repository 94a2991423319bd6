"""Datagrams as a link: a radio at the surface, or two processes on one machine."""

from zacoustic_udp.link import UdpConfig, UdpLink

__all__ = ["UdpConfig", "UdpLink"]
