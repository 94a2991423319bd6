"""The age of a sample in one byte: how old it is as its frame begins.

Two ends of a channel have no common clock, and need none for the age of a value: the sender writes
how long the payload has waited, and the receiver adds how long the frame was on its way. Codes
0…100 are steps of 0.1 s, so the first ten seconds are exact to 0.05 s; codes 101…253 grow by a
constant factor to thirty days, 8.5 % a step; 254 means "older", and 255 that nobody knows. Both
sides make the same table from the constants, in floats that are rounded to milliseconds only once.
"""

import bisect
import math
from typing import Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S

_FINE_STEPS: Final = 100
_FINE_STEP_S: Final = 0.1
OLDEST_S: Final = 30 * 86_400.0
"""The age of `OLDER`, s: it is at least so old."""
_LAST_CODE: Final = 253
OLDER: Final = 254
"""The code of anything older than `OLDEST_S`."""
UNKNOWN: Final = 255
"""The code of what nobody knows the age of."""

_GROWTH: Final = (OLDEST_S / (_FINE_STEPS * _FINE_STEP_S)) ** (1 / (_LAST_CODE - _FINE_STEPS))
_AGES_S: Final = tuple(
    round(_FINE_STEP_S * code, 3)
    if code <= _FINE_STEPS
    else round(_FINE_STEPS * _FINE_STEP_S * _GROWTH ** (code - _FINE_STEPS), 3)
    for code in range(_LAST_CODE + 1)
)


class Age(msgspec.Struct, frozen=True):
    """An age, and how wrong it may be."""

    seconds: float | None
    """The age, s; `OLDEST_S`: at least so old; None: unknown."""
    error_s: float | None
    """How wrong it may be, s; None: nothing bounds that, or the age is unknown."""

    def later(self, passed_s: float, error_s: float | None = 0.0) -> "Age":
        """Return the age some seconds later, themselves known to within `error_s`."""
        if self.seconds is None:
            return self
        is_bounded = self.error_s is not None and error_s is not None
        return Age(
            self.seconds + passed_s,
            (self.error_s or 0.0) + (error_s or 0.0) if is_bounded else None,
        )


NO_AGE: Final = Age(None, None)
"""The age that nobody knows."""


def encode_age(age_ns: int | None) -> int:
    """Return the code, 0…255, of the age nearest to `age_ns`, ns; None: it is unknown.

    Negative ages count as 0.
    """
    if age_ns is None:
        return UNKNOWN
    age_s = age_ns / NS_PER_S
    if age_s > OLDEST_S:
        return OLDER
    above = bisect.bisect_left(_AGES_S, age_s)
    if above == 0:
        return 0
    if above > _LAST_CODE:
        return _LAST_CODE
    return above if _AGES_S[above] - age_s < age_s - _AGES_S[above - 1] else above - 1


def decode_age(code: int) -> Age:
    """Return the age that a code 0…255 stands for, as its frame began."""
    if code == UNKNOWN:
        return NO_AGE
    if code == OLDER:
        return Age(OLDEST_S, None)
    above_s = _AGES_S[min(code + 1, _LAST_CODE)]
    step_s = above_s - _AGES_S[code] or _AGES_S[code] - _AGES_S[code - 1]
    return Age(_AGES_S[code], round(step_s / 2, 4))


def age_words(seconds: float | None, error_s: float | None = None) -> str:
    """Return an age for people: "1.3 s old", "age unknown"."""
    if seconds is None:
        return "age unknown"
    if seconds >= OLDEST_S:
        return "over 30 days old"
    doubt = "" if error_s is None or error_s < 0.1 else f" ± {error_s:.1f} s"
    return f"{seconds:.1f} s old{doubt}" if math.isfinite(seconds) else "age unknown"
