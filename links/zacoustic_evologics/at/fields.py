"""The fields of the grammar: each with its kind and its limits, for the annotations of the records.

Limits are the widest that a source shows, or that the width of the number allows; only documented
ranges (addresses, flags, sizes) are narrow. A value outside its limits makes a modem's message
unrecognised. The numbers of a host's command are read whatever they are, since the modem must be
able to refuse them, and written within the limits.

A float always gets its decimal point, since a parser of the vendor refuses one without it.
"""

from typing import Annotated, Final, TypeAlias

from zacoustic.core.linktypes import BROADCAST
from zacoustic.link.fields import (
    Asked,
    Decimal,
    Field,
    Integer,
    Level,
    Maybe,
    Padded,
    Seconds,
    Several,
    Switch,
    Text,
)
from zacoustic_evologics.at.framing import PAYLOAD_LIMIT_BYTES

IM_LIMIT_BYTES: Final = 64
"""Longest payload of an instant, synchronous or piggyback message."""
BURST_LIMIT_BYTES: Final = 1024
"""Longest burst written: a convention of several drivers; no source knows the modem's limit."""
CLOCK_SPAN_US: Final = 1 << 32
"""The modem's clock wraps here, after 71.6 minutes: drivers read it as 32 bits."""


class Payload(Field):
    """A payload: the text of its length, which stands in the header; the bytes follow the header.

    Args:
        longest: Longest payload, bytes.
        shortest: Shortest one, bytes.
        read: Longest one that is read; None: `longest`.
    """

    pattern = "[0-9]{1,6}"

    def __init__(self, longest: int, shortest: int = 0, read: int | None = None) -> None:
        self.longest = longest
        self.shortest = shortest
        self.longest_read = longest if read is None else read

    def encode(self, value: object) -> str:
        """Write the length of a payload."""
        if not isinstance(value, bytes):
            raise ValueError(f"{value!r} is no payload")
        if not self.shortest <= len(value) <= self.longest:
            raise ValueError(f"{len(value)} bytes; allowed: {self.shortest}..{self.longest}")
        return str(len(value))


_ANY: Final = Integer(0, 2**32 - 1)

