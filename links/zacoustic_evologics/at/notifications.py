"""Unsolicited messages of a modem, one record for each kind.

Names follow the words on the wire, to be found by them; field names contain units. Decibels are
relative to 1 V at the receiver: the vendor's own scale, useful from about -85 to -20. Instants
`…_us` are the modem's clock, which wraps at 2^32 µs.
"""

import enum
from typing import TypeAlias

import msgspec

from zacoustic_evologics.at import fields
from zacoustic_evologics.at.usbl import UsblNotification


class ImFlag(enum.Enum):
    """What an instant message asks for."""

    ACK = "ack"
    """The other modem acknowledges by itself."""
    NOACK = "noack"
    """Nobody acknowledges."""
    FORCE = "force"
    """As NOACK, and sent even while the modem is in its backoff state."""


class _Received(msgspec.Struct, frozen=True, kw_only=True):
    payload: fields.MessageReceived
    """What was sent."""
    source: fields.Address
    """Address of the sender."""
    destination: fields.Address
    """Address it was sent to; not this modem's own in promiscuous mode, or for 255."""
    rssi_db: fields.Rssi
    """Received level, dB re 1 V."""
    integrity: fields.Integrity
    """Signal integrity; above 100 is good."""
    velocity_m_s: fields.Velocity
    """Relative velocity, m/s, four decimals."""
    pid: fields.ProtocolId = None
    """Protocol id, with extended networking only."""


class RecvIm(_Received, frozen=True, kw_only=True):
    """An instant message. Either `duration_us`, or both fields of firmware 1.6."""

    flag: ImFlag
    """What the sender asked for."""
    duration_us: fields.Duration | None = None
    """How long it was on the air, µs."""
    bit_rate_bps: fields.Rate | None = None
    """Firmware 1.6: bit rate."""
    propagation_us: fields.Duration | None = None
    """Firmware 1.6: propagation delay, µs."""


class RecvIms(_Received, frozen=True, kw_only=True):
    """A synchronous instant message."""

    timestamp_us: fields.Clock
    """Modem's clock when its signal began."""
    duration_us: fields.Duration
    """How long it was on the air, µs."""


class RecvPbm(_Received, frozen=True, kw_only=True):
    """A piggyback message. Either `duration_us`, or both fields of firmware 1.6."""

    duration_us: fields.Duration | None = None
    """How long what carried it was on the air, µs."""
    bit_rate_bps: fields.Rate | None = None
    """Firmware 1.6: bit rate."""
    propagation_us: fields.Duration | None = None
    """Firmware 1.6: propagation delay, µs."""


class Recv(_Received, frozen=True, kw_only=True):
    """Burst data."""

    payload: fields.AnyPayload
    """What was sent."""
    bit_rate_bps: fields.Rate
    """Bit rate at which it came."""
    propagation_us: fields.Duration
    """Propagation delay, µs."""


class RecvStart(msgspec.Struct, frozen=True):
    """A signal is being received."""


class RecvEnd(msgspec.Struct, frozen=True, kw_only=True):
    """A signal has been received. Some firmware adds a velocity, which is not read."""

    clock_us: fields.Clock
    """Modem's clock when the signal began."""
    duration_us: fields.Duration
    """How long it was, µs."""
    rssi_db: fields.Rssi
    """Received level, dB re 1 V."""
    integrity: fields.Integrity
    """Signal integrity."""


class RecvFailed(msgspec.Struct, frozen=True, kw_only=True):
    """A signal could not be decoded."""

    velocity_m_s: fields.Velocity
    """Relative velocity, m/s."""
    rssi_db: fields.Rssi
    """Received level, dB re 1 V."""
    integrity: fields.Integrity
    """Signal integrity."""


class RecvSrv(msgspec.Struct, frozen=True, kw_only=True):
    """A service packet between others was overheard."""

    source: fields.Address
    """Address of the sender."""
    destination: fields.Address
    """Address it was sent to."""
    kind: fields.Word
    """The vendor's word: `im`, `ack`, …"""
    decoded: fields.Signed
    """As the modem sends it; seen are 0 and 1."""
    transmitted: fields.Signed
    """As the modem sends it; seen is 1."""
    rssi_db: fields.Rssi
    """Received level, dB re 1 V."""
    integrity: fields.Integrity
    """Signal integrity."""


class RecvProbe(msgspec.Struct, frozen=True, kw_only=True):
    """A probe signal was received."""

    bit: fields.Signed
    """The bit it carries."""
    timestamp_us: fields.Clock
    """Modem's clock when it began."""
    duration_us: fields.Duration
    """How long it was, µs."""
    rssi_db: fields.Rssi
    """Received level, dB re 1 V."""
    integrity: fields.Integrity
    """Signal integrity."""
    velocity_m_s: fields.Velocity
    """Relative velocity, m/s."""


class SendStart(msgspec.Struct, frozen=True, kw_only=True):
    """A transmission begins."""

    destination: fields.Address
    """Address it goes to."""
    kind: fields.Word
    """The vendor's word: `im`, `ims`, …"""
    duration_us: fields.Duration
    """How long it will be on the air, µs."""
    delay_us: fields.Duration
    """How long until it begins, µs."""


