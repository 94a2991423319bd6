"""What crosses between an engine and a link: capabilities, frames, reports, measurements.

A link describes itself truthfully in `LinkCapabilities`; the core adds exactly what is missing
(addresses, check, delimiting, medium access) and never asks which link it is. All records here are
frozen; instants are ns on the node's monotonic clock.
"""

import enum
from typing import Annotated, Final, TypeAlias

import msgspec
from msgspec import Meta

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.errors import ConfigError

BROADCAST: Final = 255
"""Destination address of all nodes. Node addresses are 1…254; 0 means unknown."""
ONE_LINK: Final = "link"
"""Name of the link of a node with a single, unnamed link."""
UNKNOWN_SOURCE: Final = 0
"""Stands for the address of a sender that neither the link nor the frame names."""
Address: TypeAlias = Annotated[int, Meta(ge=1, le=254, title="an address")]
"""Acoustic address of a node."""
Node: TypeAlias = Annotated[Address, Meta(title="the address of a node", extra={"refers": "nodes"})]
"""Address that names a node of the fleet."""
Nodes: TypeAlias = Annotated[tuple[Node, ...], Meta(title="a list of addresses of nodes")]
"""Several of them."""


MAX_FRAME_S: Final = 4.0
"""The longest airtime of a frame by default, s: nothing urgent waits longer for a frame under
way."""
LEAST_FRAME_BYTES: Final = 32
"""However slow a link is, its frames may have so many bytes: a sealed HELLO and its check."""


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
    """Transmitted completely; whether any node received it is unknown."""
    DELIVERED = "delivered"
    """The modem at the other end has it. This steers retransmission and is never a publisher's
    outcome."""
    NOT_DELIVERED = "not_delivered"
    """Transmitted, and the other modem did not acknowledge it."""
    REJECTED = "rejected"
    """Never transmitted: too large, bad address, refused by the modem."""
    ABORTED = "aborted"
    """Cut short by a reset, a closed port or a lost connection; perhaps transmitted in part or not
    at all."""


class Service(enum.Enum):
    """What a device offers to carry a frame; a link may offer more than one on one medium."""

    PLAIN = "plain"
    """One frame at a time, to one node or to all; every link has it."""
    BULK = "bulk"
    """Much data to one node, as `BulkService` describes."""


class BulkService(msgspec.Struct, frozen=True, kw_only=True):
    """A second service of a link, for much data to one node.

    The device makes and holds the connection that it needs, repeats what is lost, and has the other
    device acknowledge each frame: the link reports DELIVERED or NOT_DELIVERED for it, in whatever
    order. Frames of the plain service go meanwhile, as the device allows.
    """

    mtu_bytes: int
    """Largest frame, bytes, above that of the plain service."""
    bit_rate_bps: float
    """The bit rate to expect before any is known, > 0."""
    preamble_s: float = 0.0
    """The airtime that a frame takes beside its bits, s, ≥ 0."""
    most_outstanding: int = 8
    """How many frames the link takes before it has reported the first of them, 1…255."""

    rides_back: bool = False
    """Whether a frame to the sender, given at once when a frame of this service has arrived, goes
    with the device's acknowledgement, and so costs little."""
    overtakes: bool = False
    """Whether an urgent frame of the plain service may be given although another one is
    outstanding, while frames of this service are: it goes first."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ValueError: One is outside its range.
        """
        if not self.bit_rate_bps > 0:
            raise ValueError(f"bit_rate_bps is {self.bit_rate_bps}; allowed: above 0")
        if not 1 <= self.most_outstanding <= 255:
            raise ValueError(f"most_outstanding is {self.most_outstanding}; allowed: 1..255")

    def airtime_ns(self, frame_bytes: int) -> int:
        """Return the airtime to expect of a frame of that size, ns, without repetitions."""
        return seconds_to_ns(self.preamble_s + frame_bytes * 8 / self.bit_rate_bps)


