"""Tables of a campaign: a row for each run, and one for each cell; CSV or Parquet."""

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any, Final

from zacoustic.app.tools.design.campaign.campaign import Campaign
from zacoustic.app.tools.design.campaign.cells import Cell, figure_names, parameters_of
from zacoustic.app.tools.design.campaign.running import Row

Table = Mapping[str, Sequence[Any]]
"""Columns by name, of equal length; None: no value."""

_ENDS: Final = ("mean", "low", "high", "count")


def table_of_runs(campaign: Campaign, rows: Sequence[Row]) -> Table:
    """Return the table of all runs, by cell and seed."""
    cells = [campaign.cell_of(row.run) for row in rows]
    parameters = [parameters_of(campaign, cell) for cell in cells]
    return {
        "cell": cells,
        "seed": [campaign.seed_of(row.run) for row in rows],
        **{each.name: [own[each.name] for own in parameters] for each in campaign.sweep},
        **{name: [row.figures.get(name) for row in rows] for name in figure_names(rows)},
        "digest": [row.digest for row in rows],
    }


def table_of_cells(campaign: Campaign, cells: Sequence[Cell]) -> Table:
    """Return the table of all cells: mean, ends of the interval and seeds of each figure."""
    names = dict.fromkeys(name for cell in cells for name in cell.figures)
    return {
        "cell": [cell.cell for cell in cells],
        **{each.name: [cell.parameters[each.name] for cell in cells] for each in campaign.sweep},
        **{
            name if end == "mean" else f"{name} {end}": [
                getattr(cell.figures.get(name), end, None) for cell in cells
            ]
            for name in names
            for end in _ENDS
        },
    }


def as_csv(table: Table) -> bytes:
    """Return a table as CSV, UTF-8; numbers with all their digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*table.values(), strict=True))
    return text.getvalue().encode()


def as_parquet(table: Table) -> bytes:
    """Return a table as Parquet. Needs pyarrow, the extra `campaign`."""
    import pyarrow as pa
    from pyarrow import parquet

    columns = {name: pa.array(_of_one_type(column)) for name, column in table.items()}
    written = io.BytesIO()
    parquet.write_table(pa.table(columns), written)
    return written.getvalue()


def _of_one_type(column: Sequence[Any]) -> Sequence[Any]:
    """Return a column as numbers, booleans or texts: a column of Parquet has one type."""
    types = {type(value) for value in column if value is not None}
    if types <= {int, float}:
        return column if types != {int, float} else [_real(value) for value in column]
    return column if len(types) <= 1 else [_text(value) for value in column]


def _real(value: float | None) -> float | None:
    return None if value is None else float(value)


def _text(value: object) -> str | None:
    return None if value is None else str(value)
