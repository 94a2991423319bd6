"""Signals between emulated modems, and what a modem decodes of them."""

import enum
from typing import Final

import msgspec

from zacoustic.channel.arrival import Reception
from zacoustic_evologics.at.notifications import ImFlag


class SignalKind(enum.Enum):
    """The kinds of signals; the value is the word in SENDSTART, SENDEND and RECVSRV.

    Seen in captures are `im` and `ims`; the others are ours.
    """

    IM = "im"
    """Instant message."""
    IMS = "ims"
    """Synchronous instant message."""
    ACK = "ack"
    """Acknowledgement of an instant message."""
    PROBE = "probe"
    """Probe signal."""
    CONNECT = "connect"
    """Asks for a connection."""
    ACCEPT = "accept"
    """Grants it."""
    TRAIN = "data"
    """Burst packets, one behind the other."""
    TRAIN_ACK = "dataack"
    """Acknowledges a train."""

    @property
    def service(self) -> str:
        """What people call it: a train is the burst that it carries."""
        return _SERVICES.get(self, self.value)


_SERVICES: Final = {SignalKind.TRAIN: "burst", SignalKind.TRAIN_ACK: "burst ack"}


class Piggyback(msgspec.Struct, frozen=True):
    """A piggyback message, on a signal that goes to its destination anyway."""

    payload: bytes
    """1…64 bytes."""
    pid: int
    """Protocol id."""


class BurstPacket(msgspec.Struct, frozen=True):
    """One packet of a train."""

    payload: bytes
    """1…1024 bytes."""
    pid: int
    """Protocol id."""
    is_raw: bool
    """From the data mode of a port, and for the data mode of others."""


class Signal(msgspec.Struct, frozen=True, kw_only=True):
    """One signal."""

    kind: SignalKind
    """What it is."""
    source: int
    """Network address of the sender."""
    destination: int
    """Network address of the receiver, 255 for everybody."""
    duration_ns: int
    """How long it sounds, whole microseconds."""
    number: int
    """Of the exchange: an answer has that of what it answers, a repetition that of the first."""
    payload: bytes = b""
    """Of a message."""
    flag: ImFlag = ImFlag.NOACK
    """Of an instant message."""
    pid: int = 0
    """Protocol id of a message."""
    piggyback: Piggyback | None = None
    """What goes with it."""
    packets: tuple[BurstPacket, ...] = ()
    """Of a train."""
    bit_rate_bps: int = 0
    """Of a train, and what an accepting modem proposes."""
    bit: int = 0
    """Of a probe signal."""
    level: int = 0
    """Source level, 0 loudest … 3."""

    @property
    def content_bytes(self) -> int:
        """Bytes of hosts that go with it: message, piggyback message, packets."""
        piggyback_bytes = len(self.piggyback.payload) if self.piggyback else 0
        return len(self.payload) + piggyback_bytes + sum(len(each.payload) for each in self.packets)


class Hearing(msgspec.Struct, frozen=True, kw_only=True):
    """A signal that has ended at a modem."""

    sound: int
    """Which sound: as it was announced when it began."""
    signal: Signal
    """What was sent."""
    reception: Reception
    """How it came, and what became of it."""
    rssi_db: int
    """Level, dB re 1 V."""
    integrity: int
    """Signal integrity."""
    offset_m: tuple[float, float, float]
    """Where the sender is from here: east, north, up, m."""
    sound_speed_m_s: float
    """True speed of sound."""
    is_unheard: bool = False
    """The modem has missed it, whatever the channel says."""

    @property
    def is_received(self) -> bool:
        """Whether the modem could read it."""
        return self.reception.is_received and not self.is_unheard

    @property
    def starts_at(self) -> int:
        """Instant of its first sound here, ns."""
        return self.reception.arrival.starts_at

    @property
    def ends_at(self) -> int:
        """Instant of its last sound here, ns."""
        return self.reception.arrival.ends_at

    @property
    def duration_ns(self) -> int:
        """How long it sounded here."""
        return self.ends_at - self.starts_at

    @property
    def snr_db(self) -> float:
        """Level over noise, dB."""
        return self.reception.arrival.snr_db

    @property
    def propagation_us(self) -> int:
        """Propagation delay, one way."""
        return round(self.reception.arrival.propagation_s * 1e6)

    @property
    def velocity_m_s(self) -> float:
        """Relative velocity, positive when the distance grows."""
        return self.reception.arrival.range_rate_m_s
