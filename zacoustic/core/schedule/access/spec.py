"""The medium access settings of the config, key `access`: a policy with its parameters.

The records check what can be checked without the link; `zacoustic.core.schedule.access.choose`
checks what depends on the link's capabilities. Every error states the key, the value, and why the
choice cannot work.
"""

from typing import Annotated, Final, TypeAlias

import msgspec
from msgspec import Meta

from zacoustic.core.base.clock import (
    LONGEST_S,
    NS_PER_S,
    Duration,
    DurationOrZero,
    seconds_to_ns,
)
from zacoustic.core.base.linktypes import Node, Nodes
from zacoustic.errors import ConfigError
from zacoustic.text.allowed import check_fields

SLOWEST_SOUND_M_S: Final = 1400.0
"""Slower than sound in any sea or lake, so a guard computed with it holds everywhere."""
# The drift of a cheap oscillator, temperature included.
_DRIFT_PPM: Final = 50.0
_STATEMENTS_S: Final = 10.0
"""A host states its time at least this often, s (`Engine.handle_clock`)."""
_MOST_SLOTS: Final = 1024
MOST_RANGE_M: Final = 100_000.0
"""Sound takes over a minute for more, m."""
_CLOCK_HINT: Final = "how wrong may the clock of a node be? NTP at the surface: 0.01"
_ClockError: TypeAlias = Annotated[DurationOrZero, Meta(extra={"hint": _CLOCK_HINT})]
_Drift: TypeAlias = Annotated[float, Meta(ge=0, le=LONGEST_S)]
_Range: TypeAlias = Annotated[float, Meta(gt=0, le=LONGEST_S, title="metres")]
_COUNT: Final = Meta(min_length=1, max_length=_MOST_SLOTS)


class DelegatedSpec(
    msgspec.Struct,
    frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="method", tag="delegated",
):  # fmt: skip
    """The modem, or what is behind it, controls access."""


class AlohaSpec(
    msgspec.Struct,
    frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="method", tag="aloha",
):  # fmt: skip
    """A frame goes when it is due."""

    slot_s: Duration | None = None
    """Frames start at multiples of this in UTC, s; None: at any instant."""
    back_off: bool = True
    """Whether to wait a random time that doubles after each frame without any answer."""

    def __post_init__(self) -> None:
        """Check the slot.

        Raises:
            ConfigError: States key, value and what is allowed.
        """
        check_fields(self, ConfigError)


class CarrierSenseSpec(
    msgspec.Struct,
    frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="method", tag="carrier_sense",
):  # fmt: skip
    """A frame waits while another node is heard, and then a random time."""


class TimedSlot(msgspec.Struct, frozen=True):
    """One slot of a cycle, as a policy plays it."""

    owners: tuple[int, ...]
    """Addresses of the nodes that may transmit in it; empty: of every node that owns no slot."""
    window_ns: int
    """How long they may transmit, ns."""
    guard_ns: int
    """The silence after that, ns."""


class ClockedSpec(msgspec.Struct, frozen=True, kw_only=True):
    """What every policy with slots says of the common clock."""

    clock_error_s: _ClockError
    """Largest error of a node's clock against the common one, s; a node whose error may be
    larger keeps silent."""
    clock: Node | None = None
    """The node whose clock is the common one, sent in its frames; None: UTC from each host."""
    beacon_s: Duration | None = None
    """How often that node sends the time when it has nothing else to send, s; None: only in
    frames that go anyway."""
    drift_ppm: _Drift = _DRIFT_PPM
    """Drift of a clock without statements, 1e-6."""

    @property
    def error_limit_ns(self) -> int:
        """Error beyond which a node keeps silent, ns.

        It is the stated error plus the drift from one statement of the host to the next.
        """
        return seconds_to_ns(self.clock_error_s + _STATEMENTS_S * self.drift_ppm * 1e-6)

    @property
    def timed_slots(self) -> tuple[TimedSlot, ...]:
        """The slots of a cycle."""
        raise NotImplementedError

    def has_slot(self, address: int) -> bool:
        """Return whether a node may transmit in any slot."""
        return any(address in slot.owners or not slot.owners for slot in self.timed_slots)

    def _guard_ns(self, distance_m: float) -> int:
        """Return the propagation delay, and twice the clock error, ns."""
        return seconds_to_ns(distance_m / SLOWEST_SOUND_M_S) + 2 * self.error_limit_ns

    def _check_clock(self) -> None:
        check_fields(self, ConfigError)
        if self.beacon_s is not None and self.clock is None:
            raise ConfigError(
                "beacon_s: without clock; allowed: where clock names the node that tells it"
            )


