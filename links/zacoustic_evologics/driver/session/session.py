"""State of the modem and of others, and counters; takes no action.

Readings of another modem are those of the last exchange with it.
"""

import random
from typing import Final

from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.linktypes import BulkService, LinkCapabilities, TransmitOutcome
from zacoustic_evologics.airtime import (
    BIT_RATE_BPS,
    BURST_RATES_BPS,
    GAP_S,
    PREAMBLE_S,
    TURNAROUND_NS,
)
from zacoustic_evologics.at.fields import BURST_LIMIT_BYTES, CLOCK_SPAN_US, IM_LIMIT_BYTES
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.at.settings import KEYS, SOURCE_LEVELS_DB
from zacoustic_evologics.at.usbl import UsblAngles, UsblLong
from zacoustic_evologics.config import IN_AIR_SOURCE_LEVEL, EvologicsConfig

RESTART_LEAST_NS: Final = NS_PER_S
"""A modem takes longer than this to restart: drivers give it 5 s, and one found 2 s too short."""
CLOCK_ERROR_NS: Final = 3 * NS_PER_S // 10
"""Largest error of the modem's clock when it is read, ns."""
CLOCK_DRIFT: Final = 10_000
"""It may drift by the passed time divided by this: 100 ppm."""
CLOCK_TRUST_NS: Final = 30 * NS_PER_S
"""No message is later than this, ns."""

BURSTS_GO_ON_S: Final = 4.0
"""After burst data of another modem, for how long more of them are expected, s."""

MOST_OUTSTANDING: Final = 32
"""Frames of burst data that the driver takes; those for which the modem has no room wait in it."""
_BULK: Final = BulkService(
    mtu_bytes=BURST_LIMIT_BYTES,
    bit_rate_bps=float(BURST_RATES_BPS[1]),
    preamble_s=0.1,
    most_outstanding=MOST_OUTSTANDING,
    rides_back=True,
    overtakes=True,
)
"""Burst data. Its bit rate is the middle one of three that captures have. The modem's buffer holds
16 KiB as it is delivered; the driver keeps what it has no room for. A piggyback message goes with
the acknowledgement of a train."""
RANGE_METRICS: Final = frozenset({"propagation_s", "range_m", "received_level_db", "integrity"})
"""Values measured in an exchange."""
USBL_METRICS: Final = RANGE_METRICS | {
    "east_m", "north_m", "up_m", "accuracy_m", "bearing_rad", "elevation_rad", "accuracy_rad",
}  # fmt: skip
"""Values measured by a USBL head."""


class PeerReadings:
    """Measurements of one other modem."""

    def __init__(self) -> None:
        self.values: dict[str, float] = {}


