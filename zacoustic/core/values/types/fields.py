"""`FieldSpec`: what one field of a type is, and which values it allows.

The record is checked and normalised when it is made: ranges and steps become `float` in float
fields and `int` in integer fields, so that ``[-90, 90]`` and ``[-90.0, 90.0]`` are the same field
and have the same digest.
"""

import math
import re
from difflib import get_close_matches
from typing import Annotated, Final, TypeAlias

import msgspec
from msgspec import Meta

from zacoustic.core.values.types.quantiser import MAX_COUNT, Quantiser
from zacoustic.errors import ConfigError
from zacoustic.text.allowed import check_fields, one_of

INTEGER_LIMITS: Final[dict[str, tuple[int, int]]] = {
    "int8": (-(1 << 7), (1 << 7) - 1),
    "int16": (-(1 << 15), (1 << 15) - 1),
    "int32": (-(1 << 31), (1 << 31) - 1),
    "int64": (-(1 << 63), (1 << 63) - 1),
    "uint8": (0, (1 << 8) - 1),
    "uint16": (0, (1 << 16) - 1),
    "uint32": (0, (1 << 32) - 1),
    "uint64": (0, (1 << 64) - 1),
}
"""Integer types, and the least and greatest value of each."""

FLOAT_TYPES: Final = ("float32", "float64")
"""Floating-point types."""

SCALAR_TYPES: Final = ("bool", *INTEGER_LIMITS, *FLOAT_TYPES, "string", "bytes", "enum")
"""Every type that is not the name of another type."""

FLOAT32_MAX: Final = (2 - 2**-23) * 2.0**127
"""Greatest finite float32."""

# A list or text longer than this is an object, not a field: it needs a stream of its own.
MAX_LENGTH: Final = 65535
"""Greatest `length` and `max_length`."""

OUTSIDE_WORDS: Final = ("reject", "clamp", "escape")
"""The treatments of a value outside of the bounds."""

_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")

Number = int | float
Default = bool | int | float | str
Span: TypeAlias = Annotated[
    tuple[Number, Number], Meta(description="a list of two numbers, [low, high]")
]
Step: TypeAlias = Annotated[
    Annotated[int, Meta(gt=0)] | Annotated[float, Meta(gt=0)],
    Meta(description='a number above 0, or a ratio as "1/60000"'),
]
Length: TypeAlias = Annotated[int, Meta(ge=1, le=MAX_LENGTH)]
Outside: TypeAlias = Annotated[str, one_of(OUTSIDE_WORDS)]
Names: TypeAlias = Annotated[tuple[str, ...], Meta(description="a list of texts")]


class FieldSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One field of a type.

    Raises:
        ConfigError: The parts contradict each other; the message starts with the key.
    """

    name: str
    """Identifier: letters, digits, underscores."""
    type: Annotated[str, Meta(description=f"{', '.join(SCALAR_TYPES)}, or the name of a type")]
    """One of `SCALAR_TYPES`, or the name of another type."""
    range: Span | None = None
    """Least and greatest value, both allowed, in `unit`; numeric types only."""
    step: Step | None = None
    """Values cross as the nearest multiple of this, in `unit`; numeric types only."""
    unit: str = ""
    """Unit for people: in messages, never on the wire."""
    wraps: bool = False
    """Whether the ends of `range` are the same value, as for a heading: values outside are folded
    in."""
    values: Names = ()
    """The names of an enum; their position crosses, so append and never reorder."""
    length: Length | None = None
    """Number of elements of a fixed array; None: not a fixed array."""
    max_length: Length | None = None
    """The most elements of a bounded array; for a string or bytes, the most bytes."""
    min_length: Length | None = None
    """The fewest bytes of a string or bytes."""
    optional: bool = False
    """Whether the value may be missing or null."""
    default: Annotated[Default, Meta(description="a value of the field's type")] | None = None
    """Value of a missing field; scalars only. Not part of the type's digest: the value crosses."""
    outside: Outside = "reject"
    """Treatment of a value outside of the bounds, one of `OUTSIDE_WORDS`; the last two are counted.
    ``reject``: it is refused. ``clamp``: a number is moved to the nearer end of `range`, a long
    list or text is cut, an unknown value of an enum becomes the default or is missing. ``escape``:
    a number is carried in the full width of its type."""
    nan: bool = False
    """Whether a float may be no value: not a number, or an infinity, whatever its range."""

    def __post_init__(self) -> None:
        """Check and normalise.

        Raises:
            ConfigError: The message starts with the key.
        """
        check_fields(self, ConfigError)
        if not _NAME.fullmatch(self.name):
            raise ConfigError(f'name: "{self.name}"; allowed: letters, digits and underscores')
        if not self.type:
            raise ConfigError(f'type: ""; allowed: {", ".join(SCALAR_TYPES)}, or a type')
        if self.is_nested:
            self._check_nested()
        self._check_lengths()
        self._check_values()
        if self.is_numeric:
            self._check_numbers()
        else:
            for key in ("range", "step"):
                if getattr(self, key) is not None:
                    raise ConfigError(f"{key}: not for type {self.type}; allowed: numeric types")
            if self.wraps:
                raise ConfigError(f"wraps: not for type {self.type}; allowed: numeric types")
        self._check_outside()
        if self.nan and self.type not in FLOAT_TYPES:
            raise ConfigError(f"nan: not for type {self.type}; allowed: {', '.join(FLOAT_TYPES)}")
        if self.default is not None and (self.is_array or self.is_nested):
            raise ConfigError("default: not for arrays and nested types; allowed: scalars")

    @property
    def is_integer(self) -> bool:
        """Whether the elements are integers."""
        return self.type in INTEGER_LIMITS

    @property
    def is_numeric(self) -> bool:
        """Whether the elements are integers or floats."""
        return self.type in INTEGER_LIMITS or self.type in FLOAT_TYPES

    @property
    def is_nested(self) -> bool:
        """Whether `type` names another type."""
        return self.type not in SCALAR_TYPES

    @property
    def is_array(self) -> bool:
        """Whether the value is a list of elements."""
        return self.length is not None or self.is_bounded_array

    @property
    def is_bounded_array(self) -> bool:
        """Whether the value is a list whose length crosses."""
        return (
            self.max_length is not None
            and self.length is None
            and self.type not in ("string", "bytes")
        )

    @property
    def limits(self) -> tuple[Number, Number] | None:
        """Least and greatest value that the field can hold; None: any float, or not a number."""
        if self.range is not None:
            return self.range
        if self.step is not None and not self.is_integer:
            return -self.step * MAX_COUNT, self.step * MAX_COUNT
        return INTEGER_LIMITS.get(self.type)

    @property
    def bounds(self) -> tuple[Number, Number]:
        """The `limits` of a field that has them.

        Raises:
            TypeError: It holds any float, or is not a number.
        """
        limits = self.limits
        if limits is None:
            raise TypeError(f"{self.name} of type {self.type} has no limits")
        return limits

    @property
    def capacity(self) -> int:
        """The most elements of an array.

        Raises:
            TypeError: It is no array.
        """
        capacity = self.max_length if self.length is None else self.length
        if capacity is None:
            raise TypeError(f"{self.name} of type {self.type} is no array")
        return capacity

    @property
    def escapes(self) -> bool:
        """Whether numbers outside of `range` are carried as well."""
        return self.outside == "escape"

    @property
    def may_be_nan(self) -> bool:
        """Whether NaN is among the values of an element."""
        is_free = self.range is None and self.step is None
        return self.type in FLOAT_TYPES and (self.nan or self.escapes or is_free)

    @property
    def can_clamp(self) -> bool:
        """Whether a value outside of the bounds has a substitute."""
        if self.is_numeric and self.range is not None and not self.wraps:
            return True
        if self.type == "enum" and not self.is_array:
            return self.optional or self.default is not None
        return self.max_length is not None

    @property
    def quantiser(self) -> Quantiser | None:
        """Converts numbers to counts of the step; None without a step."""
        limits = self.limits
        if self.step is None or limits is None:
            return None
        return Quantiser(self.step, limits, wraps=self.wraps)

    @property
    def counting(self) -> Quantiser:
        """The `quantiser` of a field with a step.

        Raises:
            TypeError: It has no step.
        """
        quantiser = self.quantiser
        if quantiser is None:
            raise TypeError(f"{self.name} of type {self.type} has no step")
        return quantiser

    @property
    def allowed(self) -> str:
        """The allowed values of an element, in words, with the unit."""
        unit = (f" {self.unit}" if self.unit else "") + (" or nan" if self.nan else "")
        if self.is_numeric and (self.range is not None or self.is_integer):
            low, high = self.limits or (0, 0)
            return f"{_plain(low)}..{_plain(high)}{unit}"
        if self.type == "enum":
            return ", ".join(self.values)
        if self.type in ("string", "bytes") and self.allowed_bytes:
            return f"{self.type} of {self.allowed_bytes}"
        if self.is_numeric:
            return f"a {'finite ' if self.step is not None else ''}number{unit}"
        return "true, false" if self.type == "bool" else self.type

    @property
    def allowed_bytes(self) -> str:
        """How many bytes a text or bytes may have, in words; empty: any number."""
        least, most = self.min_length, self.max_length
        if least is None:
            return "" if most is None else f"at most {most} bytes"
        if most is None:
            return f"at least {least} bytes"
        return f"{least} bytes" if least == most else f"{least} to {most} bytes"

    def _check_nested(self) -> None:
        """Refuse keys that only built-in types have: the type's name is probably misspelt."""
        for key in ("range", "step", "wraps", "values", "nan"):
            if getattr(self, key):
                close = get_close_matches(self.type, SCALAR_TYPES, 1)
                raise ConfigError(
                    f'type: "{self.type}" is not built in, and has {key}; '
                    f"allowed: {', '.join(SCALAR_TYPES)}",
                    hint=f'did you mean "{close[0]}"?' if close else "",
                )

    def _check_outside(self) -> None:
        if self.outside == "reject":
            return
        if self.outside == "clamp" and self.can_clamp:
            return
        if self.outside == "escape" and self.range is not None and not self.wraps:
            return
        allowed = "with a range that does not wrap"
        if self.outside == "clamp":
            allowed += ", a max_length, or for an enum with default or optional"
        what = "wraps" if self.wraps else "without range"
        raise ConfigError(f'outside: "{self.outside}" {what}; allowed: {allowed}')

    def _check_lengths(self) -> None:
        both = self.length is not None and self.max_length is not None
        if both and self.type not in ("string", "bytes"):
            raise ConfigError(f"max_length: {self.max_length} beside length; allowed: one of them")
        if self.min_length is None:
            return
        if self.type not in ("string", "bytes"):
            raise ConfigError(f"min_length: not for type {self.type}; allowed: string, bytes")
        if self.max_length is not None and self.min_length > self.max_length:
            raise ConfigError(
                f"min_length: {self.min_length}; allowed: at most max_length, {self.max_length}"
            )

    def _check_values(self) -> None:
        if self.type != "enum":
            if self.values:
                raise ConfigError(f"values: not for type {self.type}; allowed: type enum")
            return
        if not self.values:
            raise ConfigError("values: missing; allowed: a list of names, at least one")
        for index, value in enumerate(self.values):
            if not value or not value.isprintable():
                raise ConfigError(f"values[{index}]: {value!r}; allowed: printable names")
            if value in self.values[:index]:
                raise ConfigError(f'values[{index}]: "{value}" a second time; allowed: once')

    def _check_numbers(self) -> None:
        if self.range is not None:
            low, high = (self._number("range", bound) for bound in self.range)
            if not low < high:
                raise ConfigError(f"range: {_written(self.range)}; allowed: low < high")
            least, greatest = INTEGER_LIMITS.get(self.type, (-math.inf, math.inf))
            if self.type == "float32":
                least, greatest = -FLOAT32_MAX, FLOAT32_MAX
            if low < least or high > greatest:
                raise ConfigError(
                    f"range: {_written(self.range)} does not fit {self.type}; "
                    f"allowed: {least}..{greatest}"
                )
            # Converted, not rounded: a frozen record is only ever changed here, while it is made.
            msgspec.structs.force_setattr(self, "range", (low, high))
        elif self.wraps:
            raise ConfigError("wraps: true without range; allowed: with a range [low, high]")
        if self.step is not None:
            self._check_step(self.step)

    def _check_step(self, written: Number) -> None:
        step = self._number("step", written)
        msgspec.structs.force_setattr(self, "step", step)
        low, high = self.bounds
        if self.range is not None and step > high - low:
            raise ConfigError(f"step: {step} is more than the range; allowed: at most {high - low}")
        if not self.is_integer and max(abs(low), abs(high)) / step > MAX_COUNT:
            raise ConfigError(
                f"step: {step} is too small for {self.allowed}; "
                f"allowed: at least {max(abs(low), abs(high)) / MAX_COUNT:.3g}"
            )
        if self.wraps and not Quantiser(step, (low, high), wraps=True).closes:
            raise ConfigError(
                f"step: {step} does not divide range {_written((low, high))}, which wraps; "
                "allowed: low a multiple of step"
            )

    def _number(self, key: str, value: Number) -> Number:
        """Return `value` as a number of the field's own kind."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ConfigError(f"{key}: {value!r}; allowed: a number")
        if self.is_integer:
            if isinstance(value, float) and not value.is_integer():
                raise ConfigError(f"{key}: {value} for type {self.type}; allowed: whole numbers")
            return int(value)
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise ConfigError(f"{key}: {value}; allowed: finite numbers")
        return number + 0.0  # -0.0 becomes 0.0: one canonical form


def _plain(number: Number) -> str:
    """Return the number without a needless ".0"."""
    return f"{number:.16g}" if isinstance(number, float) else str(number)


def _written(bounds: tuple[Number, Number]) -> str:
    """Return the bounds as the config has them."""
    return f"[{bounds[0]}, {bounds[1]}]"
