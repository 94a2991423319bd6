"""The medium access settings of the config, key `access`: a policy with its parameters.

The records check what can be checked without the link; `zacoustic.core.schedule.access.choose`
checks what depends on the link's capabilities. Every error states the key, the value, and why the
choice cannot work.
"""

import math
from collections.abc import Sized
from typing import Final, TypeAlias

import msgspec

from zacoustic.core.base.clock import DURATIONS, NS_PER_S, is_duration, seconds_to_ns
from zacoustic.errors import ConfigError

SLOWEST_SOUND_M_S: Final = 1400.0
"""Slower than sound in any sea or lake, so a guard computed with it holds everywhere."""
# The drift of a cheap oscillator, temperature included.
_DRIFT_PPM: Final = 50.0
_STATEMENTS_S: Final = 10.0
"""A host states its time at least this often, s (`Engine.handle_clock`)."""
_MOST_SLOTS: Final = 1024
MOST_RANGE_M: Final = 100_000.0
"""Sound takes over a minute for more, m."""


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

    slot_s: float | None = None
    """Frames start at multiples of this in UTC, s, > 0; None: at any instant."""
    back_off: bool = True
    """Whether to wait a random time that doubles after each frame without any answer."""

    def __post_init__(self) -> None:
        """Check the slot.

        Raises:
            ConfigError: States key, value and what is allowed.
        """
        if self.slot_s is not None:
            _check_positive("slot_s", self.slot_s)


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

    clock_error_s: float
    """Largest error of a node's clock against the common one, s, ≥ 0; a node whose error may be
    larger keeps silent."""
    clock: int | None = None
    """The node whose clock is the common one, sent in its frames; None: UTC from each host."""
    beacon_s: float | None = None
    """How often that node sends the time when it has nothing else to send, s, > 0; None: only in
    frames that go anyway."""
    drift_ppm: float = _DRIFT_PPM
    """Drift of a clock without statements, 1e-6, ≥ 0."""

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
        _check_not_negative("clock_error_s", self.clock_error_s)
        _check_not_negative("drift_ppm", self.drift_ppm)
        if self.beacon_s is not None:
            _check_positive("beacon_s", self.beacon_s)
            if self.clock is None:
                raise ConfigError(
                    "beacon_s: without clock; allowed: where clock names the node that tells it"
                )


class TdmaSpec(
    ClockedSpec,
    frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="method", tag="tdma",
):  # fmt: skip
    """Each node transmits in its slots of a common clock, which are all equally long."""

    slots: tuple[int, ...]
    """Address of the owner of each slot, in order; an address may own several."""
    slot_s: float
    """Length of a slot, s, > 0; slots begin at multiples of the cycle since 1970 (UTC)."""
    max_range_m: float | None = None
    """Largest distance between two nodes, m, > 0; alternative to `guard_s`."""
    guard_s: float | None = None
    """Silence at the end of each slot, s, > 0; None: computed from `max_range_m`."""

    def __post_init__(self) -> None:
        """Check each value, and that the guard leaves a part of the slot.

        Raises:
            ConfigError: States key, value and what is allowed.
        """
        _check_count(self.slots)
        for index, address in enumerate(self.slots):
            if not 1 <= address <= 254:
                raise ConfigError(f"slots[{index}]: {address}; allowed: an address, 1..254")
        _check_positive("slot_s", self.slot_s)
        self._check_clock()
        if self.max_range_m is not None:
            _check_positive("max_range_m", self.max_range_m)
        if self.guard_s is not None:
            _check_positive("guard_s", self.guard_s)
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

    owners: tuple[int, ...]
    """Addresses of the nodes that may transmit in it; several where no node hears two of them;
    empty: nodes that own no slot, each in about every second cycle."""
    for_s: float
    """How long they may transmit, s, > 0."""
    range_m: float
    """Largest distance from one of them to one of the next slot, m, ≥ 0."""


