"""The scripted dive: arm, set-points, autopilot, a photo, three way-points, stop; and its verdict.

A generator that yields what it waits for and for how long; `Dive.poke` tells it that something may
have changed. So the same script runs between processes and in virtual time.
"""

from collections.abc import Callable, Iterator
from typing import Final

import msgspec

from examples.auv.messages import (
    ARM,
    ELEVATOR,
    HOLD,
    RUDDER,
    STOP,
    TAKE_PHOTO,
    THRUST,
    Arm,
    Hold,
    Mode,
    Reached,
    Setpoint,
    Stop,
    TakePhoto,
    Waypoint,
)
from examples.auv.picture import LEAST_BYTES
from examples.auv.shore import Answer, Carrier, Shore

WAYPOINTS: Final = (
    Waypoint(60.0, 160.0, 14.0),
    Waypoint(150.0, 60.0, 18.0),
    Waypoint(30.0, 20.0, 11.0),
)
HOLD_DEPTH_M: Final = 10.0
REACHED_WITHIN_M: Final = 5.0
DEPTH_WITHIN_M: Final = 0.5
ANSWER_LIMIT_S: Final = 120.0
GOAL_LIMIT_S: Final = 900.0
PHOTO_LIMIT_S: Final = 1200.0


class Until(msgspec.Struct, frozen=True):
    """What the script waits for."""

    what: str
    holds: Callable[[], bool]
    limit_s: float


class Dive:
    """One run of the script.

    Args:
        shore: What is known of the vehicle.
        carrier: Takes the commands.
        note: Takes notable events, a line each.
        waypoints: Where to go.
        with_photo: Take one.
    """

    def __init__(
        self,
        shore: Shore,
        carrier: Carrier,
        note: Callable[[str], None] = lambda line: None,
        *,
        waypoints: tuple[Waypoint, ...] = WAYPOINTS,
        with_photo: bool = True,
    ) -> None:
        self._shore = shore
        self._carrier = carrier
        self._note = note
        self._waypoints = waypoints
        self._with_photo = with_photo
        self._steps = self._script()
        self._until: Until | None = None
        self._since_s = 0.0
        self._taken: Answer | None = None
        self._taken_at_s: float | None = None
        self.is_over = False
        self.problems: list[str] = []
        """What has gone wrong; empty: nothing."""

    def poke(self, now_s: float) -> None:
        """Go on as far as possible; call it after changes, and now and then."""
        self._note_photo(now_s)
        while not self.is_over:
            if self._until is not None:
                if self._until.holds():
                    self._note(f"{self._until.what}: after {now_s - self._since_s:.1f} s")
                elif now_s - self._since_s < self._until.limit_s:
                    return
                else:
                    limit = f"not within {self._until.limit_s:g} s"
                    self.problems.append(f"{self._until.what}: {limit}")
                    self._note(self.problems[-1])
            self._since_s = now_s
            self._until = next(self._steps, None)
            if self._until is None:
                self.is_over = True

    def _note_photo(self, now_s: float) -> None:
        """Tell how long the photo has taken: it comes up while the vehicle goes on."""
        if self._taken is not None and self._taken.ended and self._taken_at_s is None:
            self._taken_at_s = now_s
        if self._taken is not None and self._taken_at_s is not None and self._shore.photos:
            size, took_s = len(self._shore.photos[0]), now_s - self._taken_at_s
            self._note(f"the photo is here, {size} bytes: {took_s:.1f} s after it was taken")
            self._taken = None

    def _script(self) -> Iterator[Until]:
        shore, put = self._shore, self._carrier.put
        yield Until("the vehicle is heard", lambda: shore.nav is not None, 60.0)

        armed = self._carrier.call(ARM, Arm(True))
        yield Until("armed", lambda: armed.ended, ANSWER_LIMIT_S)
        self._expect(armed, "arm")

        put(THRUST, Setpoint(-15.0))
        put(RUDDER, Setpoint(0.15))
        put(ELEVATOR, Setpoint(0.0))
        yield Until("set-points move it", lambda: self._speed() > 0.8, 90.0)
        yield Until("the rudder turns it", lambda: self._turn() > 1.5, 60.0)

        held = self._carrier.call(HOLD, Hold(True, HOLD_DEPTH_M, 90.0, 1.5))
        yield Until("the autopilot steers", lambda: held.ended, ANSWER_LIMIT_S)
        self._expect(held, "hold")
        yield Until(f"at {HOLD_DEPTH_M:g} m", self._is_deep_enough, 180.0)

        if self._with_photo:
            self._taken = taken = self._carrier.call(TAKE_PHOTO, TakePhoto(1))
            yield Until("a photo is taken", lambda: taken.ended, ANSWER_LIMIT_S)
            self._expect(taken, "take_photo")
        for number, waypoint in enumerate(self._waypoints, 1):
            goal = self._carrier.send_goal(waypoint)
            yield Until(f"way-point {number}", lambda goal=goal: goal.ended, GOAL_LIMIT_S)  # type: ignore[misc]
            self._check(number, waypoint, goal)
        if self._with_photo:
            yield Until("the photo was received", lambda: bool(shore.photos), PHOTO_LIMIT_S)
            if not shore.photos or len(shore.photos[0]) < LEAST_BYTES:
                self.problems.append("no photo")

        put(STOP, Stop("script"))
        yield Until("stopped", lambda: self._mode() is Mode.STOPPED, 120.0)
        yield Until("it stands", lambda: self._speed() < 0.3, 180.0)

    def _expect(self, answer: Answer, what: str) -> None:
        if not answer.is_good:
            self.problems.append(f"{what}: {answer.text or 'no answer'}")

    def _check(self, number: int, waypoint: Waypoint, goal: Answer) -> None:
        self._expect(goal, f"way-point {number}")
        if not isinstance(goal.value, Reached):
            return
        off_m = abs(goal.value.depth - waypoint.depth)
        if goal.value.distance > REACHED_WITHIN_M or off_m > DEPTH_WITHIN_M:
            self.problems.append(
                f"way-point {number}: {goal.value.distance:.1f} m away, {off_m:.2f} m off in depth"
            )

    def _is_deep_enough(self) -> bool:
        return self._shore.nav is not None and abs(self._shore.nav.depth - HOLD_DEPTH_M) < 0.4

    def _speed(self) -> float:
        return 0.0 if self._shore.nav is None else self._shore.nav.speed

    def _turn(self) -> float:
        return 0.0 if self._shore.nav is None else self._shore.nav.turn

    def _mode(self) -> Mode | None:
        return None if self._shore.nav is None else self._shore.nav.mode