Address: TypeAlias = Annotated[int, Integer(0, BROADCAST)]
"""Any address: 0 none or any, 1…254 a modem, 255 broadcast."""
Modem: TypeAlias = Annotated[int, Asked(_ANY, Integer(1, BROADCAST - 1))]
"""In a command, the address of one modem."""
Target: TypeAlias = Annotated[int, Asked(_ANY, Integer(1, BROADCAST))]
"""In a command, the address of one modem, or broadcast."""
ProtocolId: TypeAlias = Annotated[int | None, Maybe(Integer(0, 7), "p", ",")]
"""The `p<pid>` of extended networking."""
AskedProtocolId: TypeAlias = Annotated[
    int | None, Maybe(Asked(Integer(0, 999, digits=3), Integer(0, 7)), "p", ",")
]
"""In a command, the `p<pid>` of extended networking."""
MessageSent: TypeAlias = Annotated[bytes, Payload(IM_LIMIT_BYTES, 1, PAYLOAD_LIMIT_BYTES)]
"""The payload of an instant, synchronous or piggyback message, to send."""
MessageReceived: TypeAlias = Annotated[bytes, Payload(IM_LIMIT_BYTES)]
"""The same, received."""
BurstSent: TypeAlias = Annotated[bytes, Payload(BURST_LIMIT_BYTES, 1, PAYLOAD_LIMIT_BYTES)]
"""The payload of burst data, to send."""
AnyPayload: TypeAlias = Annotated[bytes, Payload(PAYLOAD_LIMIT_BYTES)]
"""A payload without a known limit."""
Clock: TypeAlias = Annotated[int, Integer(0, CLOCK_SPAN_US - 1)]
"""The modem's clock, µs."""
Start: TypeAlias = Annotated[int | None, Maybe(Integer(0, CLOCK_SPAN_US - 1))]
"""The modem's clock at the beginning of a signal, µs; empty: at once."""
Duration: TypeAlias = Annotated[int, _ANY]
"""A duration, µs; the longest known are bursts of some seconds."""
Count: TypeAlias = Annotated[int, _ANY]
"""A count of packets or bytes."""
Rate: TypeAlias = Annotated[int, Integer(0, 10_000_000)]
"""Acoustic bit rate, bit/s; the fastest known modem has 62 500."""
SourceLevelNumber: TypeAlias = Annotated[int, Integer(0, 3)]
"""0 is the loudest, 3 the quietest."""
Rssi: TypeAlias = Annotated[int, Level(-1000, 1000)]
"""Received level, dB re 1 V; observed: -20…-85."""
Integrity: TypeAlias = Annotated[int, Level(-100_000, 100_000)]
"""Signal integrity; above 100 is good, but proves no delivery."""
Velocity: TypeAlias = Annotated[float, Decimal(4, 10_000.0)]
"""Relative velocity, m/s."""
RAW_METRES: Final = Decimal(4, 1e30)
"""A position from three hydrophones before it is judged: a geometry without a solution gives
whatever the division gave, far beyond any place."""
Metres: TypeAlias = Annotated[float, Decimal(4, 1_000_000.0)]
"""A distance or a coordinate, m."""
Angle: TypeAlias = Annotated[float, Decimal(4, 100.0)]
"""An angle, rad."""
Accuracy: TypeAlias = Annotated[float, Decimal(4, 1_000_000.0)]
"""Uncertainty of a fix, m or rad; negative when there is none."""
Reading: TypeAlias = Annotated[float, Decimal(4, 1_000_000.0)]
"""A measurement with decimals."""
SystemClock: TypeAlias = Annotated[int, Seconds()]
"""Time of the modem's system clock, µs: since it started, or Unix time."""
SIGNED: Final = Integer(-(2**63) + 1, 2**63 - 1)
Signed: TypeAlias = Annotated[int, SIGNED]
"""A number without known limits."""
Word: TypeAlias = Annotated[str, Text(r"[!-+\--~ ]{1,40}")]
"""A word without a known list: printable ASCII without a comma."""
Name: TypeAlias = Annotated[str, Text("[A-Z]{1,12}")]
"""The name of a setting, a measurement or an extension."""
Key: TypeAlias = Annotated[str, Text("[?!@&%*]?[A-Z]{1,12}")]
"""A command without its parameters."""
ExtensionKey: TypeAlias = Annotated[str, Text(r"[\t -+\--~]+")]
"""The key of a message of the vendor's middleware."""
ExtensionText: TypeAlias = Annotated[str, Maybe(Text(r"[\t -~]*"), ",", missing="")]
"""The rest of such a message."""
Parameters: TypeAlias = Annotated[str, Maybe(Text("[ -~]*"), ",", missing="")]
"""The rest of a command behind a comma."""
DIGITS: Final = Integer(0, 9_999_999_999, digits=10)
"""Up to ten digits."""
Value: TypeAlias = Annotated[int, DIGITS]
"""The new value of a setting; its limits are in `settings`."""
OptionalValue: TypeAlias = Annotated[int | None, Maybe(DIGITS)]
"""The same, or none."""
ActionValue: TypeAlias = Annotated[int | None, Maybe(Integer(0, 255, digits=3))]
"""The number behind the letter of an action."""
Starred: TypeAlias = Annotated[bool, Switch("[*]")]
"""The prefix `[*]` of some answers."""
Reason: TypeAlias = Annotated[str, Maybe(Field(), " ", missing="")]
"""Why a modem refuses."""
Line: TypeAlias = Annotated[str, Field()]
"""Any text of one line."""
Label: TypeAlias = Annotated[str, Text(r"(?!\[\*\])[^:\r\n]+")]
"""The vendor's name of a setting, behind the prefix if there is one."""
Shown: TypeAlias = Annotated[int, Padded(SIGNED, " ")]
"""The value of a setting behind its name."""
FreeBytes: TypeAlias = Annotated[tuple[int, ...], Several(_ANY, separator=" ")]
"""Room in a transmit buffer, for each channel."""
State: TypeAlias = Annotated[str, Text("[A-Z_]+(?: [A-Z_]+)*")]
"""The state of a modem: words in capital letters."""
