"""Faults inside of nodes: crashes, clocks, journals, unplugged modems.

A medium has only modems and ignores these faults; `zacoustic.testing.VirtualNetwork`, and with it
`zacoustic sim`, applies them.
"""

from typing import Final

import msgspec

from zacoustic.channel.faults.blackout import check_span
from zacoustic.channel.faults.limits import check_range

_MAX_TIME_S: Final = 1.0e9
_MAX_DRIFT_PPM: Final = 10_000.0  # a hundred times worse than the worst crystal
_MAX_JUMP_S: Final = 1.0e10  # three hundred years


class SpanSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A time when a part of a node does not work."""

    node: int
    """Address of the node."""
    from_s: float
    """Begin, s, ≥ 0."""
    to_s: float
    """End, s, above `from_s`."""

    def __post_init__(self) -> None:
        """Check the times.

        Raises:
            ValueError: A time outside its range.
        """
        check_span(self.from_s, self.to_s)


class CrashSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A node loses all but its journal, and starts again; at instants, or at a rate."""

    node: int
    """Address of the node."""
    at_s: tuple[float, ...] = ()
    """Instants, s; or a rate. An instant at which the node is already down has no effect."""
    every_s: float | None = None
    """Mean time from a start to the next crash, s, exponentially distributed; or instants."""
    to_s: float | None = None
    """End of the crashes at a rate, s; None: no end."""
    restart_after_s: float = 10.0
    """Time until the node has restarted, s, ≥ 0."""
    reboots: bool = False
    """The whole computer reboots: its monotonic clock starts again."""

    def __post_init__(self) -> None:
        """Check the times.

        Raises:
            ValueError: A time outside its range, or not exactly one of `at_s` and `every_s`.
        """
        if (not self.at_s) == (self.every_s is None):
            raise ValueError("at_s is missing; allowed: exactly one of at_s and every_s")
        for index, instant_s in enumerate(self.at_s):
            check_range(f"at_s[{index}]", instant_s, 0.0, _MAX_TIME_S)
        if self.every_s is not None:
            check_range("every_s", self.every_s, 1.0, _MAX_TIME_S)
        if self.to_s is not None:
            check_range("to_s", self.to_s, 0.0, _MAX_TIME_S)
        check_range("restart_after_s", self.restart_after_s, 0.0, _MAX_TIME_S)


class JumpSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A step of a node's wall clock."""

    at_s: float
    """Instant, s."""
    by_s: float
    """Size of the step, s; negative: back."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A value outside its range.
        """
        check_range("at_s", self.at_s, 0.0, _MAX_TIME_S)
        check_range("by_s", self.by_s, -_MAX_JUMP_S, _MAX_JUMP_S)


class ClockSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The clocks of a node: both drift; the wall clock also has an offset and steps.

    Nodes without such a record have right clocks, and know it.
    """

    node: int
    """Address of the node."""
    drift_ppm: float = 0.0
    """Drift of both clocks, parts per million; positive: fast."""
    offset_s: float = 0.0
    """Lead of the wall clock at the beginning, s."""
    jumps: tuple[JumpSpec, ...] = ()
    """Steps of the wall clock."""
    error_s: float | None = None
    """Error that the node claims for its wall clock, s; drift adds to it. None: the error is
    unknown, and the engine never gets the wall clock."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A value outside its range.
        """
        check_range("drift_ppm", self.drift_ppm, -_MAX_DRIFT_PPM, _MAX_DRIFT_PPM)
        check_range("offset_s", self.offset_s, -_MAX_JUMP_S, _MAX_JUMP_S)
        if self.error_s is not None:
            check_range("error_s", self.error_s, 0.0, _MAX_JUMP_S)


class JournalSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The journals of all nodes."""

    keeps: bool | None = None
    """Entries survive a crash; otherwise only the boot epoch does. None: as the scenario's config
    says; without a config they survive."""
    commit_s: float = 0.0
    """Duration of a commit, s: a crash loses what is not committed."""
    untold: float = 0.0
    """Share of the crashes during a commit after which the commit is complete although the node was
    not told, 0…1."""
    fails: tuple[SpanSpec, ...] = ()
    """Times when commits fail: the node learns it and repeats them."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A value outside its range.
        """
        check_range("commit_s", self.commit_s, 0.0, 3600.0)
        check_range("untold", self.untold, 0.0, 1.0)
