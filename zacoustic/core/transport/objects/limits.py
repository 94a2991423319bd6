"""How much memory objects may take."""

from typing import Final

import msgspec

from zacoustic.core.wire.objects import MOST_TRANSFERS

LARGEST_BYTES: Final = 1 << 20
"""Default of the largest payload of an object, bytes."""
MOST_BYTES: Final = (1 << 28) - 1
"""The largest payload that a manifest can state, bytes."""


class ObjectLimits(msgspec.Struct, frozen=True, kw_only=True):
    """How much memory objects may take."""

    largest_bytes: int = LARGEST_BYTES
    """The largest payload that is sent or received, bytes."""
    most_outgoing: int = 16
    """The most objects that may be sent or wait at once, 1…64."""
    incoming_bytes: int = 4 << 20
    """The most bytes that all incoming objects may take at once, at least `largest_bytes`."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: States field, value and the allowed values.
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
