"""Traffic of a scenario: who sends what, and how often; for `zacoustic sim`, not for a medium.

::

    traffic: [ { node: 2, topic: "auv1/nav", every_s: 10, value: { mode: "survey" },
                 vary: { depth: [0, 40] } },
               { node: 2, topic: "auv1/raw", every_s: 60, pattern: "random", burst: 5,
                 size_bytes: [10, 30] },
               { node: 1, service: "auv1/arm", every_s: 60, value: { on: true },
                 answer: { ok: true }, first_s: 600, until_s: 1200 } ]

A topic or service is a name in the scenario's `config`. Without a config each topic is a separate
stream of opaque bytes.
"""

from typing import Any, Literal

import msgspec

from zacoustic.channel.faults.limits import check_range

Pattern = Literal["periodic", "random"]
"""``periodic``: at equal periods. ``random``: the period is the mean of an exponential
distribution, so that the instants are independent of each other."""

_MAX_PERIOD_S = 1e8
_MAX_SIZE_BYTES = 65_535


class TrafficSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One publisher or client."""

    node: int
    """Address of the node."""
    topic: str | None = None
    """Key of the published topic; or a service."""
    service: str | None = None
    """Called service; or a topic."""
    every_s: float
    """Period, s, > 0."""
    pattern: Pattern = "periodic"
    """Distribution of the instants."""
    burst: int = 1
    """Number at each instant, ≥ 1."""
    first_s: float = 0.0
    """First instant, s, ≥ 0."""
    until_s: float | None = None
    """No instant at or after this, s; None: no end."""
    jitter_s: float = 0.0
    """Largest random delay of each instant, s, ≥ 0."""
    size_bytes: int | tuple[int, int] | None = None
    """Size of opaque payloads, fixed or drawn between two limits; or a value."""
    value: Any = None
    """A sample or request; or a size."""
    vary: dict[str, tuple[float, float]] = {}
    """Fields of the value that are drawn between two limits each time."""
    late_after_s: float | None = None
    """Age at which a sample counts as late, s; None: the lifespan of its stream."""
    answer: Any = None
    """Answer of a service's server; None: empty bytes."""

    def __post_init__(self) -> None:
        """Check the ranges, and that the keys match.

        Raises:
            ValueError: A value outside its range, or not exactly one of two keys.
        """
        if (self.topic is None) == (self.service is None):
            raise ValueError("topic is missing; allowed: exactly one of topic and service")
        if (self.size_bytes is None) == (self.value is None):
            raise ValueError("value is missing; allowed: exactly one of value and size_bytes")
        if self.vary and not isinstance(self.value, dict):
            raise ValueError(f"vary is {self.vary}; allowed: with a value that has fields")
        check_range("every_s", self.every_s, 1e-3, _MAX_PERIOD_S)
        check_range("burst", self.burst, 1, 10_000)
        check_range("first_s", self.first_s, 0.0, _MAX_PERIOD_S)
        check_range("jitter_s", self.jitter_s, 0.0, _MAX_PERIOD_S)
        if self.until_s is not None:
            check_range("until_s", self.until_s, 0.0, _MAX_PERIOD_S)
        if self.late_after_s is not None:
            check_range("late_after_s", self.late_after_s, 0.0, _MAX_PERIOD_S)
        if isinstance(self.size_bytes, tuple):
            low, high = self.size_bytes
            check_range("size_bytes[0]", low, 0, _MAX_SIZE_BYTES)
            check_range("size_bytes[1]", high, low, _MAX_SIZE_BYTES)
        elif self.size_bytes is not None:
            check_range("size_bytes", self.size_bytes, 0, _MAX_SIZE_BYTES)
