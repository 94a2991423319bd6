"""The plots of a campaign: each figure over one parameter, a line for each value of another."""

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

from zacoustic.app.tools.design.campaign.campaign import Campaign, Parameter, Value
from zacoustic.app.tools.design.campaign.cells import Cell
from zacoustic.app.tools.pages.plots import Plot, draw, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_PLOTS: Final = 24
"""Most plots of a page; more make it slow, and the tables have everything."""
_MOST_LINES: Final = 12
"""Most drawn values of one parameter, always with the first and the last."""


def plots_of(campaign: Campaign, cells: Sequence[Cell], names: Sequence[str]) -> list[Plot]:
    """Draw figures with their intervals; at most `MOST_PLOTS`.

    Args:
        campaign: The campaign.
        cells: Its cells.
        names: The figures.
    """
    across, beside, fixed = _roles(campaign.sweep)
    groups: dict[str, list[Cell]] = {}
    for cell in cells:
        where = ", ".join(f"{each.name} = {cell.parameters[each.name]}" for each in fixed)
        groups.setdefault(where, []).append(cell)
    plots: list[Plot] = []
    for name in names:
        for where, own in groups.items():
            if len(plots) >= MOST_PLOTS:
                return plots
            title = f"{name}, {where}" if where else name
            fill = partial(_lines, cells=own, name=name, across=across, beside=beside)
            plot = draw(title, fill)
            if plot is not None:
                plots.append(plot)
    return plots


def plots_wanted(campaign: Campaign, names: Sequence[str]) -> int:
    """Return the number of plots without a limit."""
    _, _, fixed = _roles(campaign.sweep)
    return len(names) * math.prod(len(each.cases) for each in fixed)


def _roles(sweep: Sequence[Parameter]) -> tuple[Parameter, Parameter | None, list[Parameter]]:
    """Return the parameter of the x axis, that of the lines, and those constant in one plot."""
    across = max(sweep, key=lambda each: (_is_numeric(each), len(each.cases)))
    others = [each for each in sweep if each is not across]
    beside = max(others, key=lambda each: len(each.cases), default=None)
    return across, beside, [each for each in others if each is not beside]


def _spread(values: Sequence[Value]) -> list[Value]:
    """Return the values to draw, spread evenly."""
    if len(values) <= _MOST_LINES:
        return list(values)
    last = len(values) - 1
    return [values[index * last // (_MOST_LINES - 1)] for index in range(_MOST_LINES)]


def _is_numeric(parameter: Parameter) -> bool:
    values = [case.value for case in parameter.cases]
    return len(values) > 1 and all(
        isinstance(value, int | float) and not isinstance(value, bool) for value in values
    )


def _lines(
    axes: "Axes", cells: Sequence[Cell], name: str, across: Parameter, beside: Parameter | None
) -> bool:
    values = [case.value for case in across.cases]
    is_numeric = _is_numeric(across)
    lines: dict[str, list[Cell]] = {}
    drawn = None if beside is None else _spread([case.value for case in beside.cases])
    for cell in cells:
        is_drawn = beside is None or drawn is None or cell.parameters[beside.name] in drawn
        if is_drawn and name in cell.figures:
            which = (
                "" if beside is None else label(f"{beside.name} = {cell.parameters[beside.name]}")
            )
            lines.setdefault(which, []).append(cell)
    for which, own in lines.items():
        own.sort(key=lambda cell: values.index(cell.parameters[across.name]))
        places = [values.index(cell.parameters[across.name]) for cell in own]
        xs = [float(values[place]) for place in places] if is_numeric else places
        order = sorted(range(len(xs)), key=xs.__getitem__)
        intervals = [own[at].figures[name] for at in order]
        means = [each.mean for each in intervals]
        halves = [0.0 if each.high is None else each.high - each.mean for each in intervals]
        axes.errorbar(
            [xs[at] for at in order], means, yerr=halves, marker=".", linewidth=1, capsize=2,
            label=which or None,
        )  # fmt: skip
    if not is_numeric:
        axes.set_xticks(range(len(values)), [label(str(value)) for value in values])
    axes.set_xlabel(label(across.name))
    if lines and beside is not None:
        axes.legend(fontsize=8)
    return bool(lines)
