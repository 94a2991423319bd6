"""How much memory objects may take."""

from typing import Final

import msgspec

from zacoustic.core.wire.objects import MOST_TRANSFERS

LARGEST_BYTES: Final = 1 << 20
"""Default largest payload of an object, bytes."""
MOST_BYTES: Final = (1 << 28) - 1
"""Largest payload of a manifest, bytes."""


class ObjectLimits(msgspec.Struct, frozen=True, kw_only=True):
    """How much memory objects may take."""

    largest_bytes: int = LARGEST_BYTES
    """Largest payload that is sent or taken, bytes."""
    most_outgoing: int = 16
    """Most objects that are sent or wait, 1…64."""
    incoming_bytes: int = 4 << 20
    """Most bytes that all objects take that arrive at a time, at least `largest_bytes`."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: Names field, value and the allowed values.
        """
        ranges = {
            "largest_bytes": (1, MOST_BYTES),
            "most_outgoing": (1, MOST_TRANSFERS),
            "incoming_bytes": (self.largest_bytes, 1 << 32),
        }
        for name, (least, most) in ranges.items():
            value = getattr(self, name)
            if not least <= value <= most:
                raise ValueError(f"{name} is {value}; allowed: {least}..{most}")
