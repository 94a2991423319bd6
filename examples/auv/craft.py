"""The vehicle as a whole: body, instruments, autopilot, and its reactions to commands.

A function of its inputs and of the time that it is told: no clock, no thread, no network. Whoever
carries its words, Zenoh (`vehicle`) or engines in virtual time (`virtual`), tells `advance` the
seconds since the beginning, hands in commands and takes out reports, progress and ends of goals.

Who steers is the `Mode`::

                       arm                      hold                 goto
    DISARMED, STOPPED ─────► MANUAL ◄──────────────────► HOLD ◄───────────► GOTO
        ▲                                shore lost            shore heard
        └── arm(false), stop ── any      any but these ─────► SURFACING ─────► HOLD

A stopped vehicle stays stopped until it is armed again, also without the shore: somebody may be
at its propeller. One that is armed goes up when the shore is lost, and its goal is given up.
"""

import math
import random
from typing import Final

import msgspec

from examples.auv.autopilot import Autopilot, Course, Guidance
from examples.auv.dynamics import STEP_S, Body, Controls, Motion
from examples.auv.messages import (
    ELEVATOR,
    RUDDER,
    THRUST,
    Done,
    Hold,
    Mode,
    Nav,
    Progress,
    Reached,
    Status,
    Waypoint,
)
from examples.auv.navigator import Navigator
from examples.auv.picture import photo_of
from examples.auv.sensors import Readings, Sensors
from examples.auv.world import TRIAL, World

REACHED_M: Final = 3.0
"""A way-point this near, by the vehicle's own navigation, is reached."""
DEPTH_REACHED_M: Final = 0.3
LEAST_ALTITUDE_M: Final = 4.0
MOST_DEPTH_M: Final = 70.0
SURFACING_SPEED_M_S: Final = 1.5
SURFACED_M: Final = 0.4
PATIENCE: Final = 4.0
"""A goal that takes so many times as long as the straight way, and five minutes, is given up."""


class GoalEnded(msgspec.Struct, frozen=True):
    """How a goal ended."""

    reached: bool
    result: Reached
    text: str = ""


_ARMED: Final = frozenset({Mode.MANUAL, Mode.HOLD, Mode.GOTO, Mode.SURFACING})
_LEVEL: Final = Course(depth_m=0.0, heading_rad=0.0, speed_m_s=0.0)


