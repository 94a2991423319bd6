"""The console as a web page; NiceGUI brings everything that the browser needs, nothing is loaded.

Keys: arrows turn and tilt, `+` and `-` thrust, `0` puts all to zero, space stops. All pages show
the same station: what one moves the others see.
"""

import base64
import math
from collections.abc import Callable
from typing import Final

import msgspec
from nicegui import ui
from nicegui.elements.mixins.disableable_element import DisableableElement
from nicegui.events import GenericEventArguments

from examples.auv import look, readout
from examples.auv.controlstation import ControlStation, Press
from examples.auv.drawing import (
    MAP_PX,
    PROFILE_PX,
    Size,
    attitude_of,
    map_of,
    profile_of,
    view_of,
)
from examples.auv.ladder import LADDER_PX, ladder_of
from examples.auv.messages import ELEVATOR, RUDDER, THRUST, Waypoint
from zacoustic.console import Banner, html_text

REFRESH_S: Final = 0.5
_PRESSES_TOLD: Final = 8
_CLOSE_ENOUGH: Final = 1e-6


class Joint(msgspec.Struct, frozen=True):
    """A slider: its name here, and the joint's value."""

    name: str
    topic: str
    unit: str
    most: float
    """Either way, in that unit."""
    step: float
    factor: float
    """The joint's value for one unit; its signs are Gazebo's, forward is positive here."""
    ends: tuple[str, str]


_DEGREE: Final = math.radians(1.0)
JOINTS: Final = (
    Joint("thrust", THRUST, "N", 31.0, 1.0, -1.0, ("astern", "ahead")),
    Joint("rudder", RUDDER, "°", 15.0, 1.0, _DEGREE, ("port", "starboard")),
    Joint("elevator", ELEVATOR, "°", 15.0, 1.0, _DEGREE, ("bow up", "bow down")),
)
_KEYS: Final = {
    "ArrowLeft": (RUDDER, -1.0),
    "ArrowRight": (RUDDER, 1.0),
    "ArrowUp": (ELEVATOR, -1.0),
    "ArrowDown": (ELEVATOR, 1.0),
    "+": (THRUST, 2.0),
    "=": (THRUST, 2.0),
    "-": (THRUST, -2.0),
}
"""By how much a key moves which slider."""


