"""Instants, as links see them: `zacoustic.core.base.clock`."""

from zacoustic.core.base.clock import (
    DURATIONS,
    LONGEST_S,
    NS_PER_S,
    SHORTEST_S,
    Clock,
    Duration,
    DurationOrZero,
    is_duration,
    ns_to_seconds,
    seconds_to_ns,
)

__all__ = [
    "DURATIONS",
    "LONGEST_S",
    "NS_PER_S",
    "SHORTEST_S",
    "Clock",
    "Duration",
    "DurationOrZero",
    "is_duration",
    "ns_to_seconds",
    "seconds_to_ns",
]
