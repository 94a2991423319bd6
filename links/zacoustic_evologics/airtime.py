"""Airtimes and pauses of a modem: the emulator keeps them, the driver reckons with them.

Instant messages follow a published table of measured durations; sizes between its rows are
interpolated, and bytes of a piggyback message beyond 64 continue its last slope. For bursts and
service signals only the acknowledgement of a capture is known: their durations follow from that,
and from the bit rate of the connection.

Source:
    Durations and processing delays: the table of the S2C in DESERT Underwater's samples, which
    reports the same duration for 53 bytes as a real modem. Acknowledgement and turnaround: capture
    of an exchange with firmware 1.9; the turnaround is its rest after the other terms.
"""

from bisect import bisect_left
from typing import Final

from zacoustic.core.clock import seconds_to_ns
from zacoustic_evologics.at.fields import IM_LIMIT_BYTES

TURNAROUND_NS: Final = 110_000_000
"""From the end of a message to the beginning of its acknowledgement, at the answering modem, ns."""
ACKNOWLEDGEMENT_NS: Final = 139_376_000
"""Acknowledgement, and any other signal that only serves a connection, ns."""
GAP_S: Final = 0.0904
"""From the end of a message to the next one of the same modem, s; measured: 88…93 ms. With it 64
bytes take 0.951 s, which is 539 bit/s."""
GAP_NS: Final = seconds_to_ns(GAP_S)
"""The same, ns."""
PREAMBLE_S: Final = 0.1503
"""Airtime of an instant message without a byte, s: straight line through the published airtimes of
1…64 bytes, 14 ms off at most."""
BIT_RATE_BPS: Final = 8 / 0.011094
"""Marginal bit rate of instant messages; 64 bytes last 0.860 s."""
PREPARATION_NS: Final = 15_950_000
"""How long before a scheduled signal the modem announces it, ns: measured between the layers."""

_TABLE_US: Final = {
    1: 172_102,
    2: 180_294,
    4: 196_696,
    5: 213_082,
    6: 221_274,
    8: 237_660,
    10: 262_255,
    12: 286_833,
    14: 303_218,
    15: 311_411,
    16: 327_796,
    18: 344_182,
    20: 368_760,
    22: 393_338,
    23: 409_723,
    24: 417_916,
    32: 499_859,
    40: 589_929,
    48: 688_241,
    53: 745_623,
    64: 860_338,
}
_SIZES: Final = tuple(_TABLE_US)
_BURST_PREAMBLE_NS: Final = ACKNOWLEDGEMENT_NS
BURST_RATES_BPS: Final = (13_900, 6900, 2400)
"""Bit rates of burst data that captures have, falling."""


def im_airtime_ns(payload_bytes: int) -> int:
    """Return the airtime of an instant message, ns, whole microseconds.

    Args:
        payload_bytes: 1 or more, including a piggyback message that goes with it.
    """
    place = min(max(bisect_left(_SIZES, payload_bytes), 1), len(_SIZES) - 1)
    low, high = _SIZES[place - 1], _SIZES[place]
    slope = (_TABLE_US[high] - _TABLE_US[low]) / (high - low)
    return round(_TABLE_US[low] + slope * (payload_bytes - low)) * 1000


def service_airtime_ns(piggyback_bytes: int) -> int:
    """Return the airtime of an acknowledgement, ns; a piggyback message determines it."""
    return im_airtime_ns(piggyback_bytes) if piggyback_bytes else ACKNOWLEDGEMENT_NS


def burst_airtime_ns(payload_bytes: int, bit_rate_bps: int) -> int:
    """Return the airtime of a train of burst packets, ns, whole microseconds."""
    return _BURST_PREAMBLE_NS + round(payload_bytes * 8_000_000 / bit_rate_bps) * 1000


def equivalent_bytes(airtime_ns: int) -> int:
    """Return the size of the instant message with about that airtime, 1…64 bytes.

    The error rates of the channel are those of instant messages; other signals are as vulnerable as
    the message of their length.
    """
    fits = [size for size in _SIZES if _TABLE_US[size] * 1000 <= airtime_ns]
    return min(max(fits, default=1), IM_LIMIT_BYTES)
