"""Faults between an emulated modem and its host: by chance with a seed, or by script.

::

    { seed: 7, from_s: 10, until_s: 60,
      rates: { lost_reply: 0.05, garbage: 0.02, busy: 0.1 },
      script: [ { kind: "busy", at_s: 5, modem: 2, lasts_s: 3 },
                { kind: "lost_ack", at_s: 20, count: 2 },
                { kind: "reset", at_s: 30, modem: 1 } ] }

A rate is the probability at each opportunity, between `from_s` and `until_s`. A scripted fault
happens at the first `count` opportunities from its instant on, or at all within `lasts_s`; `reset`
and `drop_connection` need no opportunity and happen at their instant.

Garbage comes between messages. `half_line`, `wrong_length` and `corrupt` damage messages. A damaged
received message can look like a valid one, since the grammar has no check, so a host may accept it.
`spares_payloads` limits the three to lines without a payload.
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
    """The kinds of faults, with their opportunities."""

    BUSY = "busy"
    """A sending command is answered BUSY, and not executed."""
    LOST_REPLY = "lost_reply"
    """A reply is omitted."""
    STARRED = "starred"
    """An `OK` becomes `[*]OK`."""
    EFAULT = "efault"
    """`ERROR EFAULT` comes before a reply."""
    LATE = "late"
    """A notification is late by at most `late_s`, after those that follow it."""
    DUPLICATE = "duplicate"
    """A received instant message is reported twice."""
    LOST_ACK = "lost_ack"
    """A received acknowledgement is not decoded."""
    GARBAGE = "garbage"
    """Noise on the line before a message."""
    HALF_LINE = "half_line"
    """A message ends in the middle; its rest is lost."""
    WRONG_LENGTH = "wrong_length"
    """The length that a received message announces is wrong."""
    CORRUPT = "corrupt"
    """Bits of a message are flipped."""
    PIECES = "pieces"
    """A message reaches the host byte by byte."""
    STALE = "stale"
    """A new connection begins with the end of an older message."""
    DROP_CONNECTION = "drop_connection"
    """A TCP connection is closed after the host has sent something."""
    RESET = "reset"
    """The modem restarts after the host has sent something."""


class ScriptedFault(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A fault at an instant."""

    kind: FaultKind
    """Kind of the fault."""
    at_s: float
    """Its beginning, s since the start."""
    modem: int = 0
    """Address of the modem in the scenario; 0: each of them."""
    count: int = 1
    """Number of opportunities; ignored with `lasts_s`."""
    lasts_s: float | None = None
    """It happens at all opportunities within this time, s."""

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
    """All faults."""

    seed: int = 1
    """Seed of every draw."""
    from_s: float = 0.0
    """Begin of the rates, s since the start."""
    until_s: float = 1e9
    """End of the rates, s."""
    rates: Mapping[FaultKind, float] = {}
    """Probability of each kind, 0…1."""
    late_s: float = 2.0
    """Largest delay of a late notification, s."""
    spares_payloads: bool = False
    """Records with a payload are not damaged."""
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
"""No fault."""
TIMED: Final = (FaultKind.DROP_CONNECTION, FaultKind.RESET)
"""Kinds that happen at a scripted instant, without an opportunity."""
DAMAGING: Final = (FaultKind.HALF_LINE, FaultKind.WRONG_LENGTH, FaultKind.CORRUPT)
"""Kinds that change the bytes of a message."""


def plan_from_mapping(mapping: object, *, source: str) -> FaultPlan:
    """Convert a parsed file of faults.

    Raises:
        ConfigError: One line: the file and the fault in it.
    """
    try:
        return msgspec.convert(mapping, FaultPlan)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{source}: {error}") from None


class Misfortune:
    """Decides the faults of one modem.

    Args:
        plan: All faults.
        node: Address of the modem in the scenario.
    """

    def __init__(self, plan: FaultPlan, node: int) -> None:
        self.rng = random.Random(f"zacoustic/faults/{plan.seed}/{node}")
        self._plan = plan
        self._rates_hold = range(seconds_to_ns(plan.from_s), seconds_to_ns(plan.until_s))
        self._script = [_Pending(each) for each in plan.script if each.modem in (0, node)]

    def strikes(self, kind: FaultKind, now: int) -> bool:
        """Tell whether a fault happens at this opportunity."""
        # Check the script first, but always draw: a script must not change the random faults.
        rate = self._plan.rates.get(kind, 0.0) if now in self._rates_hold else 0.0
        is_drawn = rate > 0.0 and self.rng.random() < rate
        is_scripted = any(each.take(kind, now) for each in self._script)
        return is_scripted or is_drawn

    def damages(self, kind: FaultKind, now: int, *, has_payload: bool) -> bool:
        """Tell whether a message gets this damage."""
        assert kind in DAMAGING
        return self.strikes(kind, now) and not (has_payload and self._plan.spares_payloads)

    def timed_at(self) -> list[int]:
        """Return the instants of faults without an opportunity, ns."""
        pending = (each for each in self._script if each.left and each.fault.kind in TIMED)
        return [each.from_ns for each in pending]

    def take_timed(self, now: int) -> list[FaultKind]:
        """Return the faults without an opportunity that are due now."""
        pending = (each for each in self._script if each.fault.kind in TIMED)
        return [each.fault.kind for each in pending if each.take(each.fault.kind, now)]

    def late_ns(self) -> int:
        """Draw the delay of a late notification, ns."""
        return seconds_to_ns(self._plan.late_s * self.rng.random())

    def garbage(self) -> bytes:
        """Draw noise on the line: bytes without a line feed, then one."""
        count = 1 + int(self.rng.random() * 24)
        noise = bytes(int(self.rng.random() * 256) for _ in range(count))
        return noise.replace(b"\n", b"?").replace(b"+", b"?") + b"\r\n"

    def cut(self, content: bytes) -> bytes:
        """Return a message cut at a drawn place."""
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
