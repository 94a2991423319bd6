"""Instants and durations: integer nanoseconds inside, float seconds at the public surface.

An *instant* is an ``int``, nanoseconds on the node's own monotonic clock; arguments are called
``now``, fields end in ``_at``. A *duration* that a user writes is a ``float`` in seconds and its
name ends in ``_s``; it is converted here, once. Integers, because slot arithmetic on float
seconds puts one boundary in twenty into the neighbouring slot, where a timer finds itself early
and re-arms for the same instant for ever.

The core never asks for the time. A shell passes it in: the runtime from ``time.monotonic_ns``,
the virtual network from its event heap.
"""

from typing import Annotated, Final, Protocol, TypeAlias

from msgspec import Meta

NS_PER_S: Final = 1_000_000_000
"""Nanoseconds in a second."""
SHORTEST_S: Final = 1e-6
"""The shortest duration that users may write, s."""
LONGEST_S: Final = 1e9
"""The longest one, s; beyond these bounds the arithmetic fails, and no use is known."""
DURATIONS: Final = f"{SHORTEST_S:g}..{LONGEST_S:g} s"
"""The bounds in words."""

Duration: TypeAlias = Annotated[
    float,
    Meta(
        ge=SHORTEST_S, le=LONGEST_S, description=f"seconds, above 0, {SHORTEST_S:g}..{LONGEST_S:g}"
    ),
]
"""A duration that users write, s."""
DurationOrZero: TypeAlias = Annotated[float, Meta(ge=0, le=LONGEST_S, title="seconds")]
"""The same where 0 has a meaning."""
Share: TypeAlias = Annotated[float, Meta(gt=0, le=1, title="a share")]
"""A share of the time."""


class Clock(Protocol):
    """Called by a shell to learn the instant that it passes to an engine."""

    def __call__(self) -> int:
        """Return the current instant, ns; never smaller than the one before."""
        ...


def is_duration(duration_s: float, *, or_zero: bool = False) -> bool:
    """Return whether a user may write a duration, s; False for NaN."""
    return SHORTEST_S <= duration_s <= LONGEST_S or (or_zero and duration_s == 0)


def seconds_to_ns(duration_s: float) -> int:
    """Convert a duration in seconds to integer nanoseconds, to the nearest."""
    return round(duration_s * NS_PER_S)


def ns_to_seconds(duration_ns: int) -> float:
    """Convert a duration in nanoseconds to float seconds."""
    return duration_ns / NS_PER_S
