"""The kinds of fields in a text message of a modem, each with its text form and its limits.

The same kind reads and writes, so it does not read a value that it cannot write. One exception is
declared where it holds: `Asked`, for a number that a modem reads whatever it is, and then refuses.

A record names the kind of each field in its annotation, and `zacoustic.link.forms` puts fields
together to messages::

    Address = Annotated[int, Integer(0, 255)]

    class Delivered(msgspec.Struct, frozen=True):
        destination: Address

Methods raise `ValueError` for other values.
"""

import enum
import re
from typing import Final, get_args, get_type_hints

_DECIMAL: Final = r"-?[0-9]{1,31}(?:\.[0-9]{1,12})?"  # 1e30 has 31


class Field:
    """One kind of field; this one is any text of one line.

    Attributes:
        pattern: Regular expression of all of its texts, without groups that capture.
    """

    pattern = r"[^\r\n]*"

    def decode(self, text: str) -> object:
        """Return the value of a text that the pattern matches; raise ValueError if it has none."""
        return text

    def encode(self, value: object) -> str:
        """Return the text of a value; raise ValueError if it is not allowed."""
        if not isinstance(value, str) or not re.fullmatch(self.pattern, value):
            raise ValueError(f"{value!r} is not allowed; allowed: {self.pattern}")
        return value


class Text(Field):
    """Characters of a set, as a regular expression says it."""

    def __init__(self, pattern: str) -> None:
        self.pattern = pattern


class Integer(Field):
    """A whole number from `low` to `high`.

    Args:
        low: Lowest value.
        high: Highest value.
        digits: Most digits, without a sign; None: 19, perhaps with a minus.
    """

    def __init__(self, low: int, high: int, digits: int | None = None) -> None:
        self.low = low
        self.high = high
        self.pattern = "-?[0-9]{1,19}" if digits is None else f"[0-9]{{1,{digits}}}"

    def decode(self, text: str) -> int:
        """Read digits."""
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

    def __init__(self, low: int, high: int) -> None:
        super().__init__(low, high)
        self.pattern = _DECIMAL

    def decode(self, text: str) -> int:
        """Read a number."""
        return self._checked(round(float(text)))


class Decimal(Field):
    """A number written with a fixed number of decimals, read with or without; up to ±`limit`."""

    pattern = _DECIMAL

    def __init__(self, decimals: int, limit: float) -> None:
        self.decimals = decimals
        self.limit = limit

    def decode(self, text: str) -> float:
        """Read a number."""
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


class Seconds(Field):
    """Seconds with six decimals as text, whole microseconds as a value.

    Six decimals of a Unix time fit a float, sums of them do not. Decimals after the sixth are cut.
    """

    pattern = r"[0-9]{1,10}(?:\.[0-9]{1,12})?"

    def decode(self, text: str) -> int:
        """Read seconds."""
        whole, _, decimals = text.partition(".")
        return int(whole) * 1_000_000 + int(decimals.ljust(6, "0")[:6])

    def encode(self, value: object) -> str:
        """Write microseconds as seconds."""
        if not isinstance(value, int) or not 0 <= value < 10**16:
            raise ValueError(f"{value!r} is no time in µs; allowed: 0..{10**16 - 1}")
        return f"{value // 1_000_000}.{value % 1_000_000:06d}"


class Choice(Field):
    """A member of an enumeration whose values are the texts; a record needs no annotation for it.

    Args:
        kind: The enumeration.
    """

    def __init__(self, kind: type[enum.Enum]) -> None:
        self.kind = kind
        self.pattern = "|".join(re.escape(each.value) for each in kind)

    def decode(self, text: str) -> enum.Enum:
        """Look the text up."""
        return self.kind(text)

    def encode(self, value: object) -> str:
        """Write the text of a member."""
        if not isinstance(value, self.kind):
            raise ValueError(f"{value!r} is no {self.kind.__name__}")
        return str(value.value)