class Craft:
    """The vehicle.

    Args:
        world: Where it is.
        seed: Of all noise.
        start: Where it begins, at rest.
    """

    def __init__(self, start: Motion, world: World = TRIAL, *, seed: int = 1) -> None:
        self._world = world
        self._body = Body(world)
        self._sensors = Sensors(world, random.Random(f"sensors/{seed}"))
        self._camera = random.Random(f"camera/{seed}")
        self._navigator = Navigator(start.north_m, start.east_m, start.depth_m)
        self._autopilot = Autopilot()
        self._guidance = Guidance()
        self._steps = 0
        self._course = _LEVEL
        self._waypoint: Waypoint | None = None
        self._pursues = False
        self._give_up_at_s = math.inf
        self._ended: list[GoalEnded] = []
        self._photos = 0
        self.motion = start
        """The truth; not known to the vehicle."""
        self.mode = Mode.DISARMED
        self.controls = Controls()
        """What the joints do now."""
        self.ignored = 0
        """Set-points of joints that came while the vehicle was not steered by hand."""
        self._readings = self._measure(start)

    @property
    def now_s(self) -> float:
        """Time of the last step, s."""
        return self._steps * STEP_S

    def advance(self, now_s: float) -> None:
        """Let time pass, up to an instant, s since the beginning."""
        while (self._steps + 1) * STEP_S <= now_s + 1e-9:
            self._step()

    # Commands

    def set_joint(self, topic: str, value: float) -> None:
        """Take the set-point of a joint; only in `MANUAL`."""
        if self.mode is not Mode.MANUAL or not math.isfinite(value):
            self.ignored += 1
            return
        field = {RUDDER: "rudder_rad", ELEVATOR: "elevator_rad", THRUST: "thrust_n"}[topic]
        self.controls = msgspec.structs.replace(self.controls, **{field: value}).limited()

    def arm(self, armed: bool) -> Done:
        """Let the propeller turn, or not."""
        if armed == (self.mode in _ARMED):
            return Done(False, "armed already" if armed else "not armed")
        self._give_up("disarmed")
        self.mode = Mode.MANUAL if armed else Mode.DISARMED
        self.controls = Controls()
        return Done(True)

    def hold(self, order: Hold) -> Done:
        """Let the autopilot steer, or the joints' set-points."""
        if self.mode not in _ARMED:
            return Done(False, "not armed")
        if order.on and (refusal := self._too_deep(order.depth)):
            return Done(False, refusal)
        self._give_up("taken over")
        self.mode = Mode.HOLD if order.on else Mode.MANUAL
        self.controls = Controls()
        self._course = Course(
            depth_m=order.depth,
            heading_rad=math.radians(order.heading),
            speed_m_s=order.speed,
        )
        return Done(True)

    def stop(self) -> None:
        """Let everything stand still."""
        self._give_up("stopped")
        self.mode = Mode.STOPPED
        self.controls = Controls()

    def goto(self, waypoint: Waypoint) -> str:
        """Go to a way-point; a goal that is pursued is given up. Returns why not, or nothing."""
        if self.mode not in _ARMED:
            return "not armed"
        if refusal := self._too_deep(waypoint.depth):
            return refusal
        self._give_up("another way-point")
        self._waypoint, self._pursues = waypoint, True
        self._guidance = Guidance()
        way_s = self._distance(waypoint) / max(0.3, waypoint.speed)
        self._give_up_at_s = self.now_s + 300.0 + PATIENCE * way_s
        self.mode = Mode.GOTO
        return ""

    def cancel_goto(self) -> None:
        """Give up the goal that is pursued; the vehicle goes on circling the way-point."""
        self._give_up("cancelled")

    def take_photo(self) -> bytes:
        """Return a picture of the sea bed below."""
        self._photos += 1
        return photo_of(self._world, self.motion.north_m, self.motion.east_m, self._camera)

    def shore_lost(self) -> None:
        """The shore is not heard any more: go up, unless the propeller must stand."""
        if self.mode in _ARMED:
            self._give_up("shore lost")
            self.mode = Mode.SURFACING

    def shore_found(self) -> None:
        """The shore is heard again: stay where the way up has led to, and wait for commands."""
        if self.mode is Mode.SURFACING:
            self.mode = Mode.HOLD
            self._course = Course(
                depth_m=max(0.0, self._navigator.depth_m),
                heading_rad=self._readings.heading_rad,
                speed_m_s=0.0,
            )

    # Reports

    def poll_goal(self) -> GoalEnded | None:
        """Return the next end of a goal."""
        return self._ended.pop(0) if self._ended else None

    @property
    def progress(self) -> Progress | None:
        """How far the goal is that is pursued; None without one."""
        if self._waypoint is None or not self._pursues:
            return None
        return Progress(self._distance(self._waypoint))

    def nav(self) -> Nav:
        """Report its estimated position."""
        readings, navigator = self._readings, self._navigator
        return Nav(
            north=navigator.north_m,
            east=navigator.east_m,
            depth=navigator.depth_m,
            heading=math.degrees(readings.heading_rad),
            pitch=math.degrees(readings.pitch_rad),
            roll=math.degrees(readings.roll_rad),
            speed=readings.speed_m_s,
            turn=math.degrees(readings.yaw_rate_rad_s),
            sigma=navigator.sigma_m,
            mode=self.mode,
        )

    def status(self) -> Status:
        """Report how it is."""
        readings = self._readings
        return Status(
            battery=readings.battery, altitude=readings.altitude_m, photos=self._photos % 256
        )

    # Below

    def _step(self) -> None:
        before = self.motion
        self._steps += 1
        self.motion = self._body.step(before, self.controls)
        self._sensors.draw(self.controls.thrust_n, self.motion.speed_m_s, STEP_S)
        self._readings = self._measure(before)
        self._navigator.take(self._readings, STEP_S)
        course = self._current_course()
        if course is not None:
            kept = msgspec.structs.replace(course, depth_m=self._above_bed(course.depth_m))
            depth_m = self._navigator.depth_m
            self.controls = self._autopilot.steer(kept, self._readings, depth_m, STEP_S)

    def _measure(self, before: Motion) -> Readings:
        return self._sensors.read(before, self.motion, STEP_S, self.now_s)

    def _current_course(self) -> Course | None:
        """What the autopilot is to hold; None: it does not steer."""
        match self.mode:
            case Mode.HOLD:
                return self._course
            case Mode.GOTO:
                assert self._waypoint is not None
                return self._course_to(self._waypoint)
            case Mode.SURFACING:
                up = self._navigator.depth_m < SURFACED_M
                speed_m_s = 0.0 if up else SURFACING_SPEED_M_S
                heading_rad = self._readings.heading_rad
                return Course(depth_m=0.0, heading_rad=heading_rad, speed_m_s=speed_m_s)
            case _:
                return None

    def _course_to(self, waypoint: Waypoint) -> Course:
        place = self._navigator
        missing_m = abs(waypoint.depth - place.depth_m)
        distance_m = self._distance(waypoint)
        if self._pursues and distance_m < REACHED_M and missing_m < DEPTH_REACHED_M:
            self._end(True, "")
        elif self._pursues and self.now_s > self._give_up_at_s:
            self._end(False, "it takes too long")
        heading_rad = self._guidance.heading(
            place.north_m,
            place.east_m,
            self._readings.heading_rad,
            (waypoint.north, waypoint.east),
        )
        return Course(depth_m=waypoint.depth, heading_rad=heading_rad, speed_m_s=waypoint.speed)

    def _distance(self, waypoint: Waypoint) -> float:
        place = self._navigator
        return math.hypot(waypoint.north - place.north_m, waypoint.east - place.east_m)

    def _give_up(self, text: str) -> None:
        if self._pursues:
            self._end(False, text)

    def _end(self, reached: bool, text: str) -> None:
        assert self._waypoint is not None
        self._pursues = False
        result = Reached(self._distance(self._waypoint), self._navigator.depth_m)
        self._ended.append(GoalEnded(reached, result, text))

    def _above_bed(self, depth_m: float) -> float:
        return min(depth_m, self._navigator.depth_m + self._readings.altitude_m - LEAST_ALTITUDE_M)

    def _too_deep(self, depth_m: float) -> str:
        if 0.0 <= depth_m <= MOST_DEPTH_M:
            return ""
        return f"depth {depth_m:g} m; allowed: 0..{MOST_DEPTH_M:g}"
