"""The operator's desk: everything that the page shows and does, without a page.

Whoever draws calls `tick` a few times a second and reads the lines; every value comes with its age.
"""

import time
from collections.abc import Callable
from typing import Any, Final

import msgspec

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

ORDERS_MOST: Final = 12
OLD_S: Final = 20.0
"""A report older than that is worth a warning: three have not come."""


class Order(msgspec.Struct):
    """Something that was ordered."""

    text: str
    at_s: float
    answer: Answer | None
    """None: a sample, of which nobody is told here what became of it."""


class Desk:
    """What the operator sees and does.

    Args:
        shore: What is known of the vehicle.
        clock: Seconds, monotonic.
    """

    def __init__(self, shore: Shore, clock: Callable[[], float] = time.monotonic) -> None:
        self.shore = shore
        self.carrier: Carrier | None = None
        """Takes the orders, as soon as everything runs."""
        self.cancel: Callable[[], None] = lambda: None
        self.setpoints = Setpoints()
        self.orders: list[Order] = []
        self.waypoints: list[Waypoint] = []
        self.health: dict[str, Any] = {}
        self.trouble = ""
        """What has gone wrong with the processes."""
        self._clock = clock
        self._photos_asked = 0

    @property
    def now_s(self) -> float:
        """The instant."""
        return self._clock()

    def tick(self) -> None:
        """Tell the vehicle the set-points that are due."""
        if self.carrier is None:
            return
        for topic, value in self.setpoints.poll(self.now_s).items():
            self.carrier.put(topic, Setpoint(value))

    # Orders

    def cancel_goal(self) -> None:
        """Give up the way-point that was sent last."""
        self.cancel()

    def arm(self, armed: bool) -> None:
        """Let the propeller turn, or not."""
        self.setpoints.reset()
        self._call(ARM, Arm(armed), "arm" if armed else "disarm")

    def hold(self, depth: float, heading: float, speed: float) -> None:
        """Let the autopilot steer."""
        self.setpoints.reset()
        text = f"hold {depth:g} m, {heading:g}°, {speed:g} m/s"
        self._call(HOLD, Hold(True, depth, heading, speed), text)

    def by_hand(self) -> None:
        """Let the set-points steer."""
        self.setpoints.reset()
        self._call(HOLD, Hold(False), "steer by hand")

    def goto(self, waypoint: Waypoint) -> None:
        """Send the vehicle to a way-point."""
        self.setpoints.reset()
        if self.carrier is not None:
            self.waypoints = [*self.waypoints[-8:], waypoint]
            place = f"{waypoint.north:g} m north, {waypoint.east:g} m east"
            text = f"go to {place}, {waypoint.depth:g} m deep"
            self._note(text, self.carrier.send_goal(waypoint))

    def photo(self) -> None:
        """Ask for a photo."""
        self._photos_asked += 1
        self._call(TAKE_PHOTO, TakePhoto(self._photos_asked % 256), "photo")

    def stop(self) -> None:
        """Stop everything."""
        self.setpoints.reset()
        if self.carrier is not None:
            self.carrier.put(STOP, Stop())
            self._note("STOP", None)

    # What is shown

    def mode(self) -> str:
        """Say who steers, as far as it is known."""
        nav = self.shore.nav
        return "unknown" if nav is None else nav.mode.value

    def vehicle_lines(self) -> list[str]:
        """Say where the vehicle is, and how old that is."""
        estimate, nav = self.shore.estimate(self.now_s), self.shore.nav
        if estimate is None or nav is None:
            return ["not heard yet"]
        return [
            f"reported {estimate.age_s:.0f} s ago" + (" — OLD" if estimate.age_s > OLD_S else ""),
            f"depth {nav.depth:.1f} m, heading {nav.heading:.0f}°, {nav.speed:.2f} m/s",
            f"pitch {nav.pitch:.0f}°, roll {nav.roll:.0f}°, turning {nav.turn:.1f}°/s",
            f"probably now {estimate.north:.0f} m north, {estimate.east:.0f} m east, "
            f"± {estimate.sigma:.0f} m",
        ]

    def status_line(self) -> str:
        """Say how the vehicle is, and how old that is."""
        status = self.shore.status
        if status is None:
            return "battery not heard yet"
        age_s = self.now_s - self.shore.status_made_at_s
        return (
            f"battery {status.battery:.0f} %, {status.altitude:.0f} m above the bed, "
            f"{status.photos} photos ({age_s:.0f} s ago)"
        )

    def order_lines(self) -> list[str]:
        """Say what became of the orders, newest first."""
        return [
            f"{self.now_s - each.at_s:4.0f} s ago: {each.text}: {self._outcome(each)}"
            for each in reversed(self.orders)
        ]

    def link_lines(self) -> list[str]:
        """Say how the link is, what waits, and what is in the water."""
        lines = []
        link = self.health.get("link")
        if link is not None:
            lines.append(
                f"link {link['state']}; {link['frames_transmitted']} frames sent, "
                f"{link['frames_received']} heard, {link['airtime_s']:.0f} s on the air"
            )
        found = self.health.get("peer/2/range")
        if found is not None and found["propagation_s"] is not None:
            metres = "" if found["range_m"] is None else f"{found['range_m']:.0f} m, "
            lines.append(f"vehicle at {metres}{found['propagation_s']:.2f} s of sound")
        for stream in self.health.get("streams", {}).get("streams", []):
            waiting, delivering = stream["waiting"], stream.get("delivering", 0)
            if waiting or delivering:
                lines.append(f"{stream['name']}: {waiting} wait, {delivering} under way")
        for each in self.health.get("objects", {}).get("receiving", []):
            done, whole = each["done_bytes"], each["total_bytes"]
            share = f" of {whole}" if whole else ""
            lines.append(f"photo: {done}{share} bytes")
        for topic, value in self.setpoints.waiting.items():
            lines.append(f"set-point waits: {topic.rpartition('/')[2]} {value:g}")
        return lines or ["nothing known of the link"]

    def _call(self, service: str, value: msgspec.Struct, text: str) -> None:
        if self.carrier is not None:
            self._note(text, self.carrier.call(service, value))

    def _note(self, text: str, answer: Answer | None) -> None:
        self.orders = [*self.orders[1 - ORDERS_MOST :], Order(text, self.now_s, answer)]

    def _outcome(self, order: Order) -> str:
        if order.answer is None:
            stopped = self.shore.nav is not None and self.shore.nav.mode is Mode.STOPPED
            return "the vehicle says that it has stopped" if stopped else "sent"
        if order.answer.ended:
            return "done" if order.answer.is_good else order.answer.text or "failed"
        return "accepted, under way" if order.answer.accepted else "not answered yet"
