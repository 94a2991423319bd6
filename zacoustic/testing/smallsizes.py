"""Small number windows and tables, with which a test meets the reuse of numbers within minutes."""

from typing import Final

from zacoustic.core.base.sizes import Numbering, SampleNumbering, Sizes

SMALL_SIZES: Final = Sizes(
    samples=SampleNumbering(count=12, window=3, pace=6),
    calls=Numbering(count=6, window=2, stride=5),
    goals=Numbering(count=6, window=2, stride=5),
    transfers=3,
    versions=8,
    hops=16,
    ended_transfers=4,
    served_goals=16,
    seen_hops=32,
)
"""Sizes with the same proportions as those at sea, and windows of two and three."""