class ScheduleSpec(
    ClockedSpec,
    frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="method", tag="schedule",
):  # fmt: skip
    """Each node transmits in its slots of a common clock; each slot is as long as it needs.

    A slot's guard covers only the distance to the nodes of the next slot. By the triangle
    inequality its frames have then passed every node before those of the next slot arrive there.
    """

    slots: tuple[ScheduledSlot, ...]
    """The slots of a cycle, in order; a node may own several."""

    def __post_init__(self) -> None:
        """Check each value.

        Raises:
            ConfigError: States key, value and what is allowed.
        """
        _check_count(self.slots)
        for index, slot in enumerate(self.slots):
            for address in slot.owners:
                if not 1 <= address <= 254:
                    raise ConfigError(
                        f"slots[{index}].owners: {address}; allowed: addresses, 1..254"
                    )
            _check_positive(f"slots[{index}].for_s", slot.for_s)
            if not (math.isfinite(slot.range_m) and 0 <= slot.range_m <= MOST_RANGE_M):
                raise ConfigError(
                    f"slots[{index}].range_m: {slot.range_m:g}; allowed: metres, 0 to "
                    f"{MOST_RANGE_M:g}"
                )
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
    clock_error_s: float | None = None
    """Largest error of a node's clock against the common one, s, ≥ 0; required with slots."""
    clock: int | None = None
    """The node whose clock is the common one, sent in its frames; None: UTC from each host."""
    beacon_s: float | None = None
    """How often that node sends the time when it has nothing else to send, s, > 0; None: only in
    frames that go anyway."""
    drift_ppm: float = _DRIFT_PPM
    """Drift of a clock without statements, 1e-6, ≥ 0."""

    def __post_init__(self) -> None:
        """Check each value, and that there is a schedule for what belongs to one.

        Raises:
            ConfigError: States key, value and what is allowed.
        """
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
            raise ConfigError("clock_error_s: is missing; allowed: seconds, 0 or more")
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

    poller: int
    """Address of the node that polls."""
    nodes: tuple[int, ...]
    """Addresses of the others in the order of their turns."""
    turn_s: float | None = None
    """Length of a turn, s, > 0, at most 5.1; None: two of the largest frames."""
    idle_s: float = 10.0
    """Pause after a round in which no node had anything to send, s, ≥ 0."""
    max_range_m: float | None = None
    """Largest distance to the poller, m, > 0; None: as the link states."""

    def __post_init__(self) -> None:
        """Check each value.

        Raises:
            ConfigError: States key, value and what is allowed.
        """
        if not self.nodes:
            raise ConfigError("nodes: nobody to poll; allowed: at least one address")
        for index, address in enumerate((self.poller, *self.nodes)):
            key = f"nodes[{index - 1}]" if index else "poller"
            if not 1 <= address <= 254:
                raise ConfigError(f"{key}: {address}; allowed: an address, 1..254")
        if self.poller in self.nodes:
            raise ConfigError(
                f"nodes: {self.poller} is the poller; allowed: the other nodes, each in its turn"
            )
        if self.turn_s is not None and not 0 < self.turn_s <= 5.1:
            raise ConfigError(f"turn_s: {self.turn_s:g}; allowed: above 0, at most 5.1")
        _check_not_negative("idle_s", self.idle_s)
        if self.max_range_m is not None:
            _check_positive("max_range_m", self.max_range_m)


AccessSpec: TypeAlias = (
    DelegatedSpec | AlohaSpec | CarrierSenseSpec | TdmaSpec | ScheduleSpec | AutoSpec | PollingSpec
)

METHODS: Final[dict[str, type[AccessSpec]]] = {
    "aloha": AlohaSpec,
    "carrier_sense": CarrierSenseSpec,
    "tdma": TdmaSpec,
    "schedule": ScheduleSpec,
    "polling": PollingSpec,
    "delegated": DelegatedSpec,
    "auto": AutoSpec,
}
"""The policies by their names in the config."""


def slots_of(access: AccessSpec | None) -> ClockedSpec | None:
    """Return the slots that a node with these settings uses while its clock is good, or None."""
    if isinstance(access, AutoSpec):
        return access.schedule
    return access if isinstance(access, ClockedSpec) else None


def _check_count(slots: Sized) -> None:
    if not 1 <= len(slots) <= _MOST_SLOTS:
        raise ConfigError(f"slots: {len(slots)} slots; allowed: 1..{_MOST_SLOTS}")


def _check_positive(key: str, value: float) -> None:
    if not is_duration(value):
        raise ConfigError(f"{key}: {value:g}; allowed: above 0, {DURATIONS}")


def _check_not_negative(key: str, value: float) -> None:
    if not is_duration(value, or_zero=True):
        raise ConfigError(f"{key}: {value:g}; allowed: 0 or more, {DURATIONS}")
