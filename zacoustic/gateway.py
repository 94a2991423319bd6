"""Public names of the gateway, for programs: `zacoustic.zenoh.gateway`."""

from zacoustic.zenoh.gateway import (
    Gateway,
    Marker,
    Notice,
    read_marker,
)

__all__ = [
    "Gateway",
    "Marker",
    "Notice",
    "read_marker",
]
