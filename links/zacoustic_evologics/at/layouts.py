"""The fields of a modem's messages in order: the tables, and one reader for all.

A payload has exactly the length that its record announces, then CR LF; nothing in it is escaped.
Firmware 1.6 has other fields in two records. The field that holds the velocity in the later layout
distinguishes the two: velocities have a decimal point in every source, and the delay that firmware
1.6 has there has none; then the next field must be the velocity.

A line with more fields than its table is read without the surplus ones: one firmware adds a
velocity to RECVEND, and a later one must not disable a whole kind of record.
"""

import re
from collections.abc import Callable
from typing import Any, Final, TypeAlias

import msgspec

from zacoustic_evologics.at import notifications as said
from zacoustic_evologics.at import usbl
from zacoustic_evologics.at.fields import (
    ACCURACY,
    ADDRESS,
    ANGLE_RAD,
    BIT_RATE_BPS,
    CLOCK_US,
    COUNT,
    DURATION_US,
    INTEGRITY,
    METRES,
    PROTOCOL_ID,
    RAW_METRES,
    RSSI_DB,
    SECONDS,
    SIGNED,
    VELOCITY_M_S,
    WORD,
    Choice,
    Field,
    Integer,
)
from zacoustic_evologics.at.framing import (
    CRLF,
    PAYLOAD_LIMIT_BYTES,
    Gap,
    Header,
    read_header,
)
from zacoustic_evologics.at.messages import Noise

IM_LIMIT_BYTES: Final = 64
"""Longest payload of an instant, synchronous or piggyback message."""

Columns: TypeAlias = tuple[tuple[str, Field] | tuple[str, Field, int], ...]
"""Name of the record's field, its kind, and how many values of it follow each other."""
Record: TypeAlias = said.Notification | Noise
"""Records with a layout."""


class Layout(msgspec.Struct, frozen=True):
    """One record of the grammar."""

    token: str
    """Its first word."""
    record: Callable[..., Record]
    """The type of its record."""
    columns: Columns
    """Its fields, in order; without protocol id, length and payload."""
    payload_limit: int | None = None
    """Longest payload, bytes; None: the record is a line."""
    has_addresses: bool = True
    """It has a payload and may carry a protocol id."""


_ADDRESSES: Final[Columns] = (("source", ADDRESS), ("destination", ADDRESS))
_FLAG: Final[Columns] = (("flag", Choice(said.ImFlag)),)
_DURATION: Final[Columns] = (("duration_us", DURATION_US),)
_BIT_RATE: Final[Columns] = (("bit_rate_bps", BIT_RATE_BPS),)
_DELAY: Final[Columns] = (("propagation_us", DURATION_US),)
_SIGNAL: Final[Columns] = (("rssi_db", RSSI_DB), ("integrity", INTEGRITY))
_VELOCITY: Final[Columns] = (("velocity_m_s", VELOCITY_M_S),)
_DESTINATION: Final[Columns] = (("destination", ADDRESS),)
_FIX: Final[Columns] = (("clock_us", SECONDS), ("measured_us", SECONDS), ("address", ADDRESS))
_ATTITUDE: Final[Columns] = tuple(
    (name, ANGLE_RAD) for name in ("roll_rad", "pitch_rad", "yaw_rad")
)
_POSITION: Final[Columns] = tuple(
    (name, METRES) for name in ("x_m", "y_m", "z_m", "east_m", "north_m", "up_m")
)
_BEARING: Final[Columns] = tuple(
    (name, ANGLE_RAD)
    for name in ("local_bearing_rad", "local_elevation_rad", "bearing_rad", "elevation_rad")
)

_RECEIVED: Final = _SIGNAL + _VELOCITY
_RECEIVED_1_6: Final = _BIT_RATE + _SIGNAL + _DELAY + _VELOCITY

