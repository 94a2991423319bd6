"""The controls of medium access: who may transmit, when a node listens, network time.

::

    BD  time 6  error 1     CLOCK   network time at the first bit of this frame, in 100 µs since
                                    1970 (UTC), and its largest error, ms (255: more)
    BE  node 1  span 1      TURN    node 1…254 may transmit for the span from the end of this
                                    frame; node FF: the sender listens for a window, one span
                                    after the beginning of this frame; node 00: the sender gives
                                    its turn back

A span is in steps of 20 ms: 0…5.1 s.
"""

from typing import Final, TypeAlias

import msgspec

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.wire.controls import Form, fixed

CLOCK_CODE: Final = 0xBD
TURN_CODE: Final = 0xBE
CLOCK_BYTES: Final = 8
TURN_BYTES: Final = 3
"""Sizes with the code, bytes."""

SPAN_STEP_NS: Final = NS_PER_S // 50
LONGEST_SPAN_NS: Final = 255 * SPAN_STEP_NS
"""Longest span of a TURN, ns."""
NOBODY: Final = 0
"""Node of a TURN that gives the channel back."""
ANYBODY: Final = BROADCAST
"""Node of a TURN that announces a listen window."""

CLOCK_TICK_NS: Final = NS_PER_S // 10_000
"""Step of the time in a CLOCK, ns."""
_ERROR_STEP_NS: Final = NS_PER_S // 1000
_ERROR_UNKNOWN: Final = 255


class Turn(msgspec.Struct, frozen=True):
    """Which node may transmit from now on, or when the sender will listen."""

    node: int
    """Address of the node that may transmit, `ANYBODY` or `NOBODY`."""
    span_ns: int
    """The duration of the turn, or the time until the sender listens, ns; sent in steps of 20 ms,
    rounded down."""

    def encode(self) -> bytes:
        """Return the three bytes of the control."""
        steps = min(255, max(0, self.span_ns // SPAN_STEP_NS))
        return bytes((TURN_CODE, self.node, steps))

    @staticmethod
    def decode(body: bytes) -> "Turn":
        """Decode the two bytes after the code."""
        return Turn(body[0], body[1] * SPAN_STEP_NS)


class ClockTime(msgspec.Struct, frozen=True):
    """Network time at which the frame began to leave."""

    time_ns: int
    """Network time, ns since 1970; sent in steps of 100 µs."""
    error_ns: int | None
    """Its largest error, ns; sent in steps of 1 ms, rounded up; None: over 254 ms or unknown."""

    def encode(self) -> bytes:
        """Return the eight bytes of the control."""
        ticks = (self.time_ns + CLOCK_TICK_NS // 2) // CLOCK_TICK_NS % (1 << 48)
        steps = _ERROR_UNKNOWN
        if self.error_ns is not None:
            steps = min(_ERROR_UNKNOWN, -(-self.error_ns // _ERROR_STEP_NS))
        return bytes((CLOCK_CODE,)) + ticks.to_bytes(6, "big") + bytes((steps,))

    @staticmethod
    def decode(body: bytes) -> "ClockTime":
        """Decode the seven bytes after the code."""
        error_ns = None if body[6] == _ERROR_UNKNOWN else body[6] * _ERROR_STEP_NS
        return ClockTime(int.from_bytes(body[:6], "big") * CLOCK_TICK_NS, error_ns)


AccessControl: TypeAlias = Turn | ClockTime

FORMS: Final[tuple[Form, ...]] = (
    fixed(CLOCK_CODE, "CLOCK", CLOCK_BYTES, ClockTime.decode),
    fixed(TURN_CODE, "TURN", TURN_BYTES, Turn.decode),
)
