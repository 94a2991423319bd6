"""The operator's station: commands and their outcomes, without a page.

A page calls `tick` a few times a second; `readout` has the values to show.
"""

import math
import time
from collections import deque
from collections.abc import Callable
from typing import Final

import msgspec

from examples.auv.fates import Fate
from examples.auv.linkwatch import LinkWatch
from examples.auv.messages import (
    ARM,
    HOLD,
    STOP,
    TAKE_PHOTO,
    Arm,
    Hold,
    Mode,
    Setpoint,
    Stop,
    TakePhoto,
    Waypoint,
)
from examples.auv.setpoints import Setpoints
from examples.auv.shore import Answer, Carrier, Shore

ORDERS_MOST: Final = 30
WAYPOINTS_MOST: Final = 9
GATEWAY_LIMIT_S: Final = 1.6
"""A gateway that has not answered for so long is gone: it is asked several times in it, s."""
CONFIRMED: Final = "done: the vehicle reports that it has stopped"
PRESSES_KEPT: Final = 64
_LATE_S: Final = 2.0


class Press(msgspec.Struct, frozen=True):
    """A press of STOP in a browser, which keeps it until it is taken."""

    id: str
    """Each is taken once, however often and by whichever page it comes."""
    ago_ms: float = 0.0
    """How long ago it was made."""

    def __post_init__(self) -> None:
        if not 0 < len(self.id) <= 64 or " " in self.id or not 0 <= self.ago_ms < math.inf:
            raise ValueError("this is no press")


class Order(msgspec.Struct):
    """A command."""

    text: str
    at_s: float
    answer: Answer | None = None
    """None: a sample, whose outcome only the gateway reports."""
    fate: Fate | None = None
    """Of a sample."""
    is_confirmed: bool = False
    """A stop: a report that was made later shows it."""

    @property
    def is_over(self) -> bool:
        """Nothing more becomes of it."""
        if self.answer is not None:
            return self.answer.ended
        return self.is_confirmed or self.fate is Fate.LOST


