"""All faults of a scenario, apart from lost frames (`loss`).

Some faults affect received frames: the modem delivers them damaged, late or twice. The medium
decides which frames (`Reception.corrupt_seed`, `Reception.delay_s`,
`Reception.duplicates_after_s`) and never sees their bytes; the driver, which has them, damages them
here. Some faults are the channel's (`blackout`), others the nodes' (`nodefaults`).
"""

import random
from collections.abc import Iterator, Sequence
from typing import Final

import msgspec

from zacoustic.channel.faults.blackout import BlackoutSpec
from zacoustic.channel.faults.limits import check_range
from zacoustic.channel.faults.nodefaults import ClockSpec, CrashSpec, JournalSpec, SpanSpec

_MAX_FLIPPED_BITS: Final = 4  # few enough that a weak check can be fooled, which is the point


class FaultSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The faults of a scenario."""

    corrupt: float = 0.0
    """Share of the received frames that arrive with flipped bits, 0…1."""
    duplicate: float = 0.0
    """Share of the received frames that are reported twice, 0…1."""
    duplicate_after_s: float | tuple[float, float] = 0.5
    """Time between the two reports, s, 0…3600: fixed, or drawn between two limits."""
    jitter_s: float = 0.0
    """Received frames are reported late by up to this, s, 0…3600; one may overtake another."""
    blackouts: tuple[BlackoutSpec, ...] = ()
    """Times when nodes cannot hear each other."""
    unplugged: tuple[SpanSpec, ...] = ()
    """Times when a node has no modem."""
    crashes: tuple[CrashSpec, ...] = ()
    """Nodes that crash and start again."""
    clocks: tuple[ClockSpec, ...] = ()
    """Nodes with wrong clocks; all others are right."""
    journal: JournalSpec = JournalSpec()
    """How the journals of the nodes behave."""
    until_s: float | None = None
    """No fault begins after this instant, s; None: no limit."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A share outside 0…1, or a time outside its range.
        """
        check_range("corrupt", self.corrupt, 0.0, 1.0)
        check_range("duplicate", self.duplicate, 0.0, 1.0)
        if isinstance(self.duplicate_after_s, tuple):
            for index, after_s in enumerate(self.duplicate_after_s):
                check_range(f"duplicate_after_s[{index}]", after_s, 0.0, 3600.0)
        else:
            check_range("duplicate_after_s", self.duplicate_after_s, 0.0, 3600.0)
        check_range("jitter_s", self.jitter_s, 0.0, 3600.0)
        if self.until_s is not None:
            check_range("until_s", self.until_s, 0.0, 1.0e9)
        seen: set[int] = set()
        for index, clock in enumerate(self.clocks):
            if clock.node in seen:
                raise ValueError(f"clocks[{index}].node is {clock.node}; allowed: each node once")
            seen.add(clock.node)

    @property
    def touch_frames(self) -> bool:
        """Whether a fault affects received frames."""
        return self.corrupt > 0.0 or self.duplicate > 0.0 or self.jitter_s > 0.0

    def nodes(self) -> Iterator[tuple[str, int]]:
        """Yield the key of each address, and the address."""
        for index, blackout in enumerate(self.blackouts):
            key = "node" if blackout.node is not None else "pair"
            for address in blackout.nodes:
                yield f"blackouts[{index}].{key}", address
        lists: dict[str, Sequence[SpanSpec | CrashSpec | ClockSpec]] = {
            "unplugged": self.unplugged,
            "crashes": self.crashes,
            "clocks": self.clocks,
            "journal.fails": self.journal.fails,
        }
        for name, entries in lists.items():
            for index, entry in enumerate(entries):
                yield f"{name}[{index}].node", entry.node


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
