"""Cells of a campaign as tables: for a terminal, and for a page."""

from collections.abc import Sequence
from typing import Final

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.design.campaign.campaign import Campaign
from zacoustic.app.tools.design.campaign.cells import Cell
from zacoustic.app.tools.design.campaign.interval import Interval
from zacoustic.app.tools.pages.document import Sheet

_MOST_ROWS: Final = 60
_MOST_DIGITS: Final = 6


def sheet_of(campaign: Campaign, cells: Sequence[Cell], names: Sequence[str]) -> Sheet:
    """Return the table of all cells with some of their figures."""
    rows: list[tuple[str, ...]] = [
        (
            *(str(cell.parameters[each.name]) for each in campaign.sweep),
            *(_written(cell.figures.get(name)) for name in names),
        )
        for cell in cells
    ]
    header = (*(each.name for each in campaign.sweep), *names)
    return Sheet("Cells", header, rows, left=len(campaign.sweep))


def table_text(sheet: Sheet, *, where: str) -> str:
    """Return a table as lines.

    Args:
        sheet: The table.
        where: Place of the rest, if the table is long.
    """
    shown = sheet.rows[:_MOST_ROWS]
    text = align(sheet.header, shown, right=sheet.header[sheet.left :])
    more = len(sheet.rows) - len(shown)
    return f"{text}\n… and {more} more cells: {where}" if more else text


def _written(interval: Interval | None) -> str:
    """Return a mean with half its interval, with as many digits as that justifies."""
    if interval is None:
        return ""
    if interval.high is None:
        return f"{interval.mean:.4g}"
    half = interval.high - interval.mean
    digits = 0
    while digits < _MOST_DIGITS and half * 10**digits < 10 and half > 0:
        digits += 1
    if half == 0:
        return f"{interval.mean:.4g} ± 0"
    return f"{interval.mean:.{digits}f} ± {half:.{digits}f}"
