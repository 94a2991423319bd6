"""The water between the two modems as a picture of time and distance: each frame a slanted stripe.

Below is the shore, above the vehicle, to the right is now. A frame of the shore climbs, one of the
vehicle comes down; its width is its airtime, its slope the speed of sound. What the vehicle sends
is known when it has arrived, so the right end is empty of it: that is what waiting feels like.
"""

from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from examples.auv.drawing import DIM, GRID, Size
from examples.auv.linkwatch import Frame
from examples.auv.messages import (
    ARM,
    GOTO,
    HOLD,
    JOINTS,
    NAV,
    PHOTO,
    STATUS,
    STOP,
    TAKE_PHOTO,
)

LADDER_PX: Final[Size] = (620, 130)
SPAN_S: Final = 30.0
AHEAD_S: Final = 2.0
"""How much of the future is drawn: where frames on their way will arrive."""


class Kind(msgspec.Struct, frozen=True):
    """What a frame is for."""

    name: str
    colour: str


STOPPING: Final = Kind("stop", "#ef5b5b")
STEERING: Final = Kind("set-point", "#e6cf53")
MISSION: Final = Kind("mission", "#5fd08a")
REPORT: Final = Kind("report", "#4fb6e3")
PICTURE: Final = Kind("photo", "#b48cf2")
OTHER: Final = Kind("acknowledgement", "#8097a6")
KINDS: Final = (STOPPING, STEERING, MISSION, REPORT, PICTURE, OTHER)
"""By what matters most to who waits."""

_KIND_OF: Final = {
    STOP: STOPPING,
    **dict.fromkeys(JOINTS, STEERING),
    **dict.fromkeys((ARM, HOLD, TAKE_PHOTO, GOTO), MISSION),
    **dict.fromkeys((NAV, STATUS), REPORT),
    PHOTO: PICTURE,
}


def kind_of(frame: Frame) -> Kind:
    """Return what a frame is for: of all that is in it, what matters most."""
    found = {_KIND_OF.get(each, OTHER) for each in frame.streams}
    return next((each for each in KINDS if each in found), OTHER)


def ladder_of(
    frames: Sequence[Frame], propagation_s: float, unix_s: float, size: Size = LADDER_PX
) -> str:
    """Draw the last half minute of the channel.

    Args:
        frames: Of the shore and of the vehicle.
        propagation_s: From one to the other, s.
        unix_s: Now.
        size: Of the picture.
    """
    width, height = size
    left, top, bottom = 52.0, 16.0, height - 16.0
    second_px = (width - left) / (SPAN_S + AHEAD_S)

    def x_of(at_s: float) -> float:
        return left + (at_s - unix_s + SPAN_S) * second_px

    now_x = x_of(unix_s)
    drawn = [
        f'<path d="M{left},{top} H{width} M{left},{bottom} H{width}" stroke="{DIM}"/>',
        _word(left - 6, top + 4, "vehicle", anchor="end"),
        _word(left - 6, bottom + 4, "shore", anchor="end"),
    ]
    for seconds in range(5, int(SPAN_S) + 1, 5):
        x = x_of(unix_s - seconds)
        drawn.append(f'<path d="M{x:.1f},{top} V{bottom}" stroke="{GRID}"/>')
        drawn.append(_word(x, height - 3, f"−{seconds} s"))
    drawn.append(f'<clipPath id="sea"><rect x="{left}" y="0" width="{width}" height="200"/>')
    drawn.append('</clipPath><g clip-path="url(#sea)">')
    drawn += [_stripe(frame, propagation_s, x_of, (top, bottom)) for frame in frames]
    drawn.append("</g>")
    drawn.append(
        f'<path d="M{now_x:.1f},{top - 8} V{bottom + 4}" stroke="#d7e2ea" stroke-dasharray="2 3"/>'
    )
    drawn.append(_word(now_x, height - 3, "now"))
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="water" '
        f'preserveAspectRatio="xMinYMid meet">{"".join(drawn)}</svg>'
    )


def _stripe(
    frame: Frame, propagation_s: float, x_of: Callable[[float], float], edges: tuple[float, float]
) -> str:
    """Draw the way of one frame; one that was not heard at its end ends pale."""
    begins = frame.begun_unix_s - (propagation_s if frame.way == "in" else 0.0)
    from_y, to_y = edges if frame.way == "in" else reversed(edges)
    corners = (
        (begins, from_y),
        (begins + frame.airtime_s, from_y),
        (begins + frame.airtime_s + propagation_s, to_y),
        (begins + propagation_s, to_y),
    )
    points = " ".join(f"{x_of(at_s):.1f},{y:.1f}" for at_s, y in corners)
    is_failed = frame.outcome in ("not_delivered", "rejected", "aborted")
    kind = kind_of(frame)
    return (
        f'<polygon points="{points}" fill="{kind.colour}" '
        f'opacity="{0.3 if is_failed else 0.85}"><title>{kind.name}, {frame.bytes} bytes</title>'
        "</polygon>"
    )


def _word(x: float, y: float, text: str, anchor: str = "middle") -> str:
    return (
        f'<text x="{x:.0f}" y="{y:.0f}" font-size="10" fill="{DIM}" text-anchor="{anchor}">'
        f"{text}</text>"
    )
