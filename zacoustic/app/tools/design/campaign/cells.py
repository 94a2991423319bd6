"""The cells of a campaign: each figure's mean over the seeds, with its confidence interval."""

from collections.abc import Mapping, Sequence

import msgspec

from zacoustic.app.tools.design.campaign.campaign import Campaign, Value
from zacoustic.app.tools.design.campaign.interval import Interval, interval_of
from zacoustic.app.tools.design.campaign.running import Row


class Cell(msgspec.Struct, frozen=True, kw_only=True):
    """One cell."""

    cell: int
    """Its number."""
    parameters: dict[str, Value]
    """Value of each parameter."""
    figures: dict[str, Interval]
    """Figures by name, without those that no seed has."""


def ordered(rows: Mapping[int, Row], campaign: Campaign) -> list[Row]:
    """Return rows by cell, then by seed: the order of every table."""
    return sorted(rows.values(), key=lambda row: (campaign.cell_of(row.run), row.run))


def figure_names(rows: Sequence[Row]) -> list[str]:
    """Return the names of all figures, in order of appearance."""
    return list(dict.fromkeys(name for row in rows for name in row.figures))


def cells_of(campaign: Campaign, rows: Sequence[Row], confidence: float) -> list[Cell]:
    """Summarise rows by cell.

    Args:
        campaign: The campaign.
        rows: All of its rows, in order.
        confidence: Confidence of the intervals, between 0 and 1.
    """
    names = figure_names(rows)
    by_cell: dict[int, list[Row]] = {}
    for row in rows:
        by_cell.setdefault(campaign.cell_of(row.run), []).append(row)
    cells = []
    for cell, own in by_cell.items():
        intervals = {name: _interval(own, name, confidence) for name in names}
        cells.append(
            Cell(
                cell=cell,
                parameters=parameters_of(campaign, cell),
                figures={name: each for name, each in intervals.items() if each is not None},
            )
        )
    return cells


def parameters_of(campaign: Campaign, cell: int) -> dict[str, Value]:
    """Return the value of each parameter in a cell."""
    cases = campaign.cases_of(cell)
    return {each.name: case.value for each, case in zip(campaign.sweep, cases, strict=True)}


def _interval(rows: Sequence[Row], name: str, confidence: float) -> Interval | None:
    figures = (row.figures.get(name) for row in rows)
    return interval_of([figure for figure in figures if figure is not None], confidence)