PAYLOAD_LAYOUTS: Final = (
    Layout("RECVIM", said.RecvIm, _ADDRESSES + _FLAG + _DURATION + _RECEIVED, IM_LIMIT_BYTES),
    Layout(
        "RECVIMS",
        said.RecvIms,
        (*_ADDRESSES, ("timestamp_us", CLOCK_US), *_DURATION, *_RECEIVED),
        IM_LIMIT_BYTES,
    ),
    Layout("RECVPBM", said.RecvPbm, _ADDRESSES + _DURATION + _RECEIVED, IM_LIMIT_BYTES),
    Layout("RECV", said.Recv, _ADDRESSES + _RECEIVED_1_6, PAYLOAD_LIMIT_BYTES),
    Layout(
        "NOISE",
        Noise,
        (("first", SIGNED), ("second", SIGNED), ("third", SIGNED)),
        PAYLOAD_LIMIT_BYTES,
        has_addresses=False,
    ),
)
"""Records that end with a payload."""
FIRMWARE_1_6_LAYOUTS: Final = (
    Layout("RECVIM", said.RecvIm, _ADDRESSES + _FLAG + _RECEIVED_1_6, IM_LIMIT_BYTES),
    Layout("RECVPBM", said.RecvPbm, _ADDRESSES + _RECEIVED_1_6, IM_LIMIT_BYTES),
)
"""Layouts of older firmware, where they differ."""
LINE_LAYOUTS: Final = (
    Layout("RECVSTART", said.RecvStart, ()),
    Layout("RECVEND", said.RecvEnd, (("clock_us", CLOCK_US), *_DURATION, *_SIGNAL)),
    Layout("RECVFAILED", said.RecvFailed, _VELOCITY + _SIGNAL),
    Layout(
        "RECVSRV",
        said.RecvSrv,
        (*_ADDRESSES, ("kind", WORD), ("decoded", SIGNED), ("transmitted", SIGNED), *_SIGNAL),
    ),
    Layout(
        "RECVPROBE",
        said.RecvProbe,
        (("bit", SIGNED), ("timestamp_us", CLOCK_US), *_DURATION, *_SIGNAL, *_VELOCITY),
    ),
    Layout(
        "SENDSTART",
        said.SendStart,
        (*_DESTINATION, ("kind", WORD), *_DURATION, ("delay_us", DURATION_US)),
    ),
    Layout(
        "SENDEND",
        said.SendEnd,
        (*_DESTINATION, ("kind", WORD), ("clock_us", CLOCK_US), *_DURATION),
    ),
    Layout("DELIVERED", said.Delivered, (("counter", COUNT), *_DESTINATION)),
    Layout("FAILED", said.Failed, (("counter", COUNT), *_DESTINATION)),
    Layout("DELIVEREDIM", said.DeliveredIm, _DESTINATION),
    Layout("FAILEDIM", said.FailedIm, _DESTINATION),
    Layout("CANCELEDIM", said.CanceledIm, _DESTINATION),
    Layout("CANCELEDIMS", said.CanceledIms, _DESTINATION),
    Layout("CANCELEDPBM", said.CanceledPbm, _DESTINATION),
    Layout("EXPIREDIMS", said.ExpiredIms, _DESTINATION),
    Layout("BITRATE", said.BitRate, (("direction", Choice(said.Direction)), *_BIT_RATE)),
    Layout("RADDR", said.RemoteAddress, (("address", ADDRESS),)),
    Layout("SRCLEVEL", said.SourceLevel, (("level", Integer(0, 3)),)),
    Layout("DROPCNT", said.DropCount, (("dropped_bytes", COUNT),)),
    Layout("PHYON", said.PhyOn, ()),
    Layout("PHYOFF", said.PhyOff, ()),
    Layout("STATUS", said.Status, (("state", WORD), ("detail", WORD))),
    Layout(
        "USBLLONG",
        usbl.UsblLong,
        (*_FIX, *_POSITION, *_ATTITUDE, *_DELAY, *_SIGNAL, ("accuracy_m", ACCURACY)),
    ),
    Layout(
        "USBLANGLES",
        usbl.UsblAngles,
        (*_FIX, *_BEARING, *_ATTITUDE, *_SIGNAL, ("accuracy_rad", ACCURACY)),
    ),
    Layout("USBLPHYD", usbl.UsblPhyD, (*_FIX, ("fix", SIGNED), ("delays", SIGNED, 8))),
    Layout("USBLPHYP", usbl.UsblPhyP, (*_FIX, ("fix", SIGNED), ("positions_m", RAW_METRES, 18))),
    Layout(
        "ECLK",
        said.ExternalClock,
        (
            ("monotonic_us", SECONDS),
            ("clock_us", CLOCK_US),
            ("steering_ns_s", SIGNED),
            ("flags", SIGNED),
            ("gps_us", SECONDS),
        ),
    ),
    Layout("RTO", said.ClockOffset, (("offset_us", SIGNED),)),
)
"""Records without a payload."""

PAYLOAD_TOKENS: Final = {layout.token: layout for layout in PAYLOAD_LAYOUTS}
LINE_TOKENS: Final = {layout.token: layout for layout in LINE_LAYOUTS} | {
    layout.token.replace("CANCELED", "CANCELLED"): layout
    for layout in LINE_LAYOUTS
    if layout.token.startswith("CANCELED")
}
"""By token; one driver has met another spelling of CANCELED."""
LAYOUTS_OF: Final = {layout.record: layout for layout in PAYLOAD_LAYOUTS + LINE_LAYOUTS}
"""By record; that of firmware 1.9 if there are two."""
FIRMWARE_1_6_LAYOUT_OF: Final = {layout.record: layout for layout in FIRMWARE_1_6_LAYOUTS}