class LinkCapabilities(msgspec.Struct, frozen=True, kw_only=True):
    """What a link can do; valid after it has opened."""

    mtu_bytes: int
    """Largest frame that `transmit` accepts, bytes, ≥ 8, and more where the core must add addresses
    (2), a check (4) or delimiting (3)."""
    bit_rate_bps: float
    """Marginal bit rate: eight bits more take 8 / bit_rate_bps seconds longer, > 0."""
    preamble_s: float = 0.0
    """Airtime of a frame of zero bytes, s, ≥ 0."""
    gap_s: float = 0.0
    """Pause that the device needs after each frame before the next, s, ≥ 0."""
    propagation_s: float = 1.0
    """Assumed propagation delay, one way, s, ≥ 0: time-outs follow from it before one is
    measured."""
    half_duplex: bool = True
    """Whether the device cannot receive while it transmits."""
    addressed: bool = True
    """Whether frames carry source and destination by themselves; otherwise the core adds two
    bytes."""
    checked: bool = True
    """Whether damaged frames do not arrive; otherwise the core adds a CRC."""
    framed: bool = True
    """Whether one `transmit` arrives as one frame or not at all; otherwise the link is a byte
    stream, which the core delimits."""
    acknowledges: bool = False
    """Whether it reports DELIVERED or NOT_DELIVERED for a unicast transmission that asks for it."""
    controls_access: bool = False
    """Whether the device, or one behind it, decides when it may transmit."""
    senses_carrier: bool = False
    """Whether it reports `carrier_changed` while another node is heard."""
    broadcast_mtu_bytes: int | None = None
    """Largest frame for all nodes, bytes; None: as large as one for a single node."""
    receives_bytes: int | None = None
    """Largest frame that may arrive, bytes; None: `mtu_bytes`."""
    address_range: tuple[int, int] = (1, 254)
    """First and last node address that the device can have."""
    reports: frozenset[str] = frozenset()
    """The fields of `LinkMetrics` that every received frame fills."""
    measures: frozenset[str] = frozenset()
    """Further fields of `LinkMetrics` that the device may report by `PeerMeasured`."""
    measures_range: bool = False
    """Whether a `PeerMeasured` with the propagation delay of the exchange follows each acknowledged
    transmission, so that ranges can be requested. Only where it `acknowledges`."""
    source_level_range_db: tuple[float, float] | None = None
    """Lowest and highest source level, dB re 1 µPa at 1 m, where it can be set."""
    long_above_bytes: int | None = None
    """Frames longer than this are carried in another way, with the two values below; None: none
    is."""
    long_bit_rate_bps: float = 1.0
    """Marginal bit rate of such frames, > 0."""
    long_preamble_s: float = 0.0
    """The airtime that such a frame takes beside its bits, s, ≥ 0."""
    bulk: BulkService | None = None
    """Its service for much data to one node; None: it has only the plain service, which the other
    fields describe. Only where the link is `framed`."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: Its frames are too short.
            ValueError: Another value is outside its range.
        """
        # A frame must hold a HELLO, 8 bytes, within what the core adds for the link.
        lacking = {2: self.addressed, 4: self.checked, 3: self.framed}
        least = 8 + sum(size_bytes for size_bytes, is_there in lacking.items() if not is_there)
        if self.mtu_bytes < least:  # a link may have it from its config or from the modem
            raise ConfigError(
                f"mtu_bytes is {self.mtu_bytes}; allowed: at least {least}",
                hint="raise the mtu of the link, or use another one",
            )
        if not self.bit_rate_bps > 0:
            raise ValueError(f"bit_rate_bps is {self.bit_rate_bps}; allowed: above 0")
        if not self.long_bit_rate_bps > 0:
            raise ValueError(f"long_bit_rate_bps is {self.long_bit_rate_bps}; allowed: above 0")
        low, high = self.address_range
        if not 1 <= low <= high <= 254:
            raise ValueError(f"address_range is {self.address_range}; allowed: within 1..254")
        if self.measures_range and not self.acknowledges:
            raise ValueError("measures_range is True; allowed: only where the link acknowledges")
        if self.bulk is not None and not (self.framed and self.bulk.mtu_bytes > self.mtu_bytes):
            raise ValueError(
                f"bulk has frames of {self.bulk.mtu_bytes} bytes; allowed: on a framed link, above "
                f"its mtu_bytes, {self.mtu_bytes}"
            )

    def airtime_ns(self, frame_bytes: int, service: Service = Service.PLAIN) -> int:
        """Return the airtime of a frame of that size, ns: preamble and bits, without the gap.

        Args:
            frame_bytes: Its length, bytes.
            service: What carries it; where the link has no such service, the plain one.
        """
        if service is Service.BULK and self.bulk is not None:
            return self.bulk.airtime_ns(frame_bytes)
        if self.long_above_bytes is not None and frame_bytes > self.long_above_bytes:
            return seconds_to_ns(self.long_preamble_s + frame_bytes * 8 / self.long_bit_rate_bps)
        return seconds_to_ns(self.preamble_s + frame_bytes * 8 / self.bit_rate_bps)

    def bounded(self, max_frame_s: float) -> "LinkCapabilities":
        """Return the same for a node whose own frames take at most this time.

        Args:
            max_frame_s: Longest airtime of a frame, s, > 0; `LEAST_FRAME_BYTES` may take longer.
        """
        fitting = int((max_frame_s - self.preamble_s) * self.bit_rate_bps / 8 + 1e-6)
        if self.long_above_bytes is not None:
            long_s = max_frame_s - self.long_preamble_s
            longest = int(long_s * self.long_bit_rate_bps / 8 + 1e-6)
            fitting = longest if longest > self.long_above_bytes else fitting
        most_bytes = max(LEAST_FRAME_BYTES, fitting)
        if self.mtu_bytes <= most_bytes:
            return self
        to_all = self.broadcast_mtu_bytes
        return msgspec.structs.replace(
            self,
            mtu_bytes=most_bytes,
            broadcast_mtu_bytes=None if to_all is None else min(to_all, most_bytes),
            receives_bytes=self.receives_bytes or self.mtu_bytes,
        )


