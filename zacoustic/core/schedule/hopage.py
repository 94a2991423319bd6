"""How long a frame has been on its way that other links carry: each hop adds its part.

The frame of a route, a flood or a bond is made once, and goes later, perhaps several times. An age
within it, which its source has written and perhaps sealed, is that of its making. So the frame of
each hop says how old the one inside is: who passes it on knows when it was made by its own clock.
Nothing authenticates that. Whoever can alter it can as well keep the frame for a while.
"""

from typing import Final

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.linktypes import ReceivedFrame
from zacoustic.core.values.age import decode_age, encode_age

UNBOUNDED: Final = (0, None)
"""The travel of a frame that does not say how old it is: any."""


def hop_age(made_at: int | None, now: int) -> int:
    """Return the code for a frame that goes now and was made then; None: nobody knows when."""
    return encode_age(None if made_at is None else now - made_at)


def travelled(frame: ReceivedFrame, code: int, hops: int = 1) -> tuple[int, int | None] | None:
    """Return how long the frame inside a hop's frame was on its way, and the error of that, ns.

    Args:
        frame: The frame of the hop, with its own travel.
        code: The age in it.
        hops: How many hops it has behind it, this one included: each has errors of its own.

    Returns:
        None: unknown.
    """
    age = decode_age(code)
    if age.seconds is None or frame.travel is None:
        return None
    hop_ns, hop_error_ns = frame.travel
    travel_ns = seconds_to_ns(age.seconds) + hop_ns
    if age.error_s is None or hop_error_ns is None:
        return travel_ns, None
    return travel_ns, hops * (seconds_to_ns(age.error_s) + hop_error_ns)


def made_before(frame: ReceivedFrame, travel: tuple[int, int | None] | None) -> int | None:
    """Return when the frame inside was made, by the clock here, ns; None: unknown."""
    return None if travel is None else frame.received_at - travel[0]
