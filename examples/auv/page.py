"""The console as a web page; NiceGUI brings everything that the browser needs, nothing is loaded.

Keys: arrows turn and tilt, `+` and `-` thrust, space stops.
"""

import base64
from typing import Final

from nicegui import ui
from nicegui.events import KeyEventArguments

from examples.auv.desk import Desk
from examples.auv.drawing import attitude_of, map_of, profile_of
from examples.auv.hydrodynamics import FIN_LIMIT_RAD
from examples.auv.messages import ELEVATOR, RUDDER, THRUST, Waypoint

REFRESH_S: Final = 0.5
_MOST_THRUST_N: Final = 31.0
_RUDDER_STEP_RAD: Final = 0.02
_THRUST_STEP_N: Final = 2.0


class Page:
    """One browser's view of the desk.

    Args:
        desk: What it shows and does.
    """

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
        self._shown_photos = 0
        self._resets = desk.setpoints.resets
        self._is_resetting = False
        ui.page_title("auv1")
        ui.keyboard(on_key=self._key)
        with ui.row().classes("w-full items-start no-wrap"):
            with ui.column():
                self._map = ui.html(sanitize=False).mark("map")
                self._profile = ui.html(sanitize=False).mark("profile")
                self._photo = ui.image().classes("w-64").mark("photo")
            with ui.column().classes("w-full"):
                self._trouble = ui.label().classes("text-red text-bold")
                with ui.row().classes("items-center"):
                    self._attitude = ui.html(sanitize=False).mark("attitude")
                    with ui.column().classes("gap-0"):
                        self._mode = ui.label().classes("text-h6").mark("mode")
                        self._vehicle = ui.label().style("white-space: pre-line").mark("vehicle")
                        self._status = ui.label().mark("status")
                self._sliders()
                self._missions()
                ui.label("Orders").classes("text-bold")
                self._orders = ui.label().style("white-space: pre-line").mark("orders")
                ui.label("Link").classes("text-bold")
                self._link = ui.label().style("white-space: pre-line").mark("link")
        ui.timer(REFRESH_S, self.refresh)
        self.refresh()

    def refresh(self) -> None:
        """Show what is known now."""
        desk = self._desk
        estimate = desk.shore.estimate(desk.now_s)
        self._map.set_content(map_of(desk.shore, estimate, desk.waypoints))
        self._profile.set_content(profile_of(desk.shore, desk.now_s))
        self._attitude.set_content(attitude_of(desk.shore.nav))
        self._trouble.set_text(desk.trouble)
        self._mode.set_text(f"auv1: {desk.mode()}")
        self._vehicle.set_text("\n".join(desk.vehicle_lines()))
        self._status.set_text(desk.status_line())
        self._orders.set_text("\n".join(desk.order_lines()))
        self._link.set_text("\n".join(desk.link_lines()))
        if self._resets != desk.setpoints.resets:
            self._resets = desk.setpoints.resets
            self._centre()
        if len(desk.shore.photos) != self._shown_photos:
            self._shown_photos = len(desk.shore.photos)
            picture = base64.b64encode(desk.shore.photos[-1]).decode()
            self._photo.set_source(f"data:image/png;base64,{picture}")

    def _sliders(self) -> None:
        """Set-points; forward is positive here, and has Gazebo's sign on the way."""

        def slider(name: str, topic: str, most: float, step: float) -> ui.slider:
            sign = -1.0 if topic == THRUST else 1.0
            with ui.row().classes("w-96 items-center no-wrap"):
                ui.label(name).classes("w-32")
                found = ui.slider(
                    min=-most,
                    max=most,
                    step=step,
                    value=0,
                    on_change=lambda event: self._moved(topic, sign * event.value),
                )
                ui.label().bind_text_from(found, "value", backward="{:g}".format)
            return found.mark(name)

        self._thrust = slider("thrust N", THRUST, _MOST_THRUST_N, 0.5)
        self._rudder = slider("rudder rad", RUDDER, FIN_LIMIT_RAD // 0.01 * 0.01, 0.01)
        self._elevator = slider("elevator rad", ELEVATOR, FIN_LIMIT_RAD // 0.01 * 0.01, 0.01)

    def _moved(self, topic: str, value: float) -> None:
        if not self._is_resetting:
            self._desk.setpoints.set(topic, value)

    def _centre(self) -> None:
        """Others steer now: what the sliders have said does not hold any more."""
        self._is_resetting = True
        for slider in (self._thrust, self._rudder, self._elevator):
            slider.value = 0
        self._is_resetting = False

    def _missions(self) -> None:
        desk = self._desk
        ui.button("STOP", on_click=desk.stop, color="red").classes("w-96 text-h6")
        with ui.row():
            ui.button("arm", on_click=lambda: desk.arm(True))
            ui.button("disarm", on_click=lambda: desk.arm(False))
            ui.button("by hand", on_click=desk.by_hand)
            ui.button("photo", on_click=desk.photo)
            ui.button("cancel way-point", on_click=desk.cancel_goal)
        with ui.row().classes("items-center"):
            depth = ui.number("depth m", value=10, min=0, max=70).classes("w-20")
            speed = ui.number("speed m/s", value=1.5, min=0, max=2.2).classes("w-20")
            heading = ui.number("heading °", value=90, min=0, max=360).classes("w-20")
            ui.button("hold", on_click=lambda: desk.hold(depth.value, heading.value, speed.value))
            north = ui.number("north m", value=60, min=-2000, max=2000).classes("w-20")
            east = ui.number("east m", value=160, min=-2000, max=2000).classes("w-20")
            ui.button(
                "go to",
                on_click=lambda: desk.goto(
                    Waypoint(north.value, east.value, depth.value, speed.value)
                ),
            )

    def _key(self, event: KeyEventArguments) -> None:
        if not event.action.keydown:
            return
        match event.key.name:
            case "ArrowLeft":
                self._rudder.value -= _RUDDER_STEP_RAD
            case "ArrowRight":
                self._rudder.value += _RUDDER_STEP_RAD
            case "ArrowUp":
                self._elevator.value -= _RUDDER_STEP_RAD
            case "ArrowDown":
                self._elevator.value += _RUDDER_STEP_RAD
            case "+":
                self._thrust.value += _THRUST_STEP_N
            case "-":
                self._thrust.value -= _THRUST_STEP_N
            case " ":
                self._desk.stop()
            case _:
                pass
