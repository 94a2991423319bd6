"""What crosses between an engine and a link: capabilities, frames, reports, measurements.

A link tells the truth about itself in `LinkCapabilities`; the core adds exactly what is missing
(addresses, check, delimiting, medium access) and never asks which link it is. All records here
are frozen; instants are ns on the node's monotonic clock.
"""

import enum
from typing import Final, TypeAlias

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.errors import ConfigError

BROADCAST: Final = 255
"""Destination address that every node hears. Node addresses are 1…254; 0 means unknown."""
ONE_LINK: Final = "link"
"""Name of the link of a node that has one and gives it no name."""
UNKNOWN_SOURCE: Final = 0
"""In place of the address of a sender that neither the link nor the frame names."""


class LinkState(enum.Enum):
    """The state of a link; it reconnects on its own."""

    OPENING = "opening"
    """Connecting, or waiting for the device."""
    UP = "up"
    """Frames can be given to `transmit`."""
    DOWN = "down"
    """The device or the connection is gone; the link keeps trying."""


class TransmitOutcome(enum.Enum):
    """How a transmission ended."""

    SENT = "sent"
    """On the air completely; whether anybody heard it is unknown."""
    DELIVERED = "delivered"
    """The modem at the other end has it. Steers retransmission; never a publisher's outcome."""
    NOT_DELIVERED = "not_delivered"
    """On the air, and the other modem did not acknowledge it."""
    REJECTED = "rejected"
    """Never on the air: too large, bad address, refused by the modem."""
    ABORTED = "aborted"
    """Cut short by a reset, a closed port or a loss of the connection; may or may not have been
    on the air."""


class LinkCapabilities(msgspec.Struct, frozen=True, kw_only=True):
    """What a link can do; valid after it has opened."""

    mtu_bytes: int
    """Largest frame that `transmit` accepts, bytes, ≥ 8, and more where the core has to add
    addresses (2), a check (4) or delimiting (3)."""
    bit_rate_bps: float
    """Marginal bit rate: eight bits more take 8 / bit_rate_bps seconds longer, > 0."""
    preamble_s: float = 0.0
    """Airtime of a frame without any byte, s, ≥ 0."""
    gap_s: float = 0.0
    """Pause that the device needs after each frame before it can send the next, s, ≥ 0."""
    propagation_s: float = 1.0
    """Propagation delay to reckon with, one way, s, ≥ 0: what time-outs are derived from before
    one is measured."""
    half_duplex: bool = True
    """The device cannot receive while it transmits."""
    addressed: bool = True
    """Frames carry source and destination by themselves; otherwise the core adds two bytes."""
    checked: bool = True
    """Damaged frames do not arrive; otherwise the core adds a CRC."""
    framed: bool = True
    """One `transmit` arrives as one frame or not at all; otherwise a byte stream, which the core
    delimits."""
    acknowledges: bool = False
    """Reports DELIVERED or NOT_DELIVERED for a unicast transmission that asks for it."""
    controls_access: bool = False
    """The device, or one behind it, decides when it may transmit."""
    senses_carrier: bool = False
    """Reports `carrier_changed` while another node is heard."""
    broadcast_mtu_bytes: int | None = None
    """Largest frame for all nodes, bytes; None: as large as one for a single node."""
    address_range: tuple[int, int] = (1, 254)
    """First and last node address that the device can have."""
    reports: frozenset[str] = frozenset()
    """Which fields of `LinkMetrics` every received frame fills."""
    measures: frozenset[str] = frozenset()
    """Fields of `LinkMetrics` that the device may report besides, by `PeerMeasured`."""
    measures_range: bool = False
    """A transmission that was acknowledged is followed by a `PeerMeasured` of that exchange, with
    its propagation delay: so a range can be had on demand. Only where it `acknowledges`."""
    source_level_range_db: tuple[float, float] | None = None
    """Lowest and highest source level, dB re 1 µPa at 1 m, where it can be set."""

    def __post_init__(self) -> None:
        """Check what no link may claim.

        Raises:
            ConfigError: Its frames are too short.
            ValueError: Another value outside its range.
        """
        # A frame must hold a HELLO, 8 bytes, inside of what the core adds for the link.
        lacking = {2: self.addressed, 4: self.checked, 3: self.framed}
        least = 8 + sum(size_bytes for size_bytes, is_there in lacking.items() if not is_there)
        if self.mtu_bytes < least:  # a link may have it from its config, or from the modem
            raise ConfigError(
                f"mtu_bytes is {self.mtu_bytes}; allowed: at least {least}",
                hint="raise the mtu of the link, or use another one",
            )
        if not self.bit_rate_bps > 0:
            raise ValueError(f"bit_rate_bps is {self.bit_rate_bps}; allowed: above 0")
        low, high = self.address_range
        if not 1 <= low <= high <= 254:
            raise ValueError(f"address_range is {self.address_range}; allowed: within 1..254")
        if self.measures_range and not self.acknowledges:
            raise ValueError("measures_range is True; allowed: only where the link acknowledges")

    def airtime_ns(self, frame_bytes: int) -> int:
        """Airtime of a frame of that many bytes, ns: preamble and bits, without the gap."""
        return seconds_to_ns(self.preamble_s + frame_bytes * 8 / self.bit_rate_bps)


class LinkMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """A modem's measurements of another one, on a frame or besides; None if unknown."""

    snr_db: float | None = None
    """Signal-to-noise ratio, dB."""
    received_level_db: float | None = None
    """Received level, dB; the reference is the modem's own unless its link names one."""
    integrity: float | None = None
    """Signal quality in the modem's own scale."""
    propagation_s: float | None = None
    """Propagation delay, one way, s."""
    range_rate_m_s: float | None = None
    """Relative velocity, m/s, positive when the distance grows."""
    range_m: float | None = None
    """Slant distance, m: the propagation delay by the sound speed that the device is set to."""
    east_m: float | None = None
    """Where it is, seen from here: towards the east, m. The three come together."""
    north_m: float | None = None
    """Towards the north, m."""
    up_m: float | None = None
    """Upwards, m: negative where it is deeper."""
    accuracy_m: float | None = None
    """Uncertainty of that position, m, by the device."""
    bearing_rad: float | None = None
    """Direction of its sound, rad, 0…2π: 0 is north, π/2 east. Comes with the elevation."""
    elevation_rad: float | None = None
    """Direction above the horizontal, rad, -π/2…π/2."""
    accuracy_rad: float | None = None
    """Uncertainty of that direction, rad, by the device."""


class PeerMeasured(msgspec.Struct, frozen=True, kw_only=True):
    """A modem has measured another one, outside of any frame."""

    address: int
    """The other node, 1…254."""
    measured_at: int
    """Instant of the measurement, ns: when the sound that it was made on had ended. What is told
    later keeps this instant."""
    metrics: LinkMetrics
    """What was measured."""


class ModemRead(msgspec.Struct, frozen=True, kw_only=True):
    """A modem's values of itself; None if unknown."""

    read_at: int
    """Instant of the answer, ns."""
    firmware: str = ""
    """Its version, in the vendor's words."""
    battery_v: float | None = None
    """Supply, V."""
    source_level_db: float | None = None
    """Source level, dB re 1 µPa at 1 m, where the device knows it."""
    relative_source_level_db: float | None = None
    """Source level against the loudest that the device can, dB, at most 0."""


Measurement: TypeAlias = PeerMeasured | ModemRead
"""Unsolicited reports of a link."""


class ReceivedFrame(msgspec.Struct, frozen=True, kw_only=True):
    """A frame, or for a link without frames a piece of the byte stream, that arrived."""

    frame_bytes: bytes
    """What arrived, without anything that the link itself added."""
    received_at: int
    """Instant at which the last byte had arrived, ns."""
    source: int = 0
    """Address of the sender, 0 when the link does not carry addresses."""
    destination: int = BROADCAST
    """Address it was sent to, `BROADCAST` when unknown."""
    metrics: LinkMetrics = LinkMetrics()
    """What the modem measured."""


class Transmission(msgspec.Struct, frozen=True, kw_only=True):
    """One frame that an engine asks its link to transmit."""

    transmission_id: int
    """Identifies the report, counted by the engine for each link."""
    frame_bytes: bytes
    """The frame, 1…mtu_bytes bytes."""
    destination: int = BROADCAST
    """Address, or `BROADCAST`."""
    acknowledge: bool = False
    """Ask the modem for an acknowledgement; only where `LinkCapabilities.acknowledges`."""
    link: str = ONE_LINK
    """Name of the link that transmits it."""


class TransmitReport(msgspec.Struct, frozen=True, kw_only=True):
    """How a transmission ended: exactly one for each."""

    transmission_id: int
    """The transmission that it is about."""
    outcome: TransmitOutcome
    """How it ended."""
    started_at: int
    """First bit on the air, or the call of `transmit` if there was none, ns."""
    finished_at: int
    """End of the transmission or of the attempt, ns; not before `started_at`."""
    detail: str = ""
    """The modem's own words, or the reason of a rejection."""
