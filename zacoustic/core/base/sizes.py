"""Sizes of number windows and tables: how many numbers there are, and how much is remembered.

Numbers on the wire are few, so that they cost few bits, and each is used again. Tables are bounded,
since anybody may fill them from the channel. All these sizes are here, and an engine gets them as
one argument: a test with windows of two to four meets within minutes what takes a fleet months
(`zacoustic.testing.SMALL_SIZES`). Both ends of an exchange need the same `Sizes`; at sea all nodes
have the defaults, which docs/wire.md prescribes.
"""

from typing import Final

import msgspec


class SampleNumbering(msgspec.Struct, frozen=True, kw_only=True):
    """How the samples of one key are numbered (`zacoustic.core.transport.reliable`).

    The bounds keep late repetitions apart from new samples: a number is new if it is less than
    `window` ahead of the expected one, and of the others no more than `pace` come into use within
    one settling time.
    """

    count: int = 128
    """Numbers that a record distinguishes, at most 128."""
    window: int = 32
    """A sample without SYNC is less than this many numbers ahead of the one that its receiver
    awaits, and at most this many are under way; at most `count` / 4."""
    pace: int = 64
    """The most numbers that come into use within one settling time, at most `count` - 2
    `window`."""

    def resolve(self, low: int, expected: int) -> int:
        """Return the number with these low bits that is nearest to the expected one."""
        ahead = (low - expected) % self.count
        return expected + (ahead if ahead < self.window else ahead - self.count)

    def resolve_expected(self, low: int, known: int) -> int:
        """Return the number that an ACK expects; up to a whole window may be unreported."""
        return self.resolve(low - 1, known) + 1


class Numbering(msgspec.Struct, frozen=True):
    """How one kind of exchange is numbered (`zacoustic.core.transport.exchanges`)."""

    count: int
    """Numbers, from 0."""
    window: int
    """The most exchanges of one client on one stream that can be under way at once."""
    stride: int
    """Distance of the first numbers of successive boot epochs; odd, so that they take all numbers
    in turn."""

    def first(self, epoch: int) -> int:
        """Return the first number of a boot epoch."""
        return (epoch - 1) * self.stride % self.count

    def closes(self, number: int, other: int) -> bool:
        """Return whether a request proves that another exchange has ended at its client."""
        return self.window <= (number - other) % self.count <= self.count - self.window


class Sizes(msgspec.Struct, frozen=True, kw_only=True):
    """The sizes of one engine."""

    samples: SampleNumbering = SampleNumbering()
    """Numbers of reliable samples."""
    calls: Numbering = Numbering(count=64, window=16, stride=23)
    """Numbers of the calls of one client to one service. Epochs begin with 0, 23, 46, 5, 28, …"""
    goals: Numbering = Numbering(count=32, window=12, stride=11)
    """Numbers of the goals of one client on one stream. Epochs begin with 0, 11, 22, 1, 12, …"""
    transfers: int = 64
    """Numbers of large samples under way, at most 64."""
    versions: int = 256
    """Versions of subscribe messages, at most 256."""
    hops: int = 256
    """Numbers of frames on a route, a bond or a flood, at most 256."""
    ended_transfers: int = 256
    """Large samples that a receiver remembers after their end."""
    served_goals: int = 1024
    """Goals of all clients that a server remembers."""
    seen_hops: int = 1024
    """Numbers of frames that a node of a route, a bond or a flood remembers."""


SIZES: Final = Sizes()
"""The sizes at sea."""
