"""The text of a QoS profile in a token of rmw_zenoh.

::

    reliability:durability:history,depth:deadline s,ns:lifespan s,ns:liveliness,lease s,ns

A part is empty where it is the default: reliable, volatile, keep last 42, no deadline, no lifespan,
automatic, no lease. So ``::,10:,:,:,,`` is the default profile with a depth of 10.
"""

import enum
from typing import Final

import msgspec

from zacoustic.text.digits import whole_number

DEFAULT_DEPTH: Final = 42
"""The default depth."""

_TIMES: Final = ",:,:,,"


class RosReliability(enum.Enum):
    """The words of ROS, with the numbers of rmw."""

    RELIABLE = 1
    BEST_EFFORT = 2


class RosDurability(enum.Enum):
    """The words of ROS, with the numbers of rmw."""

    TRANSIENT_LOCAL = 1
    VOLATILE = 2


class RosQos(msgspec.Struct, frozen=True, kw_only=True):
    """The QoS of an endpoint in rmw_zenoh's form."""

    reliability: RosReliability = RosReliability.RELIABLE
    """Of the publisher or subscription."""
    durability: RosDurability = RosDurability.VOLATILE
    """Of the publisher or subscription."""
    keeps_all: bool = False
    """History: all, or the newest `depth`."""
    depth: int = DEFAULT_DEPTH
    """Number of kept samples."""
    times: str = _TIMES
    """Deadline, lifespan and liveliness, as text."""

    def __str__(self) -> str:
        """The text in a token."""
        reliability = "" if self.reliability is RosReliability.RELIABLE else "2"
        durability = "" if self.durability is RosDurability.VOLATILE else "1"
        history = "2" if self.keeps_all else ""
        depth = "" if self.depth == DEFAULT_DEPTH else str(self.depth)
        return f"{reliability}:{durability}:{history},{depth}:{self.times}"


def read_qos(text: str) -> RosQos | None:
    """Read the text of a profile; None: it is invalid."""
    parts = text.split(":", 3)
    if len(parts) != 4 or parts[2].count(",") != 1:
        return None
    history, depth = parts[2].split(",")
    numbers = [part or "0" for part in (parts[0], parts[1], history, depth)]
    if any(whole_number(number) is None for number in numbers):
        return None
    return RosQos(
        reliability=RosReliability.BEST_EFFORT if numbers[0] == "2" else RosReliability.RELIABLE,
        durability=(RosDurability.TRANSIENT_LOCAL if numbers[1] == "1" else RosDurability.VOLATILE),
        keeps_all=numbers[2] == "2",
        depth=int(depth) if depth else DEFAULT_DEPTH,
        times=parts[3],
    )