class ModemSession:
    """The known state of one modem.

    Args:
        config: Settings of the driver.
        node_address: Address of this node.
    """

    def __init__(self, config: EvologicsConfig, node_address: int) -> None:
        self.config = config
        self.node_address = node_address
        self.rng = random.Random(f"zacoustic/evologics/driver/{node_address}")
        """For pauses; it is enough that nodes differ."""
        self.interpreter = Interpreter.NET
        self.firmware = ""
        self.address = 0
        self.highest_address = 254
        self.source_level: int | None = None
        self.source_level_control: int | None = None
        self.gain: int | None = None
        self.retries: int | None = None
        self.sound_speed_m_s: int | None = None
        self.battery_v: float | None = None
        self.clock_us: int | None = None
        self.clock_read_at = 0
        self.heard_at = 0
        """When the modem last sent something, ns."""
        self.may_repeat = True
        """It may have restarted since `retries` was read or set, and then repeats by default."""
        self.has_extended_notifications = False
        self.has_usbl = False
        self.changes: list[str] = []
        """Settings changed at the last start, in words."""
        self.needs_clearing = False
        """A filler was sent; in data mode it waits in the buffer."""
        self._bursts_from = 0, 0
        self.answer_owed: tuple[int, int] | None = None
        """Node that the modem will acknowledge, and the instant before which it does not begin."""
        self.tells_answers = False
        """The modem has reported the sound of its own acknowledgement."""
        self.has_piggyback = False
        """The modem may hold a piggyback message."""
        self.has_bursts = False
        """The modem has burst data of the bulk service."""
        self.had_bursts_until: int | None = None
        """When it had some last, if it has none, ns; None: it never had."""
        self.may_fill = True
        """The probe may use its filler: it has not, since the modem last answered."""
        self.counts: dict[str, int] = {}
        self.readings: dict[str, float] = {}
        self._peers: dict[int, PeerReadings] = {}

    def count(self, name: str, by: int = 1) -> None:
        """Increment a counter of `diagnostics`."""
        self.counts[name] = self.counts.get(name, 0) + by

    def count_outcome(self, outcome: TransmitOutcome) -> None:
        """Count the outcome of a transmission."""
        self.count(outcome.value)

    @property
    def acknowledges(self) -> bool:
        """The other modem can be asked for an acknowledgement, and is asked once for each frame."""
        repeats_as_told = self.retries in (None, self.config.retries)
        return self.config.service not in ("ims", "pbm") and repeats_as_told

    @property
    def has_bulk(self) -> bool:
        """Frames above an instant message go as burst data of a service of their own."""
        return self.config.has_bulk

    def hear(self, now: int) -> None:
        """Note that the modem sends something, perhaps after a restart."""
        self.may_repeat |= self._has_been_silent(now)
        self.heard_at = now

    def must_set_retries(self, now: int) -> bool:
        """Tell whether `retries` must be set before a message with acknowledgement."""
        return self.retries is not None and (self.may_repeat or self._has_been_silent(now))

    def capabilities(self) -> LinkCapabilities:
        """Return the capabilities; with a larger `mtu`, longer frames go as burst data."""
        long_above = IM_LIMIT_BYTES if self.config.mtu > IM_LIMIT_BYTES else None
        if self.config.service == "burst":
            long_above = 0
        return LinkCapabilities(
            mtu_bytes=self.config.mtu,
            bit_rate_bps=BIT_RATE_BPS,
            preamble_s=PREAMBLE_S,
            gap_s=GAP_S,
            propagation_s=self.config.propagation_s,
            half_duplex=True,
            addressed=True,
            checked=not self.config.check,
            framed=True,
            acknowledges=self.acknowledges,
            controls_access=False,
            senses_carrier=self.has_extended_notifications,
            broadcast_mtu_bytes=min(self.config.mtu, IM_LIMIT_BYTES),
            address_range=(1, self.highest_address),
            reports=frozenset({"received_level_db", "integrity", "range_rate_m_s"}),
            measures=self._measures(),
            measures_range=self.acknowledges,
            long_above_bytes=long_above,
            long_bit_rate_bps=_BULK.bit_rate_bps,
            long_preamble_s=_BULK.preamble_s,
            bulk=_BULK if self.has_bulk else None,
        )

    def note_owed(self, address: int, now: int) -> None:
        """Note that the modem is about to acknowledge a message of another one."""
        self.answer_owed = address, now + TURNAROUND_NS

    def note_answering(self, address: int) -> None:
        """Note that the modem has begun to send to another one."""
        if self.answer_owed is not None and self.answer_owed[0] == address:
            self.tells_answers = True
        self.answer_owed = None

    def note_burst(self, address: int, now: int) -> None:
        """Note that burst data of another one have come: its modem probably has more."""
        self._bursts_from = address, now + seconds_to_ns(BURSTS_GO_ON_S)

    def note_own_bursts(self, *, has_bursts: bool, now: int) -> None:
        """Note whether the modem has burst data of the bulk service."""
        if self.has_bursts and not has_bursts:
            self.had_bursts_until = now
        self.has_bursts = has_bursts

    def is_receiving_bursts(self, address: int, now: int) -> bool:
        """Tell whether another one is sending burst data, each train of which is acknowledged."""
        source, until = self._bursts_from
        return source == address and now < until

    def is_about_to_answer(self, address: int, now: int) -> bool:
        """Tell whether the modem is about to acknowledge a message of another one."""
        to, until = self.answer_owed or (0, 0)
        return to == address and now < until

    def _measures(self) -> frozenset[str]:
        """Values that the modem may report of another one besides frames."""
        told = RANGE_METRICS if self.acknowledges else frozenset()
        return told | USBL_METRICS if self.has_usbl else told

    def description(self) -> str:
        """One line for people, with the changed settings and the source level."""
        parts = [f"S2C firmware {self.firmware or 'unknown'} ({self.interpreter.value})"]
        parts.append(f"address {self.address} of {self.highest_address}")
        if self.source_level is not None:
            air = ", for air" if self.source_level == IN_AIR_SOURCE_LEVEL else ""
            level_db = SOURCE_LEVELS_DB[self.source_level]
            parts.append(f"source level {self.source_level} ({level_db:g} dB{air})")
        if self.changes:
            parts.append("set " + ", ".join(self.changes))
        return ", ".join(parts)

    def note_setting(self, name: str, value: int | None) -> None:
        """Note the value of a setting, by its name in the commands."""
        setattr(self, KEYS[name], value)

    def note_delay(self, address: int, delay_us: int) -> None:
        """Note a measured propagation delay; 0 or less: none."""
        if delay_us <= 0:
            return
        values = self._peer(address).values
        values["propagation_s"] = delay_us / 1e6
        if (range_m := self.range_m(delay_us / 1e6)) is not None:
            values["range_m"] = range_m

    def was_before(self, clock_us: int, instant: int, now: int) -> bool:
        """Tell whether something happened before an instant, and not long before.

        A clock value older than `CLOCK_TRUST_NS` belongs to another clock than `AT?CLOCK` reads.

        Args:
            clock_us: The modem's clock at that time.
            instant: The instant to compare with, ns.
            now: The present instant, ns.
        """
        if self.clock_us is None:
            return False
        passed_ns = now - self.clock_read_at
        ago_us = (self.clock_us + passed_ns // 1000 - clock_us) % CLOCK_SPAN_US
        error_ns = CLOCK_ERROR_NS + passed_ns // CLOCK_DRIFT
        is_of_that_clock = ago_us * 1000 < CLOCK_TRUST_NS + error_ns
        return is_of_that_clock and now - ago_us * 1000 + error_ns < instant

    def range_m(self, propagation_s: float | None) -> float | None:
        """Return the distance that sound travels in that time, m, by the modem's sound speed."""
        if propagation_s is None or not self.sound_speed_m_s:
            return None
        return round(propagation_s * self.sound_speed_m_s, 3)

    def note_position(self, fix: UsblLong) -> None:
        """Note the position of another modem."""
        self.note_delay(fix.address, fix.propagation_us)
        self._peer(fix.address).values |= {
            "east_m": fix.east_m,
            "north_m": fix.north_m,
            "up_m": fix.up_m,
            "accuracy_m": fix.accuracy_m,
        }

    def note_angles(self, fix: UsblAngles) -> None:
        """Note the direction of another modem, if the head knows it."""
        if fix.accuracy_rad < 0:
            return
        self._peer(fix.address).values |= {
            "bearing_rad": fix.bearing_rad,
            "elevation_rad": fix.elevation_rad,
            "accuracy_rad": fix.accuracy_rad,
        }

    def diagnostics(self) -> dict[str, int | float | str]:
        """Return counters and readings; those of another modem are named `peer_<address>_…`."""
        known = {
            "firmware": self.firmware,
            "interpreter": self.interpreter.value,
            "address": self.address,
            "highest_address": self.highest_address,
            "source_level": self.source_level,
            "gain": self.gain,
            "retries": self.retries,
            "sound_speed_m_s": self.sound_speed_m_s,
            "battery_v": self.battery_v,
            "modem_clock_us": self.clock_us,
            "changed": ", ".join(self.changes),
        }
        peers = {
            f"peer_{address}_{name}": value
            for address, peer in sorted(self._peers.items())
            for name, value in peer.values.items()
        }
        told = {name: value for name, value in known.items() if value is not None}
        return {**told, **self.readings, **peers, **self.counts}

    def _has_been_silent(self, now: int) -> bool:
        return now - self.heard_at >= RESTART_LEAST_NS

    def _peer(self, address: int) -> PeerReadings:
        return self._peers.setdefault(address, PeerReadings())
