"""Map, depth profile and attitude as SVG: functions of what the shore knows, nothing loaded.

Reported values have one colour; predicted ones have another and are dashed.
"""

import math
from collections.abc import Iterable
from typing import Final

import msgspec

from examples.auv.messages import Nav, Waypoint
from examples.auv.shore import Estimate, Shore

Size = tuple[int, int]
"""Width and height, pixels."""
MAP_PX: Final[Size] = (640, 470)
PROFILE_PX: Final[Size] = (640, 130)
LEAST_SPAN_M: Final = 120.0
PROFILE_S: Final = 600.0
TRACK_POINTS: Final = 400
"""Points of the track that are drawn: a longer one is thinned out."""

REPORTED: Final = "#4fb6e3"
PREDICTED: Final = "#f2a93b"
GOAL: Final = "#5fd08a"
GRID: Final = "#22323e"
DIM: Final = "#7f97a6"
WATER: Final = "#0e1a23"

_LEAST_GRID_PX: Final = 56.0
_SPANS_M: Final = (120, 200, 300, 500, 800, 1200, 2000, 3000, 5000)


class View(msgspec.Struct, frozen=True):
    """The part of the sea that the map shows."""

    north: float
    """Of the middle, m."""
    east: float
    span_m: float
    """From the lower edge to the upper one."""
    size: Size = MAP_PX
    """Of the map, pixels."""

    @property
    def scale(self) -> float:
        """Pixels of a metre."""
        return self.size[1] / self.span_m

    def place(self, north: float, east: float) -> tuple[float, float]:
        """Return where a place is on the map."""
        width, height = self.size
        x = width / 2 + (east - self.east) * self.scale
        return x, height / 2 - (north - self.north) * self.scale

    def where(self, x: float, y: float) -> tuple[float, float]:
        """Return which place is there on the map: north and east."""
        width, height = self.size
        north = self.north + (height / 2 - y) / self.scale
        return north, self.east + (x - width / 2) / self.scale


def view_of(
    shore: Shore,
    estimate: Estimate | None,
    waypoints: Iterable[Waypoint] = (),
    size: Size = MAP_PX,
) -> View:
    """Return a view that shows everything; in steps, so that the map does not swim."""
    places = [(nav.north, nav.east) for _, nav in shore.track]
    places += [(each.north, each.east) for each in waypoints]
    if estimate is not None:
        places.append((estimate.north, estimate.east))
    norths, easts = [p[0] for p in places] or [0.0], [p[1] for p in places] or [0.0]
    wide = (max(easts) - min(easts)) * size[1] / size[0]
    needed_m = max(LEAST_SPAN_M, 1.3 * (max(norths) - min(norths)), 1.3 * wide)
    span_m = next((each for each in _SPANS_M if each >= needed_m), needed_m)
    step_m = span_m / 10

    def snapped(low: float, high: float) -> float:
        return round((low + high) / 2 / step_m) * step_m

    middle = snapped(min(norths), max(norths)), snapped(min(easts), max(easts))
    return View(*middle, float(span_m), size)


def map_of(
    shore: Shore,
    estimate: Estimate | None,
    waypoints: Iterable[Waypoint] = (),
    target: tuple[float, float] | None = None,
    size: Size = MAP_PX,
) -> str:
    """Draw where the vehicle was and where it probably is, north up; rings of one and two sigma.

    Args:
        shore: What is known.
        estimate: Where the vehicle probably is.
        waypoints: Where it was sent, the newest last.
        target: Where it may be sent next: north and east.
        size: Of the map.
    """
    goals = list(waypoints)
    view = view_of(shore, estimate, goals, size)
    drawn = [*_grid(view)]
    points = [view.place(nav.north, nav.east) for _, nav in _thinned(shore.track)]
    drawn.append(_line(points, REPORTED))
    drawn += [_dot(x, y, 1.6, REPORTED) for x, y in points[-60:]]
    for number, goal in enumerate(goals, 1):
        x, y = view.place(goal.north, goal.east)
        opacity = 1.0 if number == len(goals) else 0.45
        drawn.append(
            f'<g opacity="{opacity}"><circle cx="{x:.1f}" cy="{y:.1f}" r="6" fill="none" '
            f'stroke="{GOAL}" stroke-width="1.5"/>{_dot(x, y, 1.5, GOAL)}'
            f"{_text(x + 10, y + 4, f'{goal.depth:g} m deep', GOAL)}</g>"
        )
    if target is not None:
        x, y = view.place(*target)
        drawn.append(
            f'<path d="M{x - 7:.1f},{y:.1f} h14 M{x:.1f},{y - 7:.1f} v14" stroke="{GOAL}" '
            'stroke-width="1.2" stroke-dasharray="2 2"/>'
        )
    if estimate is not None and shore.nav is not None:
        drawn += _vehicle(view, shore.nav, estimate)
    return _svg(*size, drawn, "map")