class ControlStation:
    """What the operator does, and what becomes of it.

    Args:
        shore: What is known of the vehicle.
        clock: Seconds, monotonic.
        unix_clock: The clock of people, s.
    """

    def __init__(
        self,
        shore: Shore,
        clock: Callable[[], float] = time.monotonic,
        unix_clock: Callable[[], float] = time.time,
    ) -> None:
        self.shore = shore
        self.watch = LinkWatch()
        """The gateway's health."""
        self.carrier: Carrier | None = None
        """Takes the commands, as soon as everything runs."""
        self.cancel: Callable[[], Answer | None] = lambda: None
        """Gives the way-point up that was sent last."""
        self.setpoints = Setpoints()
        self.orders: list[Order] = []
        self.waypoints: list[Waypoint] = []
        self.wanted_depth: float | None = None
        """Where the autopilot was sent to, m; None: nowhere."""
        self.photo_asked_at_s: float | None = None
        """When the newest photo was asked for; None: its command is unknown."""
        self.gateway_gone_at_s: float | None = None
        """Since when the gateway has not answered; None: it does, or it is not asked."""
        self.presses_taken: deque[str] = deque(maxlen=PRESSES_KEPT)
        """Ids, oldest first."""
        self.trouble = ""
        """What has gone wrong with the processes."""
        self._clock = clock
        self._unix_clock = unix_clock
        self._photos_asked = 0
        self._photos_awaited: list[Order] = []
        self._photo_seen_at_s = shore.photo_came_at_s

    @property
    def now_s(self) -> float:
        """The instant."""
        return self._clock()

    @property
    def unix_s(self) -> float:
        """The instant, by the gateway's clock of people, which never jumps; else by ours."""
        told = self.watch.unix_s(self.now_s)
        return self._unix_clock() if told is None else told

    def tick(self) -> None:
        """Send the vehicle the due set-points, and update the outcomes of the commands."""
        self.watch.fates.tick(self.now_s)
        self._watch_gateway()
        self._follow_stops()
        self._follow_photos()
        if self.carrier is not None:
            for topic, value in self.setpoints.poll(self.now_s).items():
                self._put(topic, Setpoint(value))

    # Orders

    def cancel_goal(self) -> None:
        """Give up the way-point that was sent last."""
        answer = self.cancel()
        if answer is not None:
            self._note(Order("give up the way-point", self.now_s, answer))

    def arm(self, armed: bool) -> None:
        """Let the propeller turn, or not."""
        self._take_hands_off()
        self._call(ARM, Arm(armed), "arm" if armed else "disarm")

    def hold(self, depth: float, heading: float, speed: float) -> None:
        """Let the autopilot steer."""
        self._take_hands_off(depth)
        text = f"hold {depth:g} m, {heading:g}°, {speed:g} m/s"
        self._call(HOLD, Hold(True, depth, heading, speed), text)

    def by_hand(self) -> None:
        """Let the set-points steer."""
        self._take_hands_off()
        self._call(HOLD, Hold(False), "steer by hand")

    def goto(self, waypoint: Waypoint) -> None:
        """Send the vehicle to a way-point."""
        self._take_hands_off(waypoint.depth)
        if self.carrier is not None:
            self.waypoints = [*self.waypoints[1 - WAYPOINTS_MOST :], waypoint]
            place = f"{waypoint.north:g} m north, {waypoint.east:g} m east"
            answer = self.carrier.send_goal(waypoint)
            self._note(Order(f"go to {place}, {waypoint.depth:g} m deep", self.now_s, answer))

    def photo(self) -> None:
        """Ask for a photo."""
        self._photos_asked += 1
        order = self._call(TAKE_PHOTO, TakePhoto(self._photos_asked % 256), "take a photo")
        if order is not None:
            self._photos_awaited.append(order)

    def stop(self, press: Press | None = None) -> None:
        """Stop everything; note as not sent what cannot be sent.

        Args:
            press: Of a browser; one that was taken already does nothing.
        """
        text = "STOP"
        if press is not None:
            if press.id in self.presses_taken:
                return
            self.presses_taken.append(press.id)
            late_s = press.ago_ms / 1e3
            text += f", pressed {late_s:.0f} s before it came" if late_s > _LATE_S else ""
        self._take_hands_off()
        fate = Fate.NOT_SENT
        if self.carrier is not None:
            self._put(STOP, Stop())
            fate = Fate.GIVEN
        self._note(Order(text, self.now_s, fate=fate))

    @property
    def open_stop(self) -> Order | None:
        """The newest STOP, as long as something may become of it; the earlier ones are the same."""
        stops = [order for order in self.orders if order.answer is None]
        return stops[-1] if stops and not stops[-1].is_over else None

    # Below

    def _take_hands_off(self, depth: float | None = None) -> None:
        """Others steer from now on."""
        self.setpoints.reset()
        self.wanted_depth = depth

    def _call(self, service: str, value: msgspec.Struct, text: str) -> Order | None:
        if self.carrier is None:
            return None
        return self._note(Order(text, self.now_s, self.carrier.call(service, value)))

    def _put(self, topic: str, value: msgspec.Struct) -> None:
        assert self.carrier is not None
        self.carrier.put(topic, value)
        self.watch.fates.sent(topic, self.now_s)

    def _note(self, order: Order) -> Order:
        self.orders = [*self.orders[1 - ORDERS_MOST :], order]
        return order

    def _watch_gateway(self) -> None:
        """See whether it answers; here, after all that has come, and not when a page looks."""
        answered_at_s = self.watch.answered_at_s
        is_gone = answered_at_s is not None and self.now_s - answered_at_s > GATEWAY_LIMIT_S
        self.gateway_gone_at_s = answered_at_s if is_gone else None

    def _follow_stops(self) -> None:
        """Of several the newest is followed: the others are the same command."""
        nav = self.shore.nav
        for order in self.orders:
            if order.answer is None and not order.is_confirmed:
                is_later = self.shore.nav_made_at_s > order.at_s
                order.is_confirmed = is_later and nav is not None and nav.mode is Mode.STOPPED
                order.fate = self.watch.fates.of(STOP) or order.fate

    def _follow_photos(self) -> None:
        """Find the command of a photo, if there is one."""
        self._photos_awaited = [
            each
            for each in self._photos_awaited
            if each.answer is not None and (each.answer.is_good or not each.answer.ended)
        ]
        if self._photo_seen_at_s != self.shore.photo_came_at_s:
            self._photo_seen_at_s = self.shore.photo_came_at_s
            only = self._photos_awaited[0] if len(self._photos_awaited) == 1 else None
            self.photo_asked_at_s = None if only is None else only.at_s
            self._photos_awaited = self._photos_awaited[1:]
