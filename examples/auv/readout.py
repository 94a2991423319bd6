"""The values at the station: each with its age, reported or predicted.

Functions of the station that return lines and tables as text; how they look is the page's business.
An age is that at the source: how long ago the vehicle had the value, not how long it has been here.
"""

import math
from typing import Final

import msgspec

from examples.auv.controlstation import CONFIRMED, ControlStation, Order
from examples.auv.fates import Fate
from examples.auv.linkwatch import Frame
from examples.auv.messages import ELEVATOR, RUDDER, STOP, THRUST, Mode
from examples.auv.setpoints import Setpoints
from examples.auv.start import NAV_PERIOD_S, STATUS_PERIOD_S
from zacoustic.console import Alarm

OLD_REPORTS: Final = 4
"""A value is old when so many of its reports have not come."""
REPORTS_WINDOW_S: Final = 120.0

_SHORT: Final = {RUDDER: "rudder", ELEVATOR: "elevator", THRUST: "thrust"}


class Value(msgspec.Struct, frozen=True):
    """One line of the table of values."""

    name: str
    reported: str
    age_s: float
    now: str = ""
    """As predicted; empty: it is not."""
    is_old: bool = False


class Line(msgspec.Struct, frozen=True):
    """One line of another table."""

    name: str
    text: str
    age_s: float | None = None
    is_bad: bool = False


class OrderLine(msgspec.Struct, frozen=True):
    """A command and its outcome."""

    text: str
    age_s: float
    outcome: str
    state: str
    """``waiting``, ``good`` or ``bad``."""


def ago(seconds: float) -> str:
    """Say a duration in words."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def short(stream: str) -> str:
    """Return the station's name of a stream."""
    return _SHORT.get(stream, stream.rpartition("/")[2])


# What is dead


def alarm(station: ControlStation) -> Alarm | None:
    """Return why no command reaches the vehicle now; None: it may."""
    if station.carrier is None:
        return Alarm(f"NOT SENT: {station.trouble}") if station.trouble else None
    if station.gateway_gone_at_s is not None:
        return Alarm("NOT SENT: gateway gone", station.now_s - station.gateway_gone_at_s)
    link, down_at_s = station.watch.documents.get("link"), station.watch.down_at_s
    if link is not None and down_at_s is not None:
        return Alarm(f"NOT SENT: link {link['state']}", station.now_s - down_at_s)
    if link is not None and link.get("silent"):
        why = link.get("why_silent") or "ordered, or a quiet window"
        return Alarm(f"NOT SENT: silence is kept, {why}")
    return None


def banner(station: ControlStation) -> Alarm | None:
    """Return what is dead, as it is for a STOP that is open; None: nothing.

    The banner, the orders and the queue say the same of a STOP.
    """
    dead, stop = alarm(station), station.open_stop
    if stop is None:
        return dead
    outcome, state = _outcome(station, stop)
    if state != "bad":
        return dead
    if dead is None:
        return Alarm(f"STOP: {outcome}", station.now_s - stop.at_s)
    return Alarm(f"STOP: {outcome} · {dead.text.removeprefix('NOT SENT: ')}", dead.since_s)


def why_disabled(station: ControlStation) -> str:
    """Return why only a stop can be commanded now; empty: anything can."""
    dead = alarm(station)
    if dead is not None:
        return dead.text.removeprefix("NOT SENT: ")
    return "modems, gateways and vehicle start" if station.carrier is None else ""


def stop_note(station: ControlStation) -> str:
    """Say what would become of a STOP that is pressed now; empty: it is sent."""
    if not why_disabled(station):
        return ""
    is_kept = station.carrier is not None and station.gateway_gone_at_s is None
    return "the gateway keeps it" if is_kept else "will not be sent"


# The vehicle


def mode(station: ControlStation) -> str:
    """Say who steers, as the vehicle has reported."""
    nav = station.shore.nav
    return "not heard yet" if nav is None else nav.mode.value


def report_age_s(station: ControlStation) -> float | None:
    """Return how old the newest report is; None: there is none."""
    return None if station.shore.nav is None else station.now_s - station.shore.nav_made_at_s


def is_report_old(station: ControlStation) -> bool:
    """Tell whether several reports have not come."""
    age_s = report_age_s(station)
    return age_s is None or age_s > OLD_REPORTS * NAV_PERIOD_S