def profile_of(
    shore: Shore, now_s: float, wanted_depth: float | None = None, size: Size = PROFILE_PX
) -> str:
    """Draw the depth of the last ten minutes; what follows the last report is predicted."""
    width, height = size
    recent = [(at_s, nav) for at_s, nav in shore.track if now_s - at_s <= PROFILE_S]
    depths = [nav.depth for _, nav in recent] + ([] if wanted_depth is None else [wanted_depth])
    deepest = next(
        each for each in (10, 20, 30, 50, 80, 120) if each >= max([0.0, *depths]) * 1.1 or each > 99
    )
    left, bottom = 34.0, height - 16.0

    def place(at_s: float, depth: float) -> tuple[float, float]:
        x = left + (width - left - 8) * (1 - (now_s - at_s) / PROFILE_S)
        return x, 8 + (bottom - 8) * max(0.0, depth) / deepest

    drawn = []
    for share in (0.0, 0.5, 1.0):
        _, y = place(now_s, share * deepest)
        drawn.append(f'<path d="M{left},{y:.1f} H{width - 8}" stroke="{GRID}"/>')
        drawn.append(_text(left - 4, y + 4, f"{share * deepest:g}", anchor="end"))
    for minutes in (8, 6, 4, 2, 0):
        x, _ = place(now_s - 60 * minutes, 0.0)
        word = "now" if minutes == 0 else f"−{minutes} min"
        drawn.append(_text(x, height - 3, word, anchor="middle" if minutes else "end"))
    if wanted_depth is not None:
        _, y = place(now_s, wanted_depth)
        drawn.append(
            f'<path d="M{left},{y:.1f} H{width - 8}" stroke="{GOAL}" stroke-dasharray="2 4"/>'
        )
    drawn.append(_line([place(at_s, nav.depth) for at_s, nav in recent], REPORTED))
    estimate = shore.estimate(now_s)
    if estimate is not None and recent:
        begin, end = place(recent[-1][0], recent[-1][1].depth), place(now_s, estimate.depth)
        drawn.append(_line([begin, end], PREDICTED, dash="3 3"))
        _, low = place(now_s, estimate.depth + 2 * estimate.depth_sigma)
        _, high = place(now_s, estimate.depth - 2 * estimate.depth_sigma)
        x = end[0]
        drawn.append(
            f'<path d="M{x:.1f},{high:.1f} V{low:.1f}" stroke="{PREDICTED}" stroke-width="3" '
            'opacity="0.6"/>'
        )
    return _svg(width, height, drawn, "depth")


def attitude_of(nav: Nav | None) -> str:
    """Draw an artificial horizon with a compass below it, as of the last report."""
    size = 120
    if nav is None:
        words = _text(60, 64, "not heard yet", anchor="middle")
        return _svg(size, size, [words], "attitude")
    shift = max(-50.0, min(50.0, nav.pitch * 1.5))
    ladder = "".join(
        f'<path d="M{60 - half},{60 - 1.5 * pitch} h{2 * half}" stroke="#fff" opacity="0.7"/>'
        for pitch, half in ((20, 14), (10, 9), (-10, 9), (-20, 14))
    )
    drawn = [
        f'<g transform="rotate({-nav.roll:.0f} 60 60) translate(0 {shift:.1f})">'
        '<rect x="-60" y="-120" width="240" height="180" fill="#2d6f94"/>'
        '<rect x="-60" y="60" width="240" height="180" fill="#143247"/>'
        f'<path d="M-60,60 h240" stroke="#dbe9f2"/>{ladder}</g>',
        f'<path d="M26,60 H48 L54,66 M94,60 H72 L66,66" fill="none" stroke="{REPORTED}" '
        'stroke-width="3"/>',
        _dot(60, 60, 2.5, REPORTED),
    ]
    drawn += _compass(nav.heading)
    return _svg(size, size, drawn, "attitude")


