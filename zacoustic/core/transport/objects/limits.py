"""How much memory objects may take."""

from typing import Annotated, Final, TypeAlias

import msgspec
from msgspec import Meta

from zacoustic.core.wire.objects import MOST_TRANSFERS
from zacoustic.text.allowed import check_fields

LARGEST_BYTES: Final = 1 << 20
"""Default of the largest payload of an object, bytes."""
MOST_BYTES: Final = (1 << 28) - 1
"""The largest payload that a manifest can state, bytes."""

ObjectBytes: TypeAlias = Annotated[int, Meta(ge=1, le=MOST_BYTES, title="a number of bytes")]
"""Bytes of the largest payload of an object."""
Transfers: TypeAlias = Annotated[int, Meta(ge=1, le=MOST_TRANSFERS)]
"""Objects that may be sent or wait at once."""
ObjectMemory: TypeAlias = Annotated[int, Meta(ge=1, le=1 << 32, title="a number of bytes")]
"""Bytes of all incoming objects at once."""


class ObjectLimits(msgspec.Struct, frozen=True, kw_only=True):
    """How much memory objects may take."""

    largest_bytes: ObjectBytes = LARGEST_BYTES
    """The largest payload that is sent or received, bytes."""
    most_outgoing: Transfers = 16
    """The most objects that may be sent or wait at once."""
    incoming_bytes: ObjectMemory = 4 << 20
    """The most bytes that all incoming objects may take at once, at least `largest_bytes`."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: States field, value and the allowed values.
        """
        check_fields(self)
        if self.incoming_bytes < self.largest_bytes:
            raise ValueError(
                f"incoming_bytes is {self.incoming_bytes}; "
                f"allowed: at least largest_bytes, {self.largest_bytes}"
            )