def values(station: ControlStation) -> list[Value]:
    """Return what the vehicle has reported, and what it probably is now."""
    shore, now_s = station.shore, station.now_s
    estimate, nav, status = shore.estimate(now_s), shore.nav, shore.status
    found: list[Value] = []
    if nav is not None and estimate is not None:
        age_s, is_old = estimate.age_s, is_report_old(station)
        rows = (
            (
                "depth",
                f"{nav.depth:.1f} m",
                f"{estimate.depth:.1f} ± {_metres(estimate.depth_sigma)}",
            ),
            (
                "position",
                f"{_place(nav.north, nav.east)} ± {_metres(nav.sigma)}",
                f"{_place(estimate.north, estimate.east)} ± {_metres(estimate.sigma)}",
            ),
            ("heading", f"{nav.heading:.0f}°", f"{estimate.heading:.0f}°"),
            ("speed", f"{nav.speed:.2f} m/s", ""),
            ("turning", f"{nav.turn:+.1f} °/s", ""),
            ("pitch, roll", f"{round(nav.pitch)}°, {round(nav.roll)}°", ""),
        )
        found += [Value(name, said, age_s, now, is_old) for name, said, now in rows]
    if status is not None:
        age_s = now_s - shore.status_made_at_s
        is_old = age_s > OLD_REPORTS * STATUS_PERIOD_S
        found += [
            Value("above the bed", f"{status.altitude:.0f} m", age_s, "", is_old),
            Value("battery", f"{status.battery:.0f} %", age_s, "", is_old),
        ]
    return found


# Orders


def order_lines(station: ControlStation) -> list[OrderLine]:
    """Return the outcomes of the commands, newest first.

    A stop whose end is open is the same command as the newest one, and has no other state.
    """
    newest = station.open_stop
    return [
        OrderLine(
            each.text,
            station.now_s - each.at_s,
            *_outcome(station, newest if newest and _is_open_stop(each) else each),
        )
        for each in reversed(station.orders)
    ]


def _is_open_stop(order: Order) -> bool:
    return order.answer is None and not order.is_over


def setpoint_line(station: ControlStation, topic: str) -> str:
    """Say what became of the set-point of a joint; empty: nothing is wanted."""
    setpoints: Setpoints = station.setpoints
    if topic in setpoints.waiting:
        return f"goes in {setpoints.due_in_s(station.now_s):.0f} s"
    fate = station.watch.fates.of(topic) if topic in setpoints.wanted else None
    return "" if fate is None else fate.value


def steering_hint(station: ControlStation) -> str:
    """Say why set-points do nothing now; empty: they count, as far as it is known."""
    nav = station.shore.nav
    match None if nav is None else nav.mode:
        case Mode.MANUAL | None:
            return ""
        case Mode.DISARMED | Mode.STOPPED:
            return "arm first: the propeller stands"
        case Mode.SURFACING:
            return "the vehicle surfaces: the shore was lost"
        case _:
            return "the autopilot steers: press “by hand” first"


# Link, queue and channel


def link_state(station: ControlStation) -> str:
    """Return the state of the modem's link, as far as anybody knows it."""
    if station.gateway_gone_at_s is not None:
        return "not known, gateway gone"
    return str(station.watch.documents.get("link", {}).get("state", "not heard yet"))


def link_lines(station: ControlStation) -> list[Line]:
    """Say how good the link is."""
    watch, unix_s = station.watch, station.unix_s
    link = watch.documents.get("link")
    if link is None:
        return [Line("modem", "not heard yet")]
    if station.gateway_gone_at_s is not None:
        gone_s = station.now_s - station.gateway_gone_at_s
        return [Line("modem", "not known: the gateway is gone", gone_s, is_bad=True)]
    found = [Line("modem", link["state"], is_bad=link["state"] != "up")]
    heard_at = watch.heard_at_unix_s
    if watch.lost_since_unix_s is not None:
        found.append(Line("vehicle", "LOST", unix_s - watch.lost_since_unix_s, is_bad=True))
    measured = watch.documents.get("peer/2/range")
    if measured is not None:
        metres = "" if measured["range_m"] is None else f"{measured['range_m']:.0f} m, "
        text = f"{metres}{measured['propagation_s']:.2f} s"
        found.append(Line("range", text, unix_s - measured["measured_at_unix_s"]))
    if heard_at is not None:
        found.append(Line("signal", _signal(watch.metrics), unix_s - heard_at))
    came, due = _reports(station)
    if due:
        found.append(Line("reports", f"{came} of {due} in 2 min", is_bad=2 * came < due))
    share = watch.airtime_share(station.now_s)
    if share is not None:
        found.append(Line("own airtime", f"{share:.0%} of a minute"))
    lost = "" if watch.loss is None else f", {watch.loss:.0%} of ours lost"
    frames = f"{link['frames_transmitted']} sent, {link['frames_received']} heard{lost}"
    found.append(Line("frames", frames))
    return found