class LinkMetrics(msgspec.Struct, frozen=True, kw_only=True):
    """A modem's measurements of another one, on a frame or apart; None: unknown."""

    snr_db: float | None = None
    """Signal-to-noise ratio, dB."""
    received_level_db: float | None = None
    """Received level, dB; the reference is the modem's own unless its link states one."""
    integrity: float | None = None
    """Signal quality on the modem's own scale."""
    propagation_s: float | None = None
    """Propagation delay, one way, s."""
    range_rate_m_s: float | None = None
    """Relative velocity, m/s, positive when the distance grows."""
    range_m: float | None = None
    """Slant distance, m: propagation delay times the sound speed set in the device."""
    east_m: float | None = None
    """Its position from here, towards the east, m. The three coordinates come together."""
    north_m: float | None = None
    """Towards the north, m."""
    up_m: float | None = None
    """Upwards, m: negative where it is deeper."""
    accuracy_m: float | None = None
    """Uncertainty of that position as the device states it, m."""
    bearing_rad: float | None = None
    """Direction of its sound, rad, 0…2π: 0 is north, π/2 east. Comes with the elevation."""
    elevation_rad: float | None = None
    """Direction above the horizontal, rad, -π/2…π/2."""
    accuracy_rad: float | None = None
    """Uncertainty of that direction as the device states it, rad."""


class PeerMeasured(msgspec.Struct, frozen=True, kw_only=True):
    """A modem has measured another one, apart from any frame."""

    address: int
    """The other node, 1…254."""
    measured_at: int
    """Instant of the measurement, ns: the end of the sound that it was made on, also if it is
    reported later."""
    metrics: LinkMetrics
    """The measurements."""


class ModemRead(msgspec.Struct, frozen=True, kw_only=True):
    """A modem's readings of itself; None: unknown."""

    read_at: int
    """Instant of the answer, ns."""
    firmware: str = ""
    """Its firmware version, in the vendor's words."""
    battery_v: float | None = None
    """Supply voltage, V."""
    source_level_db: float | None = None
    """Source level, dB re 1 µPa at 1 m, where the device knows it."""
    relative_source_level_db: float | None = None
    """Source level relative to the device's loudest, dB, at most 0."""


Measurement: TypeAlias = PeerMeasured | ModemRead
"""Unsolicited reports of a link."""


class ReceivedFrame(msgspec.Struct, frozen=True, kw_only=True):
    """A frame that arrived, or a piece of the byte stream for a link without frames."""

    frame_bytes: bytes
    """The bytes that arrived, without anything that the link itself added."""
    received_at: int
    """Instant at which the last byte had arrived, ns."""
    source: int = 0
    """Address of the sender; 0 when the link does not carry addresses."""
    destination: int = BROADCAST
    """Address it was sent to; `BROADCAST` when unknown."""
    metrics: LinkMetrics = LinkMetrics()
    """The modem's measurements."""
    service: Service = Service.PLAIN
    """The service that carried it."""
    travel: tuple[int, int | None] | None = None
    """How long it was on its way, from its first bit at its source, and the largest error of that,
    ns, where other links have carried it; None: as its size and the link say."""


class Transmission(msgspec.Struct, frozen=True, kw_only=True):
    """One frame that an engine asks its link to transmit."""

    transmission_id: int
    """Identifies the transmission in its report; counted by the engine for each link."""
    frame_bytes: bytes
    """The frame, 1…mtu_bytes bytes of its service."""
    destination: int = BROADCAST
    """Address, or `BROADCAST`."""
    acknowledge: bool = False
    """Whether to ask the modem for an acknowledgement; only where
    `LinkCapabilities.acknowledges`."""
    link: str = ONE_LINK
    """Name of the link that transmits it."""
    service: Service = Service.PLAIN
    """The service that carries it; `Service.BULK` only where the link has `bulk`, to one node."""
    is_urgent: bool = False
    """Whether it goes before all others: a device may drop frames of its bulk service for it, and
    reports them ABORTED."""
    rides_back: bool = False
    """Whether its destination sends bulk frames and goes on, so that it may wait for the device's
    next acknowledgement of them, some seconds; only where `BulkService.rides_back`."""


class TransmitReport(msgspec.Struct, frozen=True, kw_only=True):
    """How a transmission ended: exactly one report for each."""

    transmission_id: int
    """The transmission."""
    outcome: TransmitOutcome
    """How it ended."""
    started_at: int
    """Instant of its first bit, or of the call of `transmit` if there was none, ns."""
    finished_at: int
    """End of the transmission or of the attempt, ns; not before `started_at`."""
    detail: str = ""
    """The modem's own words, or the reason of a rejection."""
