"""How an arithmetic coder divides its interval: constants of `writer` and `reader`."""

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
"""A block ends where only zeros would follow, but omits no more than this many: so a short block
cannot make its reader work for long."""

WIDTH_BITS: Final = 48
"""Bits of the interval's width."""

LEAST_WIDTH: Final = 1 << WIDTH_BITS - 1
"""The least width with that many bits."""

FLAG_SHIFT: Final = TOTAL_BITS - PROBABILITY_BITS
"""Shift from a flag's probability to a share."""

CHUNK_BITS: Final = 16
"""Longer numbers are written in several pieces."""


def ends_of(*shares: int) -> tuple[int, ...]:
    """Return where fixed relative shares begin and end, for `pick`."""
    whole = sum(shares)
    return tuple(before * TOTAL // whole for before in accumulate(shares, initial=0))


def shortest_bytes(bits: int) -> int:
    """Return the least size of a block with that many bits, marker and zeros deducted, bytes."""
    return max(1, (bits + MARKER_BITS - SPARED_BITS + 7) // 8)
