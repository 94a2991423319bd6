"""Quality of service of a stream: the terms of ROS 2 and Zenoh, and their meaning for the queue.

Priorities are Zenoh's seven. `real_time` is absolute: such a sample is in the next frame, whatever
waits. Among the other six, waiting raises the value: a payload is ranked by its queueing instant
plus the *patience* of its priority, smallest first. So a fresh urgent sample overtakes a fresh slow
one by the difference of their patience, and no payload starves: after at most that difference no
new payload can get in front of it.
"""

import enum
from typing import Annotated, Final, TypeAlias

import msgspec
from msgspec import Meta

from zacoustic.core.base.clock import LONGEST_S, Duration, DurationOrZero, Share, seconds_to_ns
from zacoustic.text.allowed import check_fields


class Priority(enum.IntEnum):
    """Zenoh's priorities with Zenoh's numbers: the smaller, the sooner."""

    REAL_TIME = 1
    INTERACTIVE_HIGH = 2
    INTERACTIVE_LOW = 3
    DATA_HIGH = 4
    DATA = 5
    DATA_LOW = 6
    BACKGROUND = 7


PRIORITY_NAMES: Final = {priority.name.lower(): priority for priority in Priority}
"""The names that a config uses: Zenoh's, in lower case."""

# On a scale of frames that last about a second: an operator's command overtakes a minute of
# telemetry, and a background sample is never held back for more than a quarter of an hour.
PATIENCE_NS: Final = {
    Priority.INTERACTIVE_HIGH: 0,
    Priority.INTERACTIVE_LOW: seconds_to_ns(10),
    Priority.DATA_HIGH: seconds_to_ns(30),
    Priority.DATA: seconds_to_ns(60),
    Priority.DATA_LOW: seconds_to_ns(180),
    Priority.BACKGROUND: seconds_to_ns(900),
}
"""How much longer than an INTERACTIVE_HIGH payload one of this priority waits, ns."""


LEAST_DEADLINE_S: Final = 0.1
"""Shorter than any frame, so that a missed deadline is reported at most ten times a second."""
Deadline: TypeAlias = Annotated[float, Meta(ge=LEAST_DEADLINE_S, le=LONGEST_S, title="seconds")]
"""Longest promised period, s."""
Depth: TypeAlias = Annotated[int, Meta(ge=1, le=65535)]
"""Samples of a key that may wait."""


class Reliability(enum.Enum):
    """What happens to a lost sample."""

    BEST_EFFORT = "best_effort"
    """It is lost."""
    RELIABLE = "reliable"
    """It is repeated until every subscriber has acknowledged it, a newer one replaces it, or it is
    too old (`zacoustic.core.transport.reliable`)."""


class Stamp(enum.Enum):
    """How the receiver learns a sample's age."""

    NONE = "none"
    """It does not."""
    AGE = "age"
    """By one byte, written when the frame is composed; see `zacoustic.core.values.age`."""


class Durability(enum.Enum):
    """Which earlier samples late local subscribers get."""

    VOLATILE = "volatile"
    """None."""
    TRANSIENT_LOCAL = "transient_local"
    """The last ones, `Qos.depth` of each key, which the local gateway keeps."""


class Forward(enum.Enum):
    """When samples cross the channel."""

    ALWAYS = "always"
    """Always, whether any node listens or not."""
    ON_DEMAND = "on_demand"
    """Only to nodes that have subscribed (`zacoustic.core.transport.subscriptions`)."""


class Qos(msgspec.Struct, frozen=True, kw_only=True):
    """How a stream's payloads wait, and how long they are worth sending."""

    priority: Priority = Priority.DATA
    """The Zenoh priority."""
    reliability: Reliability = Reliability.BEST_EFFORT
    """What happens to a lost sample."""
    durability: Durability = Durability.VOLATILE
    """Which samples late joiners get. Local to each side: it changes nothing on the channel."""
    depth: Depth = 1
    """Samples kept per key while they wait, or while a subscriber has not acknowledged them, ≥ 1; a
    newer one displaces the oldest."""
    lifespan_s: Duration | None = None
    """A sample older than this is no longer sent, s, > 0; None: never too old."""
    deadline_s: Deadline | None = None
    """Longest promised period between two samples of a key, s, ≥ 0.1, > min_interval_s; None: no
    promise (`zacoustic.core.transport.topics.deadlines`)."""
    min_interval_s: DurationOrZero = 0.0
    """Minimum time between two transmitted samples of one key, s, ≥ 0; the newest wins."""
    linger_s: DurationOrZero = 0.0
    """How long a sample may wait for others in its frame, s, ≥ 0; REAL_TIME never lingers."""
    stamp: Stamp = Stamp.NONE
    """How the receiver learns the age."""
    forward: Forward = Forward.ALWAYS
    """When samples cross the channel."""
    exclusive: bool = False
    """Whether a payload larger than a frame is sent without listen windows: about a tenth sooner,
    but no other node is heard meanwhile."""
    max_airtime: Share | None = None
    """Share of the time that the stream may transmit, above 0, at most 1; None: no cap."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: States field, value and the allowed values.
        """
        check_fields(self)
        if self.deadline_s is not None and self.deadline_s <= self.min_interval_s:
            raise ValueError(
                f"deadline_s is {self.deadline_s}; "
                f"allowed: above min_interval_s, which is {self.min_interval_s:g}"
            )

    @property
    def deadline_ns(self) -> int | None:
        """Longest promised period between two samples of a key, ns; None: no promise."""
        return None if self.deadline_s is None else seconds_to_ns(self.deadline_s)

    @property
    def linger_ns(self) -> int:
        """How long a sample may wait for others, ns; 0 for REAL_TIME."""
        return 0 if self.priority is Priority.REAL_TIME else seconds_to_ns(self.linger_s)


class Override(msgspec.Struct, frozen=True, kw_only=True):
    """A remote command's override of a topic's QoS; None: as the QoS says."""

    on: bool = True
    """Whether its samples are sent; otherwise they wait, expire and are superseded."""
    min_interval_s: float | None = None
    """Minimum time between two transmitted samples of one key, s, ≥ 0."""
    priority: Priority | None = None
    """The Zenoh priority."""

    def over(self, qos: Qos) -> Qos:
        """Return a QoS with the override applied."""
        interval_s = qos.min_interval_s if self.min_interval_s is None else self.min_interval_s
        priority = qos.priority if self.priority is None else self.priority
        # The promise was made before: a deadline that is missed because of a command is missed.
        return msgspec.structs.replace(
            qos, min_interval_s=interval_s, priority=priority, deadline_s=None
        )


NO_OVERRIDE: Final = Override()
"""No override: everything as the QoS says."""
