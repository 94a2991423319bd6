"""What a modem does to frames that it has received: hands them over damaged, or twice.

The medium decides which frames (`Reception.corrupt_seed`, `Reception.duplicates_after_s`) and never
sees their bytes; the driver, which has them, damages them here.
"""

import random
from typing import Final

import msgspec

from zacoustic.channel.limits import check_range

_MAX_FLIPPED_BITS: Final = 4  # few enough that a weak check can be fooled, which is the point


class FaultSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a modem does to frames that it has received."""

    corrupt: float = 0.0
    """Share of the received frames that arrive with flipped bits, 0…1."""
    duplicate: float = 0.0
    """Share of the received frames that are reported twice, 0…1."""
    duplicate_after_s: float = 0.5
    """Time between the two reports, s, 0…3600."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A share outside 0…1, or a time outside its range.
        """
        check_range("corrupt", self.corrupt, 0.0, 1.0)
        check_range("duplicate", self.duplicate, 0.0, 1.0)
        check_range("duplicate_after_s", self.duplicate_after_s, 0.0, 3600.0)


def corrupt(frame: bytes, rng: random.Random) -> bytes:
    """Return the frame with one to four bits flipped; an empty one as it is.

    Args:
        frame: The frame as it was sent.
        rng: ``random.Random(reception.corrupt_seed)``, so that a repeated run damages the same
            bits.
    """
    if not frame:
        return frame
    damaged = bytearray(frame)
    flips = min(1 + int(rng.random() * _MAX_FLIPPED_BITS), 8 * len(frame))
    flipped: set[int] = set()
    while len(flipped) < flips:
        flipped.add(int(rng.random() * 8 * len(frame)))
    for bit in flipped:
        damaged[bit // 8] ^= 1 << (bit % 8)
    return bytes(damaged)
