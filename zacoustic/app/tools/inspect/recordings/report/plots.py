"""The plots of a report, as SVG inside a page. Needs the extra `report`."""

import itertools
from collections import Counter
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final

from zacoustic.app.tools.inspect.recordings.facts.facts import Delivery, Facts
from zacoustic.app.tools.inspect.recordings.facts.rows import in_order
from zacoustic.app.tools.inspect.recordings.report.figures import Figures
from zacoustic.app.tools.inspect.recordings.report.linkfigures import losses_over_time, numbers_of
from zacoustic.app.tools.pages.plots import Plot, draw, label, need_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BINS: Final = 60
_MOST_POINTS: Final = 2000
"""Most points of one plot: more make a page slow and are invisible."""
_MOST_ROWS: Final = 16

Point = tuple[float, float]


def plots_of(facts: Facts, figures: Figures) -> list[Plot]:
    """Draw all plots with data.

    Raises:
        ConfigError: The extra is missing.
    """
    candidates: tuple[tuple[str, Callable[[Axes], bool]], ...] = (
        ("Delivery by stream", lambda axes: _delivery(axes, figures)),
        ("Latency over time, s", lambda axes: _latency(axes, facts)),
        ("Airtime by stream, s", lambda axes: _airtime(axes, figures)),
        ("Channel in use, share of the time", lambda axes: _utilisation(axes, facts)),
        ("Signal-to-noise ratio, dB", lambda axes: _metric(axes, facts, "snr_db")),
        ("Received level, dB", lambda axes: _metric(axes, facts, "received_level_db")),
        ("Signal integrity", lambda axes: _metric(axes, facts, "integrity")),
        ("Range, m", lambda axes: _metric(axes, facts, "range_m")),
        ("Propagation delay, s", lambda axes: _metric(axes, facts, "propagation_s")),
        ("Frames that did not arrive, share", lambda axes: _loss(axes, facts)),
        ("Bytes by cause", lambda axes: _causes(axes, figures)),
    )
    need_matplotlib("report")
    drawn = (draw(title, fill) for title, fill in candidates)
    return [plot for plot in drawn if plot is not None]


def _delivery(axes: "Axes", figures: Figures) -> bool:
    streams = [each for each in figures.streams if each.expected][:_MOST_ROWS]
    if not streams:
        return False
    names = [label(each.name) for each in streams]
    axes.barh(names, [each.delivered / each.expected for each in streams], color="tab:green")
    axes.set_xlim(0, 1)
    axes.invert_yaxis()
    return True


def _latency(axes: "Axes", facts: Facts) -> bool:
    names = {stream_id: label(stream.name) for stream_id, stream in facts.streams.items()}
    ended = (in_order(Delivery, rows) for rows in (facts.deliveries, facts.answers))
    points = (
        (names[each.stream_id], (_since(facts, each.at_ns), (each.at_ns - each.begun_ns) / 1e9))
        for each in itertools.chain.from_iterable(ended)
    )
    return _scatter(axes, points, len(facts.deliveries) + len(facts.answers))


def _airtime(axes: "Axes", figures: Figures) -> bool:
    streams = sorted(
        (each for each in figures.streams if each.airtime_s), key=lambda each: -each.airtime_s
    )[:_MOST_ROWS]
    if not streams:
        return False
    axes.barh([label(each.name) for each in streams], [each.airtime_s for each in streams])
    axes.invert_yaxis()
    return True


def _utilisation(axes: "Axes", facts: Facts) -> bool:
    width_s = facts.duration_s / _BINS
    if width_s <= 0:
        return False
    bottoms = [0.0] * _BINS
    edges = [width_s * (index + 0.5) for index in range(_BINS)]
    rows = {node: [0.0] * _BINS for node in facts.nodes}
    for frame in facts.frames:
        if frame.is_sent:
            index = min(_BINS - 1, int(_since(facts, frame.at_ns) / width_s))
            rows[frame.node][index] += frame.airtime_s / width_s
    for node, shares in rows.items():
        axes.bar(edges, shares, width=width_s, bottom=bottoms, label=f"node {node}")
        bottoms = [below + share for below, share in zip(bottoms, shares, strict=True)]
    _time_axis(axes)
    axes.legend(fontsize=8)
    return any(bottoms)


def _metric(axes: "Axes", facts: Facts, name: str) -> bool:
    points = (
        (f"{source} to {node}", (_since(facts, utc_ns), number))
        for utc_ns, (source, node), number in numbers_of(facts, name)
    )
    return _scatter(axes, points, sum(1 for _ in numbers_of(facts, name)))


def _loss(axes: "Axes", facts: Facts) -> bool:
    bins = _BINS // 2
    width_s = facts.duration_s / bins
    if width_s <= 0 or len(facts.nodes) < 2:
        return False
    lost = losses_over_time(facts, bins)
    for (source, node), row in lost.items():
        xs = [width_s * (index + 0.5) for index, _ in row]
        ys = [share for _, share in row]
        axes.plot(xs, ys, marker=".", linewidth=1, label=f"{source} to {node}")
    axes.set_ylim(0, 1)
    _time_axis(axes)
    if lost:
        axes.legend(fontsize=8)
    return bool(lost)


def _causes(axes: "Axes", figures: Figures) -> bool:
    causes = sorted({cause for node in figures.nodes for cause in node.by_cause})
    if not causes:
        return False
    left = [0] * len(causes)
    for node in figures.nodes:
        sizes = [node.by_cause.get(cause, 0) for cause in causes]
        axes.barh(causes, sizes, left=left, label=f"node {node.node}")
        left = [before + size for before, size in zip(left, sizes, strict=True)]
    axes.invert_yaxis()
    axes.legend(fontsize=8)
    return True


def _scatter(axes: "Axes", points: Iterable[tuple[str, Point]], whole: int) -> bool:
    """Draw points of named rows, at regular intervals if there are too many.

    Args:
        axes: The plot.
        points: Row and point.
        whole: Their number.
    """
    step = max(1, -(-whole // _MOST_POINTS))
    rows: dict[str, list[Point]] = {}
    seen: Counter[str] = Counter()
    for name, point in points:
        if seen[name] % step == 0:
            rows.setdefault(name, []).append(point)
        seen[name] += 1
    for name, shown in sorted(rows.items()):
        axes.scatter([x for x, _ in shown], [y for _, y in shown], s=6, label=name)
    _time_axis(axes)
    if rows and len(rows) <= _MOST_ROWS:
        axes.legend(fontsize=8)
    return bool(rows)


def _time_axis(axes: "Axes") -> None:
    axes.set_xlabel("s since the beginning")


def _since(facts: Facts, utc_ns: int) -> float:
    return (utc_ns - facts.began_ns) / 1e9