class SendEnd(msgspec.Struct, frozen=True, kw_only=True):
    """A transmission has ended."""

    destination: fields.Address
    """Address it went to."""
    kind: fields.Word
    """The vendor's word."""
    clock_us: fields.Clock
    """Modem's clock when the signal began."""
    duration_us: fields.Duration
    """How long it was on the air, µs."""


class Delivered(msgspec.Struct, frozen=True, kw_only=True):
    """Burst data arrived: the other modem has it."""

    counter: fields.Count
    """What `AT?PC` answered before the data was given to the modem."""
    destination: fields.Address
    """Address."""


class Failed(msgspec.Struct, frozen=True, kw_only=True):
    """Burst data was given up."""

    counter: fields.Count
    """What `AT?PC` answered before the data was given to the modem."""
    destination: fields.Address
    """Address."""


class _Reported(msgspec.Struct, frozen=True):
    destination: fields.Address
    """Address it was meant for."""


class DeliveredIm(_Reported, frozen=True):
    """The acknowledgement of an instant message came: the other modem has it."""


class FailedIm(_Reported, frozen=True):
    """No acknowledgement of an instant message came; the other modem may have it."""


class CanceledIm(_Reported, frozen=True):
    """An instant message was dropped, or is no longer followed."""


class CanceledIms(_Reported, frozen=True):
    """A synchronous instant message was dropped."""


class CanceledPbm(_Reported, frozen=True):
    """A piggyback message was dropped or replaced."""


class ExpiredIms(_Reported, frozen=True):
    """The instant of a synchronous instant message was already past."""


class Direction(enum.Enum):
    """Which way a bit rate is meant."""

    LOCAL = "local"
    """From this modem."""
    REMOTE = "remote"
    """To this modem."""


class BitRate(msgspec.Struct, frozen=True):
    """The bit rate of bursts has changed."""

    direction: Direction
    """Which way."""
    bit_rate_bps: fields.Rate
    """The new one."""


class RemoteAddress(msgspec.Struct, frozen=True):
    """`RADDR`: the remote address of raw bursts has changed."""

    address: fields.Address
    """The new one, 0 when there is none."""


class SourceLevel(msgspec.Struct, frozen=True):
    """`SRCLEVEL`: the source level has been changed remotely."""

    level: fields.SourceLevelNumber
    """0 is the loudest, 3 the quietest."""


class DropCount(msgspec.Struct, frozen=True):
    """`DROPCNT`: raw data was dropped."""

    dropped_bytes: fields.Count
    """How much."""


class PhyOn(msgspec.Struct, frozen=True):
    """The physical layer works."""


class PhyOff(msgspec.Struct, frozen=True):
    """The physical layer is off: the modem has gone over to another protocol."""


class Status(msgspec.Struct, frozen=True):
    """The state of the acoustic link has changed."""

    state: fields.Word
    """`INITIATION`, `ONLINE`, `OFFLINE`, `BACKOFF`, `BUSY`, …"""
    detail: fields.Word
    """`LISTEN`, `CONNECTION_FAILED`, …"""


class ExternalClock(msgspec.Struct, frozen=True, kw_only=True):
    """`ECLK`: the state of an external clock; firmware 1.9 and later."""

    monotonic_us: fields.SystemClock
    """Monotonic clock, µs."""
    clock_us: fields.Clock
    """Modem's clock."""
    steering_ns_s: fields.Signed
    """How much the clock is steered, ns per second."""
    flags: fields.Signed
    """Bit 0 atomic clock unlocked, bit 1 GPS event, bit 2 power event."""
    gps_us: fields.SystemClock
    """GPS time, µs."""


class ClockOffset(msgspec.Struct, frozen=True):
    """`RTO`: an offset of the clock."""

    offset_us: fields.Signed
    """How much, µs."""


class FaultKind(enum.Enum):
    """Errors that are no reply to any command."""

    EFAULT = "EFAULT"
    """Internal fault."""
    OVERLOAD = "OVERLOAD"
    """Overload."""


class AsyncError(msgspec.Struct, frozen=True):
    """`ERROR EFAULT` or `ERROR OVERLOAD`, which come unasked."""

    fault: FaultKind
    """Which."""


class Extension(msgspec.Struct, frozen=True):
    """`%KEY` with the rest of its line: from the vendor's own middleware, not from a modem."""

    key: fields.ExtensionKey
    """Behind the percent sign."""
    parameters: fields.ExtensionText = ""
    """Behind the first comma."""


ReceivedMessage: TypeAlias = RecvIm | RecvIms | RecvPbm | Recv
"""What carries a payload."""
Notification: TypeAlias = (
    ReceivedMessage
    | RecvStart
    | RecvEnd
    | RecvFailed
    | RecvSrv
    | RecvProbe
    | SendStart
    | SendEnd
    | Delivered
    | Failed
    | DeliveredIm
    | FailedIm
    | CanceledIm
    | CanceledIms
    | CanceledPbm
    | ExpiredIms
    | BitRate
    | RemoteAddress
    | SourceLevel
    | DropCount
    | PhyOn
    | PhyOff
    | Status
    | UsblNotification
    | ExternalClock
    | ClockOffset
    | AsyncError
    | Extension
)
"""All unsolicited messages."""
