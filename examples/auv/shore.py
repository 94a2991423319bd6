"""The shore's knowledge of the vehicle, with its age; commands go out through a `Carrier`.

Nothing here has a clock: whoever carries the words says when they came. Between two reports the
vehicle is predicted: on a circle of its speed and its rate of turn, with an uncertainty that grows
with the age of what is known. How fast it grows was measured: over hours of dives with orders in
between, the vehicle is within two standard deviations as often as that promises, at any age.
"""

import math
from abc import ABC, abstractmethod
from typing import Any, Final

import msgspec

from examples.auv.messages import (
    NAV,
    PHOTO,
    STATUS,
    Done,
    Nav,
    Progress,
    Reached,
    Status,
    Waypoint,
)

TRACK_MOST: Final = 2000
"""Reports that are kept."""
PHOTOS_MOST: Final = 8
DRIFT_M_S: Final = 0.15
"""By how much the uncertainty of a prediction grows, m each second: the current."""
STEERING_M_S2: Final = 0.016
"""And by how much, m each second squared: turns and speeds unknown here."""
RUNAWAY_M_S: Final = 1.5
"""But not faster than that: in the end it may be anywhere in the circle of its speed."""
DIVING_M_S2: Final = 0.015
"""The same of the depth, m each second squared."""
SINKING_M_S: Final = 0.25
"""The same of the depth, m each second at most."""
GAUGE_M: Final = 0.1
"""Standard deviation of a reported depth, m."""
SOUND_S: Final = 1.5
"""How much older a report is than its stamp, if that was not measured: airtime and delay of
the frame, s."""


_REPORTS: Final[dict[str, type[Nav] | type[Status]]] = {NAV: Nav, STATUS: Status}


class Answer:
    """What becomes of a call, or of a goal."""

    def __init__(self) -> None:
        self.accepted: bool | None = None
        """Whether a goal was accepted, or a service's answer; None: unknown yet."""
        self.ended = False
        """Nothing more comes."""
        self.value: Done | Reached | None = None
        self.text = ""
        """Why not."""

    @property
    def is_good(self) -> bool:
        """It has ended as it should."""
        return self.ended and self.accepted is True and not self.text

    def answered(self, done: Done) -> None:
        """A service has answered."""
        self.accepted, self.value, self.text = done.accepted, done, done.reason
        self.ended = True

    def failed(self, text: str) -> None:
        """There is no answer, or no result, and none will come."""
        self.ended, self.text = True, text or "failed"

    def reached(self, result: Reached) -> None:
        """A goal was reached."""
        self.accepted, self.value, self.ended = True, result, True


class Carrier(ABC):
    """Carries commands to the vehicle: Zenoh, or an engine in virtual time."""

    @abstractmethod
    def put(self, topic: str, value: msgspec.Struct) -> None:
        """Publish."""

    @abstractmethod
    def call(self, service: str, value: msgspec.Struct) -> Answer:
        """Call a service whose answer is `Done`."""

    @abstractmethod
    def send_goal(self, waypoint: Waypoint) -> Answer:
        """Send a way-point."""


class Heard(msgspec.Struct, frozen=True):
    """A value, and when it was made."""

    value: Nav | Status
    made_at_s: float


class Estimate(msgspec.Struct, frozen=True):
    """Where the vehicle probably is."""

    north: float
    east: float
    depth: float
    heading: float
    sigma: float
    """Standard deviation of the position, m, in each direction."""
    depth_sigma: float
    """Standard deviation of the depth, m."""
    age_s: float
    """Of the report that it follows from."""


class Shore:
    """The vehicle, as seen from the shore."""

    def __init__(self) -> None:
        self.nav: Nav | None = None
        self.nav_made_at_s = -math.inf
        self.status: Status | None = None
        self.status_made_at_s = -math.inf
        self.progress: Progress | None = None
        self.track: list[tuple[float, Nav]] = []
        """Reports with the instants at which they were made, oldest first."""
        self.photos: list[bytes] = []
        self.photo_came_at_s = -math.inf

    def hear(
        self,
        topic: str,
        value: Nav | Status | bytes | dict[str, Any],
        now_s: float,
        age_s: float = 0.0,
        way_s: float = SOUND_S,
    ) -> None:
        """Take what came from the vehicle.

        Args:
            topic: Its name.
            value: The sample, or the map that it crossed as.
            now_s: The instant.
            age_s: How old it is.
            way_s: How long its frame took, if the age does not include that.
        """
        made_at_s = now_s - age_s - way_s
        if isinstance(value, dict):
            value = msgspec.convert(value, _REPORTS[topic])
        if topic == NAV and isinstance(value, Nav):
            if made_at_s > self.nav_made_at_s:
                self.nav, self.nav_made_at_s = value, made_at_s
                self.track = [*self.track[1 - TRACK_MOST :], (made_at_s, value)]
        elif topic == STATUS and isinstance(value, Status):
            self.status, self.status_made_at_s = value, made_at_s
        elif topic == PHOTO and isinstance(value, bytes):
            self.photos = [*self.photos[1 - PHOTOS_MOST :], value]
            self.photo_came_at_s = now_s

    def estimate(self, now_s: float) -> Estimate | None:
        """Predict where the vehicle is now; None before the first report."""
        nav = self.nav
        if nav is None:
            return None
        age_s = max(0.0, now_s - self.nav_made_at_s)
        heading, turn = math.radians(nav.heading), math.radians(nav.turn)
        pitch = math.radians(nav.pitch)
        flat_m_s, sinking_m_s = nav.speed * math.cos(pitch), -nav.speed * math.sin(pitch)
        if abs(turn) < 1e-3:
            ahead_m, aside_m = flat_m_s * age_s, 0.0
        else:
            radius_m = flat_m_s / turn
            ahead_m = radius_m * math.sin(turn * age_s)
            aside_m = radius_m * (1.0 - math.cos(turn * age_s))
        return Estimate(
            north=nav.north + ahead_m * math.cos(heading) - aside_m * math.sin(heading),
            east=nav.east + ahead_m * math.sin(heading) + aside_m * math.cos(heading),
            # An autopilot levels out sooner than a straight line would: half a length of memory.
            depth=max(0.0, nav.depth + sinking_m_s * min(age_s, 5.0)),
            heading=(nav.heading + nav.turn * age_s) % 360.0,
            sigma=math.hypot(
                nav.sigma,
                DRIFT_M_S * age_s,
                min(STEERING_M_S2 * age_s**2, RUNAWAY_M_S * age_s),
            ),
            depth_sigma=math.hypot(GAUGE_M, min(DIVING_M_S2 * age_s**2, SINKING_M_S * age_s)),
            age_s=age_s,
        )
