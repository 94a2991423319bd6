"""How an arithmetic coder divides its interval: what `writer` and `reader` agree on."""

from itertools import accumulate
from typing import Final

TOTAL_BITS: Final = 28
TOTAL: Final = 1 << TOTAL_BITS
"""Shares are multiples of 1/`TOTAL`."""

PROBABILITY_BITS: Final = 16
"""Probabilities of flags are multiples of 2**-16."""

MARKER: Final = 0xC0
"""The two highest bits of the first byte."""

MARKER_BITS: Final = 2

SPARED_BITS: Final = 64
"""A block ends where only zeros would follow, but for no more than this: so a short block cannot
make its reader work for long."""

WIDTH_BITS: Final = 48
"""The width of the interval is kept at so many bits."""

LEAST_WIDTH: Final = 1 << WIDTH_BITS - 1
"""The least width of so many bits."""

FLAG_SHIFT: Final = TOTAL_BITS - PROBABILITY_BITS
"""From a probability of a flag to a share."""

CHUNK_BITS: Final = 16
"""A longer number is written in several pieces."""


def ends_of(*shares: int) -> tuple[int, ...]:
    """Where relative shares that never change begin and end, for `pick`."""
    whole = sum(shares)
    return tuple(before * TOTAL // whole for before in accumulate(shares, initial=0))


def shortest_bytes(bits: int) -> int:
    """Least size of a block that holds that many bits, the marker and zeros spared, bytes."""
    return max(1, (bits + MARKER_BITS - SPARED_BITS + 7) // 8)
