"""What goes wrong between an emulated modem and its host: by chance with a seed, or by script.

::

    { seed: 7, from_s: 10, until_s: 60,
      rates: { lost_reply: 0.05, garbage: 0.02, busy: 0.1 },
      script: [ { kind: "busy", at_s: 5, modem: 2, lasts_s: 3 },
                { kind: "lost_ack", at_s: 20, count: 2 },
                { kind: "reset", at_s: 30, modem: 1 } ] }

A rate is the chance at each opportunity, between `from_s` and `until_s`. A fault of the script
happens at the first `count` opportunities from its instant on, or at all of `lasts_s`; `reset` and
`drop_connection` need no opportunity and happen at the instant.

Garbage stands between messages. `half_line`, `wrong_length` and `corrupt` damage them, and what is
damaged inside of a received message can look like another one, since the grammar has no check: a
host cannot be blamed for taking it. `spares_payloads` keeps these to lines that carry none.
"""

import enum
import random
from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic.channel.faults.limits import check_range
from zacoustic.core.clock import seconds_to_ns
from zacoustic.errors import ConfigError


class FaultKind(enum.Enum):
    """What can go wrong, and when it has an opportunity."""

    BUSY = "busy"
    """A command that sends is answered BUSY, and not executed."""
    LOST_REPLY = "lost_reply"
    """A reply is omitted."""
    STARRED = "starred"
    """An `OK` becomes `[*]OK`."""
    EFAULT = "efault"
    """`ERROR EFAULT` comes before a reply."""
    LATE = "late"
    """A notification comes later by at most `late_s`, behind those that follow it."""
    DUPLICATE = "duplicate"
    """A received instant message is reported twice."""
    LOST_ACK = "lost_ack"
    """A received acknowledgement is not decoded."""
    GARBAGE = "garbage"
    """Noise on the line before a message."""
    HALF_LINE = "half_line"
    """A message ends in the middle, and nothing replaces the rest."""
    WRONG_LENGTH = "wrong_length"
    """The length that a received message announces is wrong."""
    CORRUPT = "corrupt"
    """Bits of a message are flipped."""
    PIECES = "pieces"
    """A message is given to the host byte by byte."""
    STALE = "stale"
    """A new connection begins with the end of something older."""
    DROP_CONNECTION = "drop_connection"
    """A TCP connection is closed, when the host has sent something."""
    RESET = "reset"
    """The modem restarts, when the host has sent something."""


class ScriptedFault(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Something that goes wrong at an instant."""

    kind: FaultKind
    """What."""
    at_s: float
    """From when on, s since the start."""
    modem: int = 0
    """Address of the modem in the scenario; 0: each of them."""
    count: int = 1
    """At how many opportunities; ignored with `lasts_s`."""
    lasts_s: float | None = None
    """At all opportunities of so many seconds."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A value outside its range.
        """
        check_range("at_s", self.at_s, 0.0, 1e9)
        check_range("modem", self.modem, 0, 254)
        check_range("count", self.count, 1, 1_000_000)
        if self.lasts_s is not None:
            check_range("lasts_s", self.lasts_s, 0.0, 1e9)


class FaultPlan(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All that goes wrong."""

    seed: int = 1
    """Every draw follows from it."""
    from_s: float = 0.0
    """Rates hold from here, s since the start."""
    until_s: float = 1e9
    """Rates hold up to here, s."""
    rates: Mapping[FaultKind, float] = {}
    """Chance of each kind, 0…1."""
    late_s: float = 2.0
    """By how much a late notification is late at most, s."""
    spares_payloads: bool = False
    """Nothing is damaged in records that carry a payload."""
    script: tuple[ScriptedFault, ...] = ()
    """Scripted faults."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A rate outside 0…1.
        """
        for kind, rate in self.rates.items():
            check_range(f"rates.{kind.value}", rate, 0.0, 1.0)
        check_range("late_s", self.late_s, 0.0, 3600.0)


NO_FAULTS: Final = FaultPlan()
"""Nothing goes wrong."""
TIMED: Final = (FaultKind.DROP_CONNECTION, FaultKind.RESET)
"""Kinds that the script makes happen by themselves."""
DAMAGING: Final = (FaultKind.HALF_LINE, FaultKind.WRONG_LENGTH, FaultKind.CORRUPT)
"""Kinds that change bytes of a message."""


def plan_from_mapping(mapping: object, *, source: str) -> FaultPlan:
    """Convert what a parser made of a file of faults.

    Raises:
        ConfigError: One line: file and what is wrong.
    """
    try:
        return msgspec.convert(mapping, FaultPlan)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{source}: {error}") from None


class Misfortune:
    """What goes wrong at one modem.

    Args:
        plan: What goes wrong.
        node: Address of the modem in the scenario.
    """

    def __init__(self, plan: FaultPlan, node: int) -> None:
        self.rng = random.Random(f"zacoustic/faults/{plan.seed}/{node}")
        self._plan = plan
        self._rates_hold = range(seconds_to_ns(plan.from_s), seconds_to_ns(plan.until_s))
        self._script = [_Pending(each) for each in plan.script if each.modem in (0, node)]

    def strikes(self, kind: FaultKind, now: int) -> bool:
        """Tell whether this opportunity goes wrong."""
        # The script first, but the draw in any case: a script does not change what chance does.
        rate = self._plan.rates.get(kind, 0.0) if now in self._rates_hold else 0.0
        is_drawn = rate > 0.0 and self.rng.random() < rate
        is_scripted = any(each.take(kind, now) for each in self._script)
        return is_scripted or is_drawn

    def damages(self, kind: FaultKind, now: int, *, has_payload: bool) -> bool:
        """Tell whether a message is damaged so."""
        assert kind in DAMAGING
        return self.strikes(kind, now) and not (has_payload and self._plan.spares_payloads)

    def timed_at(self) -> list[int]:
        """Return when the script makes something happen by itself, ns."""
        pending = (each for each in self._script if each.left and each.fault.kind in TIMED)
        return [each.from_ns for each in pending]

    def take_timed(self, now: int) -> list[FaultKind]:
        """Return what the script makes happen now."""
        pending = (each for each in self._script if each.fault.kind in TIMED)
        return [each.fault.kind for each in pending if each.take(each.fault.kind, now)]

    def late_ns(self) -> int:
        """Draw by how much a notification is late."""
        return seconds_to_ns(self._plan.late_s * self.rng.random())

    def garbage(self) -> bytes:
        """Draw noise on the line: bytes without a line feed, then one."""
        count = 1 + int(self.rng.random() * 24)
        noise = bytes(int(self.rng.random() * 256) for _ in range(count))
        return noise.replace(b"\n", b"?").replace(b"+", b"?") + b"\r\n"

    def cut(self, content: bytes) -> bytes:
        """Draw how much of a message is left."""
        return content[: int(self.rng.random() * len(content))]

    def other_length(self, length: int) -> int:
        """Draw another length."""
        return max(0, length + 1 + int(self.rng.random() * 9) - 5 or length + 5)


class _Pending:
    """A scripted fault that has not been used up."""

    def __init__(self, fault: ScriptedFault) -> None:
        self.fault = fault
        self.left = fault.count
        self.from_ns = seconds_to_ns(fault.at_s)
        self._until_ns = (
            None if fault.lasts_s is None else self.from_ns + seconds_to_ns(fault.lasts_s)
        )

    def take(self, kind: FaultKind, now: int) -> bool:
        if kind is not self.fault.kind or now < self.from_ns or not self.left:
            return False
        if self._until_ns is not None and kind not in TIMED:
            return now < self._until_ns
        self.left -= 1
        return True
