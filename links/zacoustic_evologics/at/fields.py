"""The kinds of fields between two commas, each with its text form and its limits.

The same field reads and writes, so it does not read a value that it cannot write: a number outside
its limits makes the record unrecognised. Limits are the widest that a source shows, or that the
width of the number allows; only documented ranges (addresses, flags) are narrow.

A float always gets its decimal point, since a parser of the vendor refuses one without it. Times
in seconds become integers of microseconds: six decimals of a Unix time fit a float, sums of them
do not.

Methods raise `ValueError` for other values; the decoders turn such text into data.
"""

import enum
import re
from typing import Final, Protocol

_INTEGER: Final = re.compile(r"-?[0-9]{1,19}")
_DECIMAL: Final = re.compile(r"-?[0-9]{1,31}(\.[0-9]{1,12})?")  # 1e30 has 31
_SECONDS: Final = re.compile(r"([0-9]{1,10})(?:\.([0-9]{1,12}))?")
_WORD: Final = re.compile(r"[!-+\--~ ]{1,40}")


class Field(Protocol):
    """One kind of field."""

    def decode(self, text: str) -> object:
        """Return the value of a text; raise ValueError if it has none."""
        ...

    def encode(self, value: object) -> str:
        """Return the text of a value; raise ValueError if it is not allowed."""
        ...


class Integer:
    """A whole number from `low` to `high`."""

    def __init__(self, low: int, high: int) -> None:
        self.low = low
        self.high = high

    def decode(self, text: str) -> int:
        """Read digits, with an optional minus."""
        if not _INTEGER.fullmatch(text):
            raise ValueError(f"{text!r} is no whole number")
        return self._checked(int(text))

    def encode(self, value: object) -> str:
        """Write a number."""
        if not isinstance(value, int) or isinstance(value, bool):
            raise ValueError(f"{value!r} is no whole number")
        return str(self._checked(value))

    def _checked(self, value: int) -> int:
        if not self.low <= value <= self.high:
            raise ValueError(f"{value} is out of range; allowed: {self.low}..{self.high}")
        return value


class Level(Integer):
    """A whole number that may come with decimals; they are rounded away."""

    def decode(self, text: str) -> int:
        """Read a number."""
        if not _DECIMAL.fullmatch(text):
            raise ValueError(f"{text!r} is no number")
        return self._checked(round(float(text)))


class Decimal:
    """A number written with a fixed number of decimals; magnitude up to `limit`."""

    def __init__(self, decimals: int, limit: float) -> None:
        self.decimals = decimals
        self.limit = limit

    def decode(self, text: str) -> float:
        """Read a number, with or without decimals."""
        if not _DECIMAL.fullmatch(text):
            raise ValueError(f"{text!r} is no number")
        return self._checked(float(text))

    def encode(self, value: object) -> str:
        """Write a number; round further decimals away."""
        if not isinstance(value, float | int) or isinstance(value, bool):
            raise ValueError(f"{value!r} is no number")
        return f"{self._checked(round(float(value), self.decimals)):.{self.decimals}f}"

    def _checked(self, value: float) -> float:
        if not abs(value) <= self.limit:
            raise ValueError(f"{value} is out of range; allowed: -{self.limit}..{self.limit}")
        return value


class Seconds:
    """Seconds with six decimals on the wire, whole microseconds in the record."""

    def decode(self, text: str) -> int:
        """Read seconds; cut decimals after the sixth."""
        match = _SECONDS.fullmatch(text)
        if not match:
            raise ValueError(f"{text!r} is no time in seconds")
        return int(match[1]) * 1_000_000 + int((match[2] or "").ljust(6, "0")[:6])

    def encode(self, value: object) -> str:
        """Write microseconds as seconds."""
        if not isinstance(value, int) or not 0 <= value < 10**16:
            raise ValueError(f"{value!r} is no time in µs; allowed: 0..{10**16 - 1}")
        return f"{value // 1_000_000}.{value % 1_000_000:06d}"


class Word:
    """Printable ASCII without a comma, 1…40 characters."""

    def decode(self, text: str) -> str:
        """Return the text unchanged."""
        if not _WORD.fullmatch(text):
            raise ValueError(f"{text!r} is no word")
        return text

    def encode(self, value: object) -> str:
        """Return the text unchanged."""
        if not isinstance(value, str):
            raise ValueError(f"{value!r} is no word")
        return self.decode(value)


class Choice:
    """A member of an enumeration whose values are the words on the wire."""

    def __init__(self, kind: type[enum.Enum]) -> None:
        self.kind = kind

    def decode(self, text: str) -> enum.Enum:
        """Look the word up; `ValueError` if it is missing."""
        return self.kind(text)

    def encode(self, value: object) -> str:
        """Write the word of a member."""
        if not isinstance(value, self.kind):
            raise ValueError(f"{value!r} is no {self.kind.__name__}")
        return str(value.value)


class Maybe:
    """A field that may be empty, which the record has as None."""

    def __init__(self, field: Field) -> None:
        self.field = field

    def decode(self, text: str) -> object:
        """Read the field unless it is empty."""
        return None if text == "" else self.field.decode(text)

    def encode(self, value: object) -> str:
        """Write the field, or nothing."""
        return "" if value is None else self.field.encode(value)


ADDRESS: Final = Integer(0, 255)
"""Any address: 0 none or any, 1…254 a modem, 255 broadcast."""
MODEM: Final = Integer(1, 254)
"""The address of one modem."""
TARGET: Final = Integer(1, 255)
"""The address of one modem, or broadcast."""
PROTOCOL_ID: Final = Integer(0, 7)
"""The `p<pid>` of extended networking."""
CLOCK_US: Final = Integer(0, 2**32 - 1)
"""The modem's clock, µs: drivers read it as 32 bits, so it wraps after 71.6 minutes."""
DURATION_US: Final = Integer(0, 2**32 - 1)
"""A duration, µs; the longest known are bursts of some seconds."""
COUNT: Final = Integer(0, 2**32 - 1)
"""A count of packets or bytes."""
BIT_RATE_BPS: Final = Integer(0, 10_000_000)
"""Acoustic bit rate, bit/s; the fastest known modem has 62 500."""
RSSI_DB: Final = Level(-1000, 1000)
"""Received level, dB re 1 V; observed: -20…-85."""
INTEGRITY: Final = Level(-100_000, 100_000)
"""Signal integrity; above 100 is good, but proves no delivery."""
VELOCITY_M_S: Final = Decimal(4, 10_000.0)
"""Relative velocity, m/s."""
RAW_METRES: Final = Decimal(4, 1e30)
"""A position from three hydrophones before it is judged: a geometry without a solution gives
whatever the division gave, far beyond any place."""
METRES: Final = Decimal(4, 1_000_000.0)
"""A distance, m."""
ANGLE_RAD: Final = Decimal(4, 100.0)
"""An angle, rad."""
ACCURACY: Final = Decimal(4, 1_000_000.0)
"""Uncertainty of a fix, m or rad; negative when there is none."""
SECONDS: Final = Seconds()
"""Time of the modem's system clock: since it started, or Unix time."""
SIGNED: Final = Integer(-(2**63) + 1, 2**63 - 1)
"""A number without known limits."""
WORD: Final = Word()
"""A word without a known list."""
