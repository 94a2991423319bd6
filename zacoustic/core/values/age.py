"""The age of a sample in one byte: its waiting time when its frame was composed.

Two ends of a channel have no common clock, and need none for the age of a value: the sender writes
how long the payload has waited. Codes 0…100 are steps of 0.1 s, so the first ten seconds are exact
to 0.05 s; codes 101…254 grow by a constant factor to one hour, 3.9 % a step; 255 means "older than
an hour". Both sides make the same table from the two constants, in floats that are rounded to
milliseconds only once.
"""

import bisect
from typing import Final

from zacoustic.core.base.clock import NS_PER_S

_FINE_STEPS: Final = 100
_FINE_STEP_S: Final = 0.1
_LONGEST_S: Final = 3600.0
_LAST_CODE: Final = 254
OLDER: Final = 255
"""The code of anything older than an hour."""

_GROWTH: Final = (_LONGEST_S / (_FINE_STEPS * _FINE_STEP_S)) ** (1 / (_LAST_CODE - _FINE_STEPS))
_AGES_S: Final = tuple(
    round(_FINE_STEP_S * code, 3)
    if code <= _FINE_STEPS
    else round(_FINE_STEPS * _FINE_STEP_S * _GROWTH ** (code - _FINE_STEPS), 3)
    for code in range(_LAST_CODE + 1)
)


def encode_age(age_ns: int) -> int:
    """Return the code, 0…255, of the age nearest to `age_ns`, ns; negative ages count as 0."""
    age_s = age_ns / NS_PER_S
    if age_s > _LONGEST_S:
        return OLDER
    above = bisect.bisect_left(_AGES_S, age_s)
    if above == 0:
        return 0
    if above > _LAST_CODE:
        return _LAST_CODE
    return above if _AGES_S[above] - age_s < age_s - _AGES_S[above - 1] else above - 1


def decode_age_s(code: int) -> float:
    """Return the age, s, that a code 0…255 stands for; infinity for `OLDER`."""
    return float("inf") if code == OLDER else _AGES_S[code]