_FIRMWARE_1_6: Final = {layout.token: layout for layout in FIRMWARE_1_6_LAYOUTS}
_VELOCITY_OF_1_6: Final = re.compile(rb"-?[0-9]{1,5}\.[0-9]{1,6},")
_VELOCITY_LIMIT: Final = 20


def width(columns: Columns) -> int:
    """Return the number of fields of a table."""
    return sum(column[2] if len(column) == 3 else 1 for column in columns)


def decode_columns(columns: Columns, texts: tuple[str, ...]) -> dict[str, Any]:
    """Read fields by their table.

    Raises:
        ValueError: Fields are missing, or one is not valid.
    """
    if len(texts) < width(columns):
        raise ValueError(f"{len(texts)} fields; allowed: {width(columns)}")
    values: dict[str, Any] = {}
    place = 0
    for name, field, *several in columns:
        count = several[0] if several else 1
        read = tuple(field.decode(text) for text in texts[place : place + count])
        values[name] = read if several else read[0]
        place += count
    return values


def encode_columns(columns: Columns, record: object) -> list[str]:
    """Write fields by their table.

    Raises:
        ValueError: A value is not valid.
    """
    texts: list[str] = []
    for name, field, *several in columns:
        value = getattr(record, name)
        values = value if several else (value,)
        if len(values) != (several[0] if several else 1):
            raise ValueError(f"{name} has {len(values)} values; allowed: {several[0]}")
        texts += [field.encode(each) for each in values]
    return texts


def decode_line(line: str) -> Record | Gap | None:
    """Read a notification without a payload.

    Returns:
        The record; None if the line is no notification; MALFORMED if it begins like one. A line
        that begins like a record with a payload is a damaged one.
    """
    if "\n" in line or "\r" in line:
        return None
    if line.startswith("%"):
        return _decode_extension(line)
    if line in _ASYNC_ERRORS:
        return _ASYNC_ERRORS[line]
    token, *texts = line.split(",")
    layout = LINE_TOKENS.get(token)
    if token == "NOISE":
        return Gap.MALFORMED
    # No answer begins like this, so this is a kind of a later firmware.
    if layout is None and token.startswith(("RECV", "SEND", "USBL")):
        return Gap.MALFORMED
    # `FAILED` alone answers AT?DI: a notification with fields has a comma.
    if layout is None or (layout.columns and not texts):
        return None
    try:
        return layout.record(**decode_columns(layout.columns, tuple(texts)))
    except ValueError:
        return Gap.MALFORMED


def decode_payload_record(buffer: bytes | bytearray, layout: Layout) -> tuple[Record, int] | Gap:
    """Read a record with payload from the beginning of a buffer.

    Args:
        buffer: Begins with the token of the layout and a comma.
        layout: The layout of firmware 1.9.

    Returns:
        The record and the number of bytes it took, CR LF included.
    """
    layout, header = _choose_layout(buffer, layout)
    if isinstance(header, Gap):
        return header
    found = bytes(buffer[header.payload_end : header.payload_end + len(CRLF)])
    if not CRLF.startswith(found):
        return Gap.MALFORMED
    if found != CRLF:
        return Gap.INCOMPLETE
    try:
        values = decode_columns(layout.columns, header.values)
        if header.pid is not None and layout.has_addresses:
            values["pid"] = PROTOCOL_ID.decode(str(header.pid))
        payload = bytes(buffer[header.payload_start : header.payload_end])
        return layout.record(payload=payload, **values), header.payload_end + len(CRLF)
    except ValueError:
        return Gap.MALFORMED


def _choose_layout(buffer: bytes | bytearray, layout: Layout) -> tuple[Layout, Header | Gap]:
    limit = layout.payload_limit or 0
    header = read_header(buffer, width(layout.columns), limit)
    older = _FIRMWARE_1_6.get(layout.token)
    if isinstance(header, Gap) or older is None or "." in header.values[-1]:
        return layout, header
    # While the next field is incomplete no CR LF is there, so the wrong layout settles nothing.
    after = bytes(buffer[header.payload_start : header.payload_start + _VELOCITY_LIMIT])
    if _VELOCITY_OF_1_6.match(after):
        return older, read_header(buffer, width(older.columns), limit)
    return layout, header


def _decode_extension(line: str) -> said.Extension | Gap:
    key, _, parameters = line[1:].partition(",")
    return said.Extension(key, parameters) if key else Gap.MALFORMED


_ASYNC_ERRORS: Final = {f"ERROR {fault.value}": said.AsyncError(fault) for fault in said.FaultKind}