class TdmaSpec(
    ClockedSpec,
    frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="method", tag="tdma",
):  # fmt: skip
    """Each node transmits in its slots of a common clock, which are all equally long."""

    slots: Annotated[Nodes, _COUNT]
    """Address of the owner of each slot, in order; an address may own several."""
    slot_s: Duration
    """Length of a slot, s; slots begin at multiples of the cycle since 1970 (UTC)."""
    max_range_m: _Range | None = None
    """Largest distance between two nodes, m; alternative to `guard_s`."""
    guard_s: Duration | None = None
    """Silence at the end of each slot, s; None: computed from `max_range_m`."""

    def __post_init__(self) -> None:
        """Check each value, and that the guard leaves a part of the slot.

        Raises:
            ConfigError: States key, value and what is allowed.
        """
        self._check_clock()
        if (self.guard_s is None) == (self.max_range_m is None):
            both = "beside max_range_m" if self.guard_s is not None else "is missing"
            raise ConfigError(f"guard_s: {both}; allowed: exactly one of guard_s and max_range_m")
        if self.guard_s is not None and self.guard_ns <= 2 * self.error_limit_ns:
            raise ConfigError(
                f"guard_s: {self.guard_s:g} s leaves no time for sound to travel beside twice the "
                f"clock error; allowed: above {2 * self.error_limit_ns / NS_PER_S:g}"
            )
        if self.guard_ns >= seconds_to_ns(self.slot_s):
            raise ConfigError(
                f"slot_s: {self.slot_s:g} s is not more than its guard of "
                f"{self.guard_ns / NS_PER_S:.3f} s",
                hint="make the slots longer, or the range or the clock error smaller",
            )

    @property
    def guard_ns(self) -> int:
        """Silence at the end of each slot, ns: propagation delay, and twice the clock error."""
        if self.guard_s is not None:
            return seconds_to_ns(self.guard_s)
        assert self.max_range_m is not None
        return self._guard_ns(self.max_range_m)

    @property
    def timed_slots(self) -> tuple[TimedSlot, ...]:
        """The slots of a cycle."""
        window_ns = seconds_to_ns(self.slot_s) - self.guard_ns
        return tuple(TimedSlot((owner,), window_ns, self.guard_ns) for owner in self.slots)