def _vehicle(view: View, nav: Nav, estimate: Estimate) -> Iterable[str]:
    """Where it was reported, where it is probably, and how sure that is."""
    x, y = view.place(estimate.north, estimate.east)
    for rings in (2, 1):
        radius = max(2.0, rings * estimate.sigma * view.scale)
        yield (
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{PREDICTED}" '
            f'fill-opacity="0.10" stroke="{PREDICTED}" stroke-opacity="0.5"/>'
        )
    was_x, was_y = view.place(nav.north, nav.east)
    yield _line([(was_x, was_y), (x, y)], PREDICTED, dash="3 3")
    yield _arrow(was_x, was_y, nav.heading, f'fill="{REPORTED}" opacity="0.55"')
    look = f'fill="{WATER}" stroke="{PREDICTED}" stroke-width="1.6"'
    yield _arrow(x, y, estimate.heading, look)


def _arrow(x: float, y: float, heading: float, look: str) -> str:
    where = f"translate({x:.1f},{y:.1f}) rotate({heading:.0f})"
    return f'<path d="M0,-11 L6,8 L0,4 L-6,8 Z" {look} transform="{where}"/>'


def _compass(heading: float) -> Iterable[str]:
    """A tape of headings at the lower edge."""
    yield f'<rect x="0" y="98" width="120" height="22" fill="{WATER}" opacity="0.85"/>'
    for degrees in range(math.ceil((heading - 60) / 30) * 30, round(heading) + 61, 30):
        x = 60 + (degrees - heading) * 1.0
        name = {0: "N", 90: "E", 180: "S", 270: "W"}.get(degrees % 360, f"{degrees % 360}")
        yield _text(x, 114, name, anchor="middle")
    yield f'<path d="M60,98 l-4,-5 h8 Z" fill="{REPORTED}"/>'


def _grid(view: View) -> Iterable[str]:
    width, height = view.size
    widths_m = (10, 20, 50, 100, 200, 500, 1000, 2000)
    step_m = next((each for each in widths_m if each * view.scale >= _LEAST_GRID_PX), widths_m[-1])
    top, left = view.where(0.0, 0.0)
    bottom, right = view.where(width, height)
    for index in range(math.ceil(left / step_m), math.floor(right / step_m) + 1):
        x, _ = view.place(0.0, index * step_m)
        yield f'<path d="M{x:.1f},0 V{height}" stroke="{GRID}"/>'
        if 40 < x < width - 90:
            yield _text(x + 3, 12, f"{index * step_m} E")
    for index in range(math.ceil(bottom / step_m), math.floor(top / step_m) + 1):
        _, y = view.place(index * step_m, 0.0)
        yield f'<path d="M0,{y:.1f} H{width}" stroke="{GRID}"/>'
        if 20 < y < height - 30:
            yield _text(4, y - 3, f"{index * step_m} N")
    bar = step_m * view.scale
    yield (
        f'<path d="M{width - 16 - bar:.1f},{height - 14} h{bar:.1f} m0,-4 v8 '
        f'm{-bar:.1f},0 v-8" stroke="{DIM}" fill="none"/>'
    )
    yield _text(width - 16 - bar / 2, height - 20, f"{step_m} m", anchor="middle")
    yield (
        f'<g transform="translate({width - 22},26)"><path d="M0,-14 L5,4 L0,1 L-5,4 Z" '
        f'fill="{DIM}"/>{_text(0, 18, "N", anchor="middle")}</g>'
    )


def _thinned(track: list[tuple[float, Nav]]) -> list[tuple[float, Nav]]:
    """The newest points as they are, those before them as thin as they must be."""
    newest = TRACK_POINTS // 2
    step = max(1, math.ceil((len(track) - newest) / newest))
    return [*track[:-newest:step], *track[-newest:]]


def _line(points: Iterable[tuple[float, float]], colour: str, dash: str = "") -> str:
    drawn = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    dashed = f' stroke-dasharray="{dash}"' if dash else ""
    return f'<polyline points="{drawn}" fill="none" stroke="{colour}" stroke-width="2"{dashed}/>'


def _dot(x: float, y: float, radius: float, colour: str) -> str:
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius}" fill="{colour}"/>'


def _text(x: float, y: float, text: str, colour: str = DIM, anchor: str = "start") -> str:
    return (
        f'<text x="{x:.0f}" y="{y:.0f}" font-size="11" fill="{colour}" '
        f'text-anchor="{anchor}">{text}</text>'
    )


def _svg(width: int, height: int, drawn: Iterable[str], name: str) -> str:
    return (
        f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{name}" '
        f'preserveAspectRatio="xMidYMid meet">{"".join(drawn)}</svg>'
    )