class Switch(Field):
    """True and False as two texts.

    Args:
        on: Text of True.
        off: Text of False.
        other_on: Further texts that are read as True. With them all else is read as False.
    """

    def __init__(self, on: str, off: str = "", *other_on: str) -> None:
        self.on = on
        self.off = off
        self._other_on = other_on
        if not other_on:
            self.pattern = f"(?:{re.escape(on)}|{re.escape(off)})"

    def decode(self, text: str) -> bool:
        """Compare the text."""
        return text == self.on or text in self._other_on

    def encode(self, value: object) -> str:
        """Write one of the two texts."""
        return self.on if value else self.off


class Maybe(Field):
    """A field that may be missing, together with the characters around it.

    Args:
        field: The field.
        before: Characters before it.
        after: Characters after it.
        missing: The value that stands for a missing field.
    """

    def __init__(
        self, field: Field, before: str = "", after: str = "", missing: object = None
    ) -> None:
        self.field = field
        self.missing = missing
        self._before = before
        self._after = after
        self.pattern = f"(?:{re.escape(before)}(?:{field.pattern}){re.escape(after)})?"

    def decode(self, text: str) -> object:
        """Read the field unless it is missing."""
        inner = text.removeprefix(self._before).removesuffix(self._after)
        return self.field.decode(inner) if inner else self.missing

    def encode(self, value: object) -> str:
        """Write the field, or nothing."""
        if value == self.missing:
            return ""
        return self._before + self.field.encode(value) + self._after


class Asked(Field):
    """A field of a command that is read more widely than written: a modem refuses it by itself.

    Args:
        reads: The kind that is read.
        writes: The kind that is written.
    """

    def __init__(self, reads: Field, writes: Field) -> None:
        self.reads = reads
        self.writes = writes
        self.pattern = reads.pattern

    def decode(self, text: str) -> object:
        """Read any value."""
        return self.reads.decode(text)

    def encode(self, value: object) -> str:
        """Write an allowed value."""
        return self.writes.encode(value)


class Several(Field):
    """Values of one kind in a row, as a tuple.

    Args:
        field: The kind of each.
        count: Their number; None: any number, each with the separator before it.
        separator: The character between them; none of the values has it.
    """

    def __init__(self, field: Field, count: int | None = None, separator: str = ",") -> None:
        self.field = field
        self.count = count
        self.separator = separator
        one, between = f"(?:{field.pattern})", re.escape(separator)
        self.pattern = f"(?:{between}{one})*" if count is None else between.join([one] * count)

    def decode(self, text: str) -> tuple[object, ...]:
        """Read all values."""
        pieces = text.split(self.separator)
        return tuple(self.field.decode(each) for each in pieces[1 if self.count is None else 0 :])

    def encode(self, value: object) -> str:
        """Write all values."""
        if not isinstance(value, tuple) or self.count not in (None, len(value)):
            raise ValueError(f"{value!r} is not allowed; allowed: a tuple of {self.count or 'any'}")
        texts = [self.field.encode(each) for each in value]
        return self.separator.join([""] * (self.count is None) + texts)


class Padded(Field):
    """A field with spaces around it; any number of them is read.

    Args:
        field: The field.
        before: Spaces written before it; empty: none are read there either.
        width: Least width as written, with spaces after it.
    """

    def __init__(self, field: Field, before: str = "", width: int = 0) -> None:
        self.field = field
        self.pattern = f"{' *' if before else ''}(?:{field.pattern}) *"
        self._before = before
        self._width = width

    def decode(self, text: str) -> object:
        """Read the field, whatever number of spaces is around it."""
        return self.field.decode(text.strip(" "))

    def encode(self, value: object) -> str:
        """Write the field with its spaces."""
        return self._before + self.field.encode(value).ljust(self._width)


def fields_of(record: type) -> dict[str, Field]:
    """Return the kinds of a record's fields, by name, in its order.

    A field without a kind in its annotation is not among them, unless it is an enumeration.
    """
    found: dict[str, Field] = {}
    for name, hint in get_type_hints(record, include_extras=True).items():
        # Of `Kind | None` the kind counts: not every form of a record has every field.
        for each in (hint, *get_args(hint)):
            kinds = [kind for kind in getattr(each, "__metadata__", ()) if isinstance(kind, Field)]
            if isinstance(each, type) and issubclass(each, enum.Enum):
                kinds.append(Choice(each))
            for kind in kinds:
                found.setdefault(name, kind)
    return found
