"""Shared by all parts of an emulated modem: settings, clocks, agenda, and the way to the ports.

There are three clocks: `now` of the caller, ns; the modem's clock, µs in 32 bits, from an arbitrary
start, which stamps signals and continues through a restart; the system clock, µs since the restart,
or set by `AT!UT`.
"""

import random
from collections import deque
from typing import Literal, TypeAlias

import msgspec

from zacoustic.channel.agenda import Agenda
from zacoustic.core.clock import seconds_to_ns
from zacoustic_evologics.airtime import ACKNOWLEDGEMENT_NS, BURST_RATES_BPS, TURNAROUND_NS
from zacoustic_evologics.at.fields import CLOCK_SPAN_US
from zacoustic_evologics.at.firmware import Firmware
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.at.messages import Noise, RawData
from zacoustic_evologics.at.notifications import Notification
from zacoustic_evologics.at.replies import CommandReply, PositionReply
from zacoustic_evologics.emulator.hardware.signals import Signal
from zacoustic_evologics.emulator.hardware.store import SettingsStore


class Behaviour(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Choices where sources disagree; a test may want others."""

    firmware: Firmware = "1.9"
    """Version of the firmware; see `at.firmware`."""

    second_im: Literal["busy", "cancel"] = "busy"
    """An instant message while another one is under way: BUSY, or it replaces the other."""
    while_receiving: Literal["busy", "wait"] = "busy"
    """An instant message during a reception: BUSY, or it is sent afterwards."""
    strict_control: bool = False
    """Settings require an earlier `AT@CTRL`; otherwise only if another port has sent it."""
    restart_s: float = 4.0
    """Duration of a restart by `ATZ0`, s."""
    burst_rates_bps: tuple[tuple[float, int], ...] = tuple(
        zip((30.0, 15.0, -1000.0), BURST_RATES_BPS, strict=True)
    )
    """Least SNR, dB, of each bit rate that a modem proposes for burst data, falling. The rates are
    from captures, the limits ours."""
    train_s: float = 2.0
    """Longest train of burst packets, s; one that would be longer has only one packet."""
    hold_s: float = 0.0
    """How long a connection without data stays, s."""
    backoff_share: float = 1.0
    """Longest back-off after a failed connection, in parts of the retry timeout."""
    im_in_train: Literal["taken", "queued", "refused"] = "taken"
    """An instant message while burst data are under way: it goes before the next train, or when the
    buffer is empty, or BUSY."""
    reach_s: float = 3500.0 / 1500.0
    """Longest propagation delay for which a modem waits, s; at least the published range."""


class Origin(msgspec.Struct, frozen=True):
    """The source of a command."""

    port_id: int
    """Port."""
    pid: int
    """Protocol id of the port."""
    interpreter: Interpreter
    """Interpreter of the port."""


Spoken: TypeAlias = Notification | CommandReply | Noise | RawData
"""A modem's message; a reply still without form."""


class Said(msgspec.Struct, frozen=True):
    """A message for the ports."""

    message: Spoken
    """The message."""
    port_id: int | None = None
    """The only port that gets it; None: all that want it."""


class WentDown(msgspec.Struct, frozen=True):
    """The modem restarts: its ports are closed."""


class CameUp(msgspec.Struct, frozen=True):
    """The modem has restarted."""


Output: TypeAlias = Said | WentDown | CameUp
"""Results of `poll_output`."""


class Measurements:
    """Measurements of the last signals; zero: none."""

    def __init__(self) -> None:
        self.propagation_us = 0
        self.rssi_db = 0
        self.integrity = 0
        self.velocity_m_s = 0.0
        self.local_bps = 0
        self.remote_bps = 0
        self.delivered_raw_bytes = 0
        self.dropped_bytes = 0
        self.body_position: PositionReply | None = None
        self.earth_position: PositionReply | None = None


class Chassis:
    """What the parts of one modem share.

    Args:
        store: Settings.
        behaviour: Choices where sources disagree.
        rng: Source of all randomness of the modem.
    """

    def __init__(self, store: SettingsStore, behaviour: Behaviour, rng: random.Random) -> None:
        self.store = store
        self.behaviour = behaviour
        self.rng = rng
        self.agenda = Agenda()
        self.outputs: deque[Output] = deque()
        self.signals: deque[Signal] = deque()
        self.measured = Measurements()
        self.started_at = 0
        self._clock_start_us = int(rng.random() * CLOCK_SPAN_US)
        self._unix_us: int | None = None
        self._number = 0

    @property
    def address(self) -> int:
        """Network address."""
        return self.store["AL"]

    @property
    def answer_wait_ns(self) -> int:
        """Time after a message within which its answer must begin to arrive, ns.

        No source states it. It must suffice for the farthest node, and not be below the retry
        timeout.
        """
        reach_ns = seconds_to_ns(2 * self.behaviour.reach_s)
        shortest_ns = reach_ns + TURNAROUND_NS + ACKNOWLEDGEMENT_NS // 2
        return max(shortest_ns, self.store["RT"] * 1_000_000)

    def clock_us(self, at: int) -> int:
        """Return the modem's clock at an instant."""
        return (self._clock_start_us + at // 1000) % CLOCK_SPAN_US

    def system_us(self, at: int) -> int:
        """Return the system clock at an instant."""
        running_us = (at - self.started_at) // 1000
        return max(0, running_us if self._unix_us is None else self._unix_us + at // 1000)

    def set_system_s(self, seconds: int, now: int) -> None:
        """Set the system clock."""
        self._unix_us = seconds * 1_000_000 - now // 1000

    def next_number(self) -> int:
        """Return the next number for an exchange."""
        self._number += 1
        return self._number

    def say(self, message: Spoken, port_id: int | None = None) -> None:
        """Output a message, to one port or to all that want it."""
        self.outputs.append(Said(message, port_id))

    def restart(self, at: int) -> None:
        """Discard the state that a restart loses."""
        self.agenda.clear()
        self.store.restart()
        self.measured = Measurements()
        self._unix_us = None
        self.started_at = at


def is_before(earlier_us: int, later_us: int) -> bool:
    """Compare two instants of a clock that wraps: half its span is past, half is future."""
    return 0 < (later_us - earlier_us) % CLOCK_SPAN_US < CLOCK_SPAN_US // 2