def water_lines(station: ControlStation) -> list[Line]:
    """Return the frames on the channel, and what waits."""
    watch = station.watch
    found = [
        Line(_content(frame), f"in the water, there in {left_s:.1f} s")
        for frame, left_s in watch.in_water(station.unix_s)
    ]
    stop = station.open_stop
    if stop is not None and stop.fate is not Fate.THERE:
        outcome, state = _outcome(station, stop)
        found.append(Line(short(STOP), outcome, is_bad=state == "bad"))
    for each in watch.waiting():
        if stop is not None and each.stream == STOP:
            continue  # said above, in the words of the orders
        if each.unacknowledged > each.queued:
            text = "waits for its acknowledgement"
        else:
            text = f"{each.queued} in the queue"
        found.append(Line(short(each.stream), text, is_bad=each.stream == STOP))
    if (share := photo_share(station)) is not None:
        found.append(Line("photo", f"comes, about {share:.0%} is here"))
    found += [
        Line(f"{short(topic)} {value:g}", "waits here: one set-point in 3 s")
        for topic, value in station.setpoints.waiting.items()
    ]
    return found


def photo_line(station: ControlStation) -> str:
    """Say how old the photo is that is shown."""
    if not station.shore.photos:
        return ""
    came = f"came {ago(station.now_s - station.shore.photo_came_at_s)} ago"
    if station.photo_asked_at_s is None:
        return came
    return f"{came}, asked for {ago(station.now_s - station.photo_asked_at_s)} ago"


def photo_progress(station: ControlStation) -> str:
    """Say how much of the next photo is here; empty: none is on its way."""
    arriving = station.watch.arriving(station.now_s)
    if not arriving:
        return ""
    first = arriving[0]
    if first.total_bytes is None:
        return f"{first.done_bytes} bytes of the next"
    left = "" if first.left_s is None else f", about {ago(first.left_s)} left"
    return f"{first.done_bytes / 1000:.1f} of {first.total_bytes / 1000:.1f} kB{left}"


def photo_share(station: ControlStation) -> float | None:
    """Return about which share of the photo is here; None: none is on its way."""
    arriving = station.watch.arriving(station.now_s)
    if not arriving:
        return None
    return arriving[0].share or 0.0


def _place(north: float, east: float) -> str:
    return f"{round(north)} N {round(east)} E"


def _metres(sigma: float) -> str:
    return f"{sigma:.1f} m" if sigma < 10 else f"{sigma:.0f} m"


def _outcome(station: ControlStation, order: Order) -> tuple[str, str]:
    answer = order.answer
    if answer is None:
        if order.is_confirmed:
            return CONFIRMED, "good"
        return _fate(station, order, Fate.GIVEN if order.fate is None else order.fate)
    if not answer.ended and station.gateway_gone_at_s is not None:
        return "not known: the gateway is gone", "bad"
    if answer.ended:
        return ("done", "good") if answer.is_good else (answer.text or "failed", "bad")
    if not answer.accepted:
        return "not answered yet", "waiting"
    return f"accepted, under way{_distance_left(station)}", "waiting"


def _fate(station: ControlStation, order: Order, fate: Fate) -> tuple[str, str]:
    """Say what became of a sample: what waits behind something dead is not on its way."""
    dead = alarm(station)
    if fate.is_over or dead is None:
        return fate.value, "bad" if fate in (Fate.LOST, Fate.NOT_SENT) else "waiting"
    why = dead.text.removeprefix("NOT SENT: ")
    dead_at_s = math.inf if dead.since_s is None else station.now_s - dead.since_s
    if fate is Fate.UNDER_WAY and order.at_s < dead_at_s:
        return f"not known: it was on its way when this began: {why}", "bad"
    kept = "; the gateway keeps it" if fate is Fate.UNDER_WAY else ""
    return f"NOT SENT: {why}{kept}", "bad"


def _distance_left(station: ControlStation) -> str:
    estimate = station.shore.estimate(station.now_s)
    if estimate is None or not station.waypoints:
        return ""
    goal = station.waypoints[-1]
    metres = ((goal.north - estimate.north) ** 2 + (goal.east - estimate.east) ** 2) ** 0.5
    return f", about {metres:.0f} m left"


def _signal(metrics: dict[str, float | None]) -> str:
    parts = []
    if (level_db := metrics.get("received_level_db")) is not None:
        parts.append(f"{level_db:.0f} dB")
    if (snr_db := metrics.get("snr_db")) is not None:
        parts.append(f"SNR {snr_db:.0f} dB")
    if (integrity := metrics.get("integrity")) is not None:
        parts.append(f"integrity {integrity:.0f}")
    return ", ".join(parts) or "not measured"


def _reports(station: ControlStation) -> tuple[int, int]:
    """Return how many reports of the last minutes are here, and how many were made."""
    track, now_s = station.shore.track, station.now_s
    # The newest may still be under way.
    until_s = now_s - station.watch.way_s - NAV_PERIOD_S
    since_s = max(until_s - REPORTS_WINDOW_S, track[0][0] if track else until_s)
    came = sum(1 for made_at_s, _ in track if since_s < made_at_s <= until_s)
    due = max(0, round((until_s - since_s) / NAV_PERIOD_S))
    return min(came, due), due


def _content(frame: Frame) -> str:
    names = ", ".join(short(each) for each in frame.streams)
    return f"{names or 'acknowledgement'}, {frame.bytes} bytes"