class ScheduledSlot(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One slot of a schedule."""

    owners: Nodes
    """Addresses of the nodes that may transmit in it; several where no node hears two of them;
    empty: nodes that own no slot, each in about every second cycle."""
    for_s: Duration
    """How long they may transmit, s."""
    range_m: Annotated[float, Meta(ge=0, le=MOST_RANGE_M, title="metres")]
    """Largest distance from one of them to one of the next slot, m."""

    def __post_init__(self) -> None:
        """Check each value.

        Raises:
            ConfigError: States key, value and what is allowed.
        """
        check_fields(self, ConfigError)


class ScheduleSpec(
    ClockedSpec,
    frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="method", tag="schedule",
):  # fmt: skip
    """Each node transmits in its slots of a common clock; each slot is as long as it needs.

    A slot's guard covers only the distance to the nodes of the next slot. By the triangle
    inequality its frames have then passed every node before those of the next slot arrive there.
    """

    slots: Annotated[tuple[ScheduledSlot, ...], _COUNT]
    """The slots of a cycle, in order; a node may own several."""

    def __post_init__(self) -> None:
        """Check each value.

        Raises:
            ConfigError: States key, value and what is allowed.
        """
        self._check_clock()

    @property
    def timed_slots(self) -> tuple[TimedSlot, ...]:
        """The slots of a cycle."""
        return tuple(
            TimedSlot(slot.owners, seconds_to_ns(slot.for_s), self._guard_ns(slot.range_m))
            for slot in self.slots
        )

    @property
    def cycle_s(self) -> float:
        """Length of a cycle, s."""
        return sum(slot.window_ns + slot.guard_ns for slot in self.timed_slots) / NS_PER_S


class AutoSpec(
    msgspec.Struct,
    frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="method", tag="auto",
):  # fmt: skip
    """A schedule while the clock is good, else what needs no clock; without slots, only that."""

    slots: tuple[ScheduledSlot, ...] = ()
    """The slots of a cycle, in order; empty: there is no schedule."""
    clock_error_s: _ClockError | None = None
    """Largest error of a node's clock against the common one, s; required with slots."""
    clock: Node | None = None
    """The node whose clock is the common one, sent in its frames; None: UTC from each host."""
    beacon_s: Duration | None = None
    """How often that node sends the time when it has nothing else to send, s; None: only in
    frames that go anyway."""
    drift_ppm: _Drift = _DRIFT_PPM
    """Drift of a clock without statements, 1e-6."""

    def __post_init__(self) -> None:
        """Check each value, and that there is a schedule for what belongs to one.

        Raises:
            ConfigError: States key, value and what is allowed.
        """
        check_fields(self, ConfigError)
        if self.schedule is not None:
            return
        for key, value in (
            ("clock_error_s", self.clock_error_s), ("clock", self.clock),
            ("beacon_s", self.beacon_s),
        ):  # fmt: skip
            if value is not None:
                raise ConfigError(f"{key}: {value:g} without slots; allowed: beside slots")

    @property
    def schedule(self) -> ScheduleSpec | None:
        """The schedule; None: the file has none.

        Raises:
            ConfigError: It is wrong; states key, value and what is allowed.
        """
        if not self.slots:
            return None
        if self.clock_error_s is None:
            raise ConfigError(
                "clock_error_s: is missing, and slots need clocks whose error is known; "
                "allowed: seconds, 0 or more",
                hint=_CLOCK_HINT,
            )
        return ScheduleSpec(
            slots=self.slots,
            clock_error_s=self.clock_error_s,
            clock=self.clock,
            beacon_s=self.beacon_s,
            drift_ppm=self.drift_ppm,
        )


class PollingSpec(
    msgspec.Struct,
    frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="method", tag="polling",
):  # fmt: skip
    """One node gives each of the others its turn."""

    poller: Node
    """Address of the node that polls."""
    nodes: Annotated[Nodes, Meta(min_length=1)]
    """Addresses of the others in the order of their turns."""
    turn_s: Annotated[float, Meta(gt=0, le=5.1, title="seconds")] | None = None
    """Length of a turn, s; None: two of the largest frames."""
    idle_s: DurationOrZero = 10.0
    """Pause after a round in which no node had anything to send, s."""
    max_range_m: _Range | None = None
    """Largest distance to the poller, m; None: as the link states."""

    def __post_init__(self) -> None:
        """Check each value.

        Raises:
            ConfigError: States key, value and what is allowed.
        """
        check_fields(self, ConfigError)
        if self.poller in self.nodes:
            raise ConfigError(
                f"nodes: {self.poller} is the poller; allowed: the other nodes, each in its turn"
            )


AccessSpec: TypeAlias = (
    AlohaSpec | CarrierSenseSpec | TdmaSpec | ScheduleSpec | PollingSpec | DelegatedSpec | AutoSpec
)


def slots_of(access: AccessSpec | None) -> ClockedSpec | None:
    """Return the slots that a node with these settings uses while its clock is good, or None."""
    if isinstance(access, AutoSpec):
        return access.schedule
    return access if isinstance(access, ClockedSpec) else None
