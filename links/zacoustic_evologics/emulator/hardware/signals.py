"""Signals between emulated modems, and their receptions."""

import enum
from typing import Final, TypeVar

import msgspec

from zacoustic.channel.arrival import Reception
from zacoustic_evologics.at.notifications import ImFlag


class SignalKind(enum.Enum):
    """The kinds of signals; the value is the word in SENDSTART, SENDEND and RECVSRV.

    Captures show `im` and `ims`; the other words are ours.
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
    """Request for a connection."""
    ACCEPT = "accept"
    """Grant of a connection."""
    TRAIN = "data"
    """Burst packets, one after the other."""
    TRAIN_ACK = "dataack"
    """Acknowledgement of a train."""

    @property
    def service(self) -> str:
        """Name for people: a train is the burst that it carries."""
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
    """It comes from the data mode of a port, and is for the data mode of others."""


class Signal(msgspec.Struct, frozen=True, kw_only=True):
    """One signal."""

    kind: SignalKind
    """Its kind."""
    source: int
    """Network address of the sender."""
    destination: int
    """Network address of the receiver; 255: broadcast."""
    duration_ns: int
    """Airtime, ns, whole microseconds."""
    number: int
    """Number of the exchange: an answer and a repetition have that of the first signal."""
    payload: bytes = b""
    """Payload of a message."""
    flag: ImFlag = ImFlag.NOACK
    """Flag of an instant message."""
    pid: int = 0
    """Protocol id of a message."""
    piggyback: Piggyback | None = None
    """The piggyback message that goes with it."""
    packets: tuple[BurstPacket, ...] = ()
    """Packets of a train."""
    bit_rate_bps: int = 0
    """Bit rate of a train, or the one that an accepting modem proposes, bit/s."""
    bit: int = 0
    """Bit of a probe signal."""
    level: int = 0
    """Source level, 0 loudest … 3."""

    @property
    def content_bytes(self) -> int:
        """Bytes of hosts in it: message, piggyback message, packets."""
        piggyback_bytes = len(self.piggyback.payload) if self.piggyback else 0
        return len(self.payload) + piggyback_bytes + sum(len(each.payload) for each in self.packets)


_S = TypeVar("_S", bound=msgspec.Struct)


class Hearing(msgspec.Struct, frozen=True, kw_only=True):
    """A signal that has ended at a modem."""

    sound: int
    """Number of the sound, as announced at its beginning."""
    signal: Signal
    """The signal."""
    reception: Reception
    """Its reception, with the outcome."""
    rssi_db: int
    """Level, dB re 1 V."""
    integrity: int
    """Signal integrity."""
    offset_m: tuple[float, float, float]
    """Position of the sender relative to here: east, north, up, m."""
    sound_speed_m_s: float
    """True speed of sound."""
    is_unheard: bool = False
    """The modem has missed it, whatever its outcome on the channel."""

    def told(self, kind: type[_S], /, **others: object) -> _S:
        """Return a modem's record of this signal.

        Args:
            kind: The record; addresses and measurements in it are those of this signal.
            others: Its other fields.
        """
        heard = {
            "source": self.signal.source,
            "destination": self.signal.destination,
            "rssi_db": self.rssi_db,
            "integrity": self.integrity,
            "velocity_m_s": self.velocity_m_s,
        }
        names = kind.__struct_fields__
        return kind(**{name: heard[name] for name in names if name in heard}, **others)

    @property
    def is_received(self) -> bool:
        """Whether the modem could decode it."""
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
        """Its duration here, ns."""
        return self.ends_at - self.starts_at

    @property
    def snr_db(self) -> float:
        """Level over noise, dB."""
        return self.reception.arrival.snr_db

    @property
    def propagation_us(self) -> int:
        """Propagation delay, one way, µs."""
        return round(self.reception.arrival.propagation_s * 1e6)

    @property
    def velocity_m_s(self) -> float:
        """Relative velocity, positive when the distance grows."""
        return self.reception.arrival.range_rate_m_s
