"""Traffic of a scenario: who says what, and how often; for `zacoustic sim`, not for a medium.

::

    traffic: [ { node: 2, topic: "auv1/nav", every_s: 10, value: { depth: 4.2 } },
               { node: 2, topic: "auv1/raw", every_s: 10, first_s: 5, size_bytes: 30 },
               { node: 1, service: "auv1/arm", every_s: 60, value: { on: true },
                 answer: { ok: true } } ]

A topic or service is a name of the scenario's `config`. Without a config each topic is a stream of
opaque bytes of its own.
"""

from typing import Any

import msgspec

from zacoustic.channel.limits import check_range

_MAX_PERIOD_S = 1e8
_MAX_SIZE_BYTES = 65_535


class TrafficSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One publisher or client."""

    node: int
    """Address of the node."""
    topic: str | None = None
    """Key that it publishes under; or a service."""
    service: str | None = None
    """Service that it calls; or a topic."""
    every_s: float
    """Period, s, > 0."""
    first_s: float = 0.0
    """First time, s, ≥ 0."""
    jitter_s: float = 0.0
    """Each instant is later by up to this, s, ≥ 0."""
    size_bytes: int | None = None
    """Opaque payloads of this size, random; or a value."""
    value: Any = None
    """The same sample or request each time; or a size."""
    answer: Any = None
    """What the server of a service answers; None: empty bytes."""

    def __post_init__(self) -> None:
        """Check the ranges and that the keys fit together.

        Raises:
            ValueError: A value outside its range, or not exactly one of two keys.
        """
        if (self.topic is None) == (self.service is None):
            raise ValueError("topic is missing; allowed: exactly one of topic and service")
        if (self.size_bytes is None) == (self.value is None):
            raise ValueError("value is missing; allowed: exactly one of value and size_bytes")
        check_range("every_s", self.every_s, 1e-3, _MAX_PERIOD_S)
        check_range("first_s", self.first_s, 0.0, _MAX_PERIOD_S)
        check_range("jitter_s", self.jitter_s, 0.0, _MAX_PERIOD_S)
        if self.size_bytes is not None:
            check_range("size_bytes", self.size_bytes, 0, _MAX_SIZE_BYTES)
