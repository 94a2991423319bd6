"""The messages between vehicle and shore: the types of `fleet.json5` as classes.

Lengths are metres from where the dive begins, angles degrees, as people say them; joints have the
units and signs of Gazebo, and its field name.
"""

import enum
from typing import Final, Literal

import msgspec

MODEL: Final = "model/tethys"
"""Where Gazebo's bridge finds the vehicle."""
RUDDER: Final = f"{MODEL}/joint/vertical_fins_joint/0/cmd_pos"
ELEVATOR: Final = f"{MODEL}/joint/horizontal_fins_joint/0/cmd_pos"
THRUST: Final = f"{MODEL}/joint/propeller_joint/cmd_thrust"
JOINTS: Final = (RUDDER, ELEVATOR, THRUST)

STOP: Final = "auv1/stop"
ARM: Final = "auv1/arm"
HOLD: Final = "auv1/hold"
TAKE_PHOTO: Final = "auv1/take_photo"
GOTO: Final = "auv1/goto"
NAV: Final = "auv1/nav"
STATUS: Final = "auv1/status"
PHOTO: Final = "auv1/photo"


class Mode(enum.Enum):
    """Who steers the vehicle."""

    DISARMED = "disarmed"
    """Nobody: the propeller stands."""
    MANUAL = "manual"
    """The set-points of the joints; the last ones hold."""
    HOLD = "hold"
    """The autopilot: depth, heading, speed."""
    GOTO = "goto"
    """The autopilot, towards a way-point; around it, when that is reached."""
    STOPPED = "stopped"
    """Nobody, and it must be armed again."""
    SURFACING = "surfacing"
    """The autopilot: the shore is not heard any more."""


class Setpoint(msgspec.Struct, frozen=True):
    """Of one joint: rad, or N."""

    data: float


class Stop(msgspec.Struct, frozen=True):
    """Everything stands still."""

    reason: Literal["operator", "script"] = "operator"


class Arm(msgspec.Struct, frozen=True):
    """Let the propeller turn, or not."""

    armed: bool


class Hold(msgspec.Struct, frozen=True):
    """Let the autopilot steer; without `on` the joints' set-points do."""

    on: bool
    depth: float = 0.0
    heading: float = 0.0
    speed: float = 0.0


class TakePhoto(msgspec.Struct, frozen=True):
    """Take a picture and send it."""

    number: int


class Done(msgspec.Struct, frozen=True):
    """Whether a service was done."""

    accepted: bool
    reason: str = ""


class Waypoint(msgspec.Struct, frozen=True):
    """Where to go."""

    north: float
    east: float
    depth: float
    speed: float = 1.5


class Progress(msgspec.Struct, frozen=True):
    """How far it is to the way-point, m."""

    distance: float


class Reached(msgspec.Struct, frozen=True):
    """Where a goal has ended: distance to the way-point, and the depth there, m."""

    distance: float
    depth: float


class Nav(msgspec.Struct, frozen=True):
    """The vehicle's estimated position and motion."""

    north: float
    east: float
    depth: float
    heading: float
    pitch: float
    roll: float
    speed: float
    turn: float
    """Rate of the heading, deg/s."""
    sigma: float
    """Standard deviation of the position, m, in each direction."""
    mode: Mode


class Status(msgspec.Struct, frozen=True):
    """How the vehicle is."""

    battery: float
    altitude: float
    photos: int