class Page:
    """One browser's view of the station.

    Args:
        station: What it shows and does.
    """

    def __init__(self, station: ControlStation) -> None:
        self._station = station
        self._photo_at_s = -math.inf
        self._sizes: dict[str, Size] = {}
        self._sliders: dict[str, ui.slider] = {}
        self._fates: dict[str, ui.label] = {}
        self._hands_off: list[ui.element] = []
        ui.page_title("auv1")
        self._banner = Banner("NOT SENT")
        ui.add_css(look.CSS)
        ui.add_body_html(f"<script>{look.PRESS_JS}{look.KEYS_JS}</script>")
        ui.on("auv-key", self._key)
        ui.on("auv-stop", self._stop)
        with ui.element("div").classes("console"):
            self._head()
            self._sea()
            self._craft()
            self._hands()
            self._water()
        ui.timer(REFRESH_S, self.refresh)
        self.refresh()

    def refresh(self) -> None:
        """Show the present state."""
        station = self._station
        now_s, shore = station.now_s, station.shore
        estimate = shore.estimate(now_s)
        taken = [*station.presses_taken][-_PRESSES_TOLD:]
        self._banner.beat(readout.banner(station), taken=taken)
        self._show_head()
        self._show_why()
        self._map.set_content(
            map_of(shore, estimate, station.waypoints, self._target(), self._sizes["map"])
        )
        self._profile.set_content(
            profile_of(shore, now_s, station.wanted_depth, self._sizes["profile"])
        )
        self._attitude.set_content(attitude_of(shore.nav))
        self._values.set_content(look.values_table(readout.values(station)))
        self._show_photo()
        self._orders.set_content(look.orders_table(readout.order_lines(station)))
        watch, unix_s = station.watch, station.unix_s
        self._ladder.set_content(
            ladder_of(watch.frames(unix_s), watch.propagation_s, unix_s, self._sizes["ladder"])
        )
        water = look.lines_table(
            readout.water_lines(station), "nothing waits, nothing is on its way"
        )
        self._queue.set_content(water)
        self._link.set_content(look.lines_table(readout.link_lines(station), ""))
        self._hint.set_text(readout.steering_hint(station))
        for joint in JOINTS:
            wanted = station.setpoints.wanted.get(joint.topic, 0.0) / joint.factor
            self._sliders[joint.topic].value = round(wanted, 3) + 0.0
            self._fates[joint.topic].set_text(readout.setpoint_line(station, joint.topic))

    # Panels

    def _head(self) -> None:
        with ui.element("div").classes("head"):
            ui.label("auv1").classes("name").props("role=heading aria-level=1")
            self._mode = ui.label().classes("chip mode za-live").mark("mode")
            self._age = ui.html(sanitize=False).classes("chip za-live").mark("age")
            self._heard = ui.html(sanitize=False).classes("chip za-live").mark("heard")
            self._trouble = ui.label().classes("trouble")
            self._notice = ui.label().classes("hint").mark("notice")
            self._stop_button = ui.button("STOP", color="#b3261e").classes("stop text-h6")
            # The press goes the way of the keys, by an event that has an id.
            self._stop_button.on("click", self._stop, js_handler="() => window.auvStop()")

    def _sea(self) -> None:
        with ui.element("div").classes("panel sea za-live"):
            ui.label("Map, and depth of the last ten minutes").classes("caption")
            self._map = self._drawing("map", MAP_PX)
            self._map.on("click", self._clicked, js_handler=look.CLICK_JS)
            self._profile = self._drawing("profile", PROFILE_PX)

    def _craft(self) -> None:
        with ui.element("div").classes("panel craft za-live"):
            ui.label("Attitude, and the newest photo").classes("caption")
            with ui.element("div").classes("top"):
                self._attitude = ui.html(sanitize=False).classes("attitude").mark("attitude")
                self._picture = ui.html(sanitize=False).classes("picture").mark("photo")
            self._bar = ui.html(sanitize=False)
            with ui.element("div").classes("photo-lines"):
                self._photo_line = ui.label().mark("photo-line")
                self._photo_progress = ui.label().mark("photo-progress")
            ui.label("Vehicle").classes("caption")
            self._values = ui.html(sanitize=False).mark("values")

    def _hands(self) -> None:
        with ui.element("div").classes("hands"):
            with ui.element("div").classes("panel za-live"):
                with ui.element("div").classes("strip"):
                    ui.label("By hand").classes("caption")
                    self._hint = ui.label().classes("hint")
                for joint in JOINTS:
                    self._slider(joint)
                ui.html(look.KEYS_HINT, sanitize=False).classes("keys")
            with ui.element("div").classes("panel"):
                self._missions()
            with ui.element("div").classes("panel orders"):
                ui.label("Orders").classes("caption")
                ui.element("div").classes("press")
                self._orders = ui.html(sanitize=False).classes("za-live").mark("orders")

    def _water(self) -> None:
        with ui.element("div").classes("panel water"):
            with ui.element("div").classes("za-live"):
                with ui.element("div").classes("strip"):
                    ui.label("Water").classes("caption")
                    ui.html(look.LEGEND, sanitize=False).classes("kinds")
                self._ladder = self._drawing("ladder", LADDER_PX)
            with ui.element("div"):
                ui.label("In the water and in the queue").classes("caption")
                ui.element("div").classes("press")
                self._queue = ui.html(sanitize=False).classes("za-live").mark("queue")
            with ui.element("div").classes("za-live"):
                ui.label("Link").classes("caption")
                self._link = ui.html(sanitize=False).mark("link")

    def _drawing(self, name: str, size: Size) -> ui.html:
        """Make room for a drawing that is drawn in the size which the window has for it."""
        self._sizes[name] = size

        def resized(event: GenericEventArguments) -> None:
            width, height = event.args["width"], event.args["height"]
            if width > 1 and height > 1:
                self._sizes[name] = round(width), round(height)
                self.refresh()

        with ui.element("div").classes(f"drawing {name}"):
            found = ui.html(sanitize=False).mark(name)
            ui.element("q-resize-observer").on("resize", resized)
        return found

    def _slider(self, joint: Joint) -> None:
        with ui.element("div").classes("joint"):
            ui.label(joint.name)
            slider = ui.slider(
                min=-joint.most,
                max=joint.most,
                step=joint.step,
                value=0,
                on_change=lambda event: self._moved(joint, event.value),
            )
            slider.props(f'dense aria-label="{joint.name}"').mark(joint.name)
            self._hands_off.append(slider)
            ui.label().classes("value").bind_text_from(
                slider, "value", backward=lambda value: f"{value:+g} {joint.unit}" if value else "0"
            )
            fate = ui.label().classes("fate").mark(f"fate {joint.name}")
        self._sliders[joint.topic], self._fates[joint.topic] = slider, fate

    def _missions(self) -> None:
        station = self._station
        ui.label("Mission; a click on the map fills in north and east").classes("caption")
        self._why = ui.label().classes("why").mark("why")
        with ui.element("div").classes("fields za-live"):
            self._depth = _field("depth m", 10, 0, 70)
            self._speed = _field("speed m/s", 1.5, 0, 2.2)
            self._heading = _field("heading °", 90, 0, 360)
            self._north = _field("north m", 60, -2000, 2000)
            self._east = _field("east m", 160, -2000, 2000)
        with ui.element("div").classes("strip za-live").style("margin-top: 8px"):
            self._button("arm", lambda: station.arm(True))
            self._button("disarm", lambda: station.arm(False))
            self._button("by hand", station.by_hand)
            self._button("photo", station.photo)
        with ui.element("div").classes("strip za-live").style("margin-top: 6px"):
            self._button("hold", self._hold)
            self._button("go to", self._goto)
            self._button("cancel", station.cancel_goal)

    def _button(self, text: str, act: Callable[[], object]) -> None:
        made = ui.button(text, on_click=lambda: self._do(act), color="blue-grey-9")
        self._hands_off.append(made.props("dense unelevated no-caps"))

    # What is shown

    def _show_head(self) -> None:
        station = self._station
        self._mode.set_text(readout.mode(station))
        self._age.set_content(look.report_age(readout.report_age_s(station)))
        is_old = readout.is_report_old(station)
        self._age.classes(add="bad" if is_old else "good", remove="good" if is_old else "bad")
        heard_at, link = station.watch.heard_at_unix_s, readout.link_state(station)
        heard_s = None if heard_at is None else station.unix_s - heard_at
        self._heard.set_content(look.link_and_vehicle(link, heard_s))
        is_lost = station.watch.lost_since_unix_s is not None or link != "up"
        self._heard.classes(add="bad" if is_lost else "good", remove="good" if is_lost else "bad")
        self._trouble.set_text(station.trouble)
        is_starting = station.carrier is None and not station.trouble
        self._notice.set_text(readout.why_disabled(station) if is_starting else "")

    def _show_why(self) -> None:
        """Disable buttons without effect, with the reason."""
        why = readout.why_disabled(self._station)
        self._why.set_text(f"disabled: {why}" if why else "")
        self._stop_button.classes(add="dead" if why else "", remove="" if why else "dead")
        self._stop_button.props(f'data-note="{readout.stop_note(self._station)}"')
        for each in self._hands_off:
            if isinstance(each, DisableableElement) and each.enabled == bool(why):
                each.set_enabled(not why)
                each.props(f'title="disabled: {html_text(why)}"' if why else "", remove="title")

    def _show_photo(self) -> None:
        station = self._station
        self._photo_line.set_text(readout.photo_line(station))
        self._photo_progress.set_text(readout.photo_progress(station))
        share = readout.photo_share(station)
        bar = (
            "" if share is None else f'<div class="bar"><div style="width:{share:.0%}"></div></div>'
        )
        self._bar.set_content(bar)
        if not station.shore.photos:
            self._picture.set_content("no photo yet")
        elif station.shore.photo_came_at_s != self._photo_at_s:
            self._photo_at_s = station.shore.photo_came_at_s
            coded = base64.b64encode(station.shore.photos[-1]).decode()
            self._picture.set_content(f'<img alt="photo" src="data:image/png;base64,{coded}">')

    # What is done

    def _do(self, act: Callable[[], object]) -> None:
        """Do it, unless it was pressed long ago and comes only now. A stop is never too late."""
        if self._banner.is_current():
            act()
        else:
            ui.notify("not done: it was pressed before the connection was lost", type="warning")

    def _moved(self, joint: Joint, value: float) -> None:
        told = value * joint.factor
        setpoints = self._station.setpoints
        # A slider that follows other pages sends nothing.
        if (
            self._banner.is_current()
            and abs(told - setpoints.wanted.get(joint.topic, 0.0)) > _CLOSE_ENOUGH
        ):
            setpoints.set(joint.topic, told)

    def _key(self, event: GenericEventArguments) -> None:
        key = event.args
        if readout.why_disabled(self._station) or not self._banner.is_current():
            return
        if key == "0":
            for slider in self._sliders.values():
                slider.value = 0
        elif key in _KEYS:
            topic, by = _KEYS[key]
            joint = next(each for each in JOINTS if each.topic == topic)
            slider = self._sliders[topic]
            slider.value = max(-joint.most, min(joint.most, slider.value + by))

    def _stop(self, event: GenericEventArguments) -> None:
        """Stop; the heartbeat tells the browser that its press was taken."""
        try:
            press = msgspec.convert(event.args, Press)
        except msgspec.ValidationError:
            press = None  # whatever it is, it was meant to stop
        self._station.stop(press)
        self.refresh()

    def _clicked(self, event: GenericEventArguments) -> None:
        station = self._station
        x, y = event.args
        estimate = station.shore.estimate(station.now_s)
        view = view_of(station.shore, estimate, station.waypoints, self._sizes["map"])
        north, east = view.where(x, y)
        self._north.value, self._east.value = round(north), round(east)
        self.refresh()

    def _target(self) -> tuple[float, float] | None:
        north, east = self._north.value, self._east.value
        return None if north is None or east is None else (north, east)

    def _hold(self) -> None:
        depth, heading, speed = self._depth.value, self._heading.value, self._speed.value
        if None in (depth, heading, speed):
            ui.notify("hold needs depth, heading and speed", type="warning")
            return
        self._station.hold(depth, heading, speed)

    def _goto(self) -> None:
        target, depth, speed = self._target(), self._depth.value, self._speed.value
        if target is None or depth is None or speed is None:
            ui.notify("go to needs north, east, depth and speed", type="warning")
            return
        self._station.goto(Waypoint(*target, depth, speed))


def _field(label: str, value: float, least: float, most: float) -> ui.number:
    field = ui.number(label, value=value, min=least, max=most)
    return field.props("dense outlined hide-bottom-space")
