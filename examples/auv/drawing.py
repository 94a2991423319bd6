"""Map, depth profile and attitude as SVG: functions of what the shore knows, nothing loaded."""

import math
from collections.abc import Callable, Iterable
from typing import Final

from examples.auv.messages import Nav, Waypoint
from examples.auv.shore import Estimate, Shore

MAP_PX: Final = 420
PROFILE_PX: Final = (420, 140)
LEAST_SPAN_M: Final = 120.0
PROFILE_S: Final = 600.0

_TRACK: Final = "#2a7fb8"
_NOW: Final = "#d9480f"
_GRID: Final = "#d8e0e6"
_TEXT: Final = "#5b6b75"


def map_of(shore: Shore, estimate: Estimate | None, waypoints: Iterable[Waypoint] = ()) -> str:
    """Draw where the vehicle was and where it probably is, north up; rings of one and two sigma."""
    goals = list(waypoints)
    places = [(nav.north, nav.east) for _, nav in shore.track]
    places += [(each.north, each.east) for each in goals]
    if estimate is not None:
        places.append((estimate.north, estimate.east))
    norths, easts = [p[0] for p in places] or [0.0], [p[1] for p in places] or [0.0]
    middle_north, middle_east = (max(norths) + min(norths)) / 2, (max(easts) + min(easts)) / 2
    span = max(LEAST_SPAN_M, max(norths) - min(norths), max(easts) - min(easts)) * 1.25
    scale = MAP_PX / span

    def place(north: float, east: float) -> tuple[float, float]:
        x = MAP_PX / 2 + (east - middle_east) * scale
        return x, MAP_PX / 2 - (north - middle_north) * scale

    drawn = [*_grid(middle_north, middle_east, span, place)]
    points = " ".join("{:.1f},{:.1f}".format(*place(nav.north, nav.east)) for _, nav in shore.track)
    drawn.append(f'<polyline points="{points}" fill="none" stroke="{_TRACK}" stroke-width="2"/>')
    for number, goal in enumerate(goals, 1):
        x, y = place(goal.north, goal.east)
        drawn.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="none" stroke="#2b8a3e"/>')
        drawn.append(_text(x + 8, y + 4, f"{number}: {goal.depth:g} m"))
    if estimate is not None:
        x, y = place(estimate.north, estimate.east)
        for rings in (1, 2):
            radius = max(3.0, rings * estimate.sigma * scale)
            drawn.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{_NOW}" '
                f'fill-opacity="0.12" stroke="{_NOW}" stroke-opacity="0.4"/>'
            )
        drawn.append(
            f'<path d="M0,-9 L5,7 L0,4 L-5,7 Z" fill="{_NOW}" '
            f'transform="translate({x:.1f},{y:.1f}) rotate({estimate.heading:.0f})"/>'
        )
    return _svg(MAP_PX, MAP_PX, drawn, "map")


def profile_of(shore: Shore, now_s: float) -> str:
    """Draw the depth of the last ten minutes; what is old ends where it ends."""
    width, height = PROFILE_PX
    recent = [(at_s, nav) for at_s, nav in shore.track if now_s - at_s <= PROFILE_S]
    deepest = max([10.0, *(nav.depth * 1.2 for _, nav in recent)])
    points = " ".join(
        f"{width * (1 - (now_s - at_s) / PROFILE_S):.1f},{height * nav.depth / deepest:.1f}"
        for at_s, nav in recent
    )
    drawn = [
        f'<polyline points="{points}" fill="none" stroke="{_TRACK}" stroke-width="2"/>',
        _text(4, 12, "0 m"),
        _text(4, height - 4, f"{deepest:.0f} m, 10 minutes"),
    ]
    return _svg(width, height, drawn, "depth")


def attitude_of(nav: Nav | None) -> str:
    """Draw an artificial horizon as of the last report."""
    if nav is None:
        return _svg(120, 120, [_text(20, 64, "not heard yet")], "attitude")
    shift = max(-50.0, min(50.0, nav.pitch * 1.5))
    drawn = [
        f'<g transform="rotate({-nav.roll:.0f} 60 60) translate(0 {shift:.1f})">'
        '<rect x="-60" y="-120" width="240" height="180" fill="#a5d8ff"/>'
        '<rect x="-60" y="60" width="240" height="180" fill="#1c7ed6"/></g>',
        f'<path d="M30,60 H52 M68,60 H90 M60,60 v1" stroke="{_NOW}" stroke-width="3"/>',
    ]
    return _svg(120, 120, drawn, "attitude")


def _grid(
    north: float, east: float, span: float, place: Callable[[float, float], tuple[float, float]]
) -> Iterable[str]:
    step = 10.0 ** math.floor(math.log10(span / 2))
    for index in range(math.floor((east - span) / step), math.ceil((east + span) / step)):
        x, _ = place(0.0, index * step)
        yield f'<path d="M{x:.1f},0 V{MAP_PX}" stroke="{_GRID}"/>'
    for index in range(math.floor((north - span) / step), math.ceil((north + span) / step)):
        _, y = place(index * step, 0.0)
        yield f'<path d="M0,{y:.1f} H{MAP_PX}" stroke="{_GRID}"/>'
    yield _text(4, MAP_PX - 6, f"grid {step:g} m, north up")


def _text(x: float, y: float, text: str) -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" font-size="11" fill="{_TEXT}">{text}</text>'


def _svg(width: int, height: int, drawn: Iterable[str], name: str) -> str:
    return (
        f'<svg viewBox="0 0 {width} {height}" width="{width}" height="{height}" role="img" '
        f'aria-label="{name}" style="background:#f4f8fb;border-radius:6px;overflow:hidden">'
        f"{''.join(drawn)}</svg>"
    )
