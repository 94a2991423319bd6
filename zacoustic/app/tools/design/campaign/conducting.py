"""A campaign from its file to its results: tables and a page, in one folder with its rows."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.app.tools.design.campaign.campaign import Campaign, campaign_of
from zacoustic.app.tools.design.campaign.carrying import carry_out
from zacoustic.app.tools.design.campaign.cells import Cell, cells_of, ordered
from zacoustic.app.tools.design.campaign.cluster import connected
from zacoustic.app.tools.design.campaign.plots import MOST_PLOTS, plots_of, plots_wanted
from zacoustic.app.tools.design.campaign.rows import RowFile
from zacoustic.app.tools.design.campaign.running import OVERALL, PER_STREAM, Row, version
from zacoustic.app.tools.design.campaign.spec import CampaignSpec, read_spec
from zacoustic.app.tools.design.campaign.tables import (
    as_csv,
    as_parquet,
    table_of_cells,
    table_of_runs,
)
from zacoustic.app.tools.design.campaign.text import sheet_of, table_text
from zacoustic.app.tools.pages.document import as_document
from zacoustic.app.tools.pages.plots import need_matplotlib
from zacoustic.errors import ConfigError

PAGE: Final = "page.html"


class CampaignResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a campaign."""

    folder: str
    """Folder of rows, tables and page."""
    runs: int
    """Number of runs."""
    ran: int
    """Number of runs done by this start."""
    confidence: float
    """Confidence of the intervals."""
    cells: list[Cell]
    """Every cell with every figure."""


class CampaignOptions(msgspec.Struct, frozen=True, kw_only=True):
    """How to execute a campaign; no figure depends on it."""

    scheduler: str | None = None
    """Address of a scheduler; None: workers are started here."""
    workers: int | None = None
    """Number of workers to start; None: one for each processor."""
    patience_s: float = 30.0
    """Longest absence of scheduler and workers, s."""
    parquet: bool = False
    """Write Parquet instead of CSV."""


def run_campaign(
    path: Path, folder: Path, options: CampaignOptions, *, progress: Callable[[int, int], None]
) -> tuple[CampaignResult, str]:
    """Do the missing runs of a campaign, and write its results.

    Args:
        path: Its file.
        folder: Folder of the results.
        options: How to execute it.
        progress: Called with the number of finished runs and the number of all.

    Returns:
        The result, and the table of its cells for people.

    Raises:
        ConfigError: A file is wrong, or the folder has other contents.
        CampaignError: A run or the scheduler has failed.
        TimeoutError: There is no scheduler, or no worker.
    """
    need_matplotlib("campaign")
    if options.parquet:
        import pyarrow  # noqa: F401 (fails before hours of work)
    spec = read_spec(path)
    campaign = campaign_of(spec, path, version())
    campaign.check()
    _check_figures(spec, campaign, path)
    with RowFile(folder, campaign) as file:
        before = len(file.rows)
        progress(before, campaign.runs)
        if before < campaign.runs:

            def take(rows: Sequence[Row]) -> None:
                file.append(rows)
                progress(len(file.rows), campaign.runs)

            with connected(
                options.scheduler, workers=options.workers, patience_s=options.patience_s
            ) as client:
                carry_out(
                    client, campaign, file.rows.values(), take=take, patience_s=options.patience_s
                )
        rows = ordered(file.rows, campaign)
        cells = cells_of(campaign, rows, spec.confidence)
        text = _write(folder, path, spec, campaign, rows, cells, parquet=options.parquet)
    result = CampaignResult(
        folder=str(folder),
        runs=campaign.runs,
        ran=campaign.runs - before,
        confidence=spec.confidence,
        cells=cells,
    )
    return result, text


def _check_figures(spec: CampaignSpec, campaign: Campaign, path: Path) -> None:
    """Check that runs have the chosen figures.

    Raises:
        ConfigError: Names one that they lack.
    """
    taken = {"cell", "seed", "digest", *OVERALL}
    for parameter in campaign.sweep:
        if parameter.name in taken:
            raise ConfigError(
                f'{path}: sweep has the name "{parameter.name}"; allowed: none of the columns '
                f"{', '.join(sorted(taken))}",
                hint='give another name: name: "…"',
            )
    for index, name in enumerate(spec.figures):
        stream, colon, figure = name.rpartition(": ")
        if name not in OVERALL and not (colon and stream and figure in PER_STREAM):
            raise ConfigError(
                f'{path}: figures[{index}] is "{name}"; allowed: {", ".join(OVERALL)}; '
                f'or "STREAM: FIGURE" with {", ".join(PER_STREAM)}'
            )


def _write(
    folder: Path,
    path: Path,
    spec: CampaignSpec,
    campaign: Campaign,
    rows: Sequence[Row],
    cells: Sequence[Cell],
    *,
    parquet: bool,
) -> str:
    """Write tables and page; return the table of the cells for people."""
    written, ending = (as_parquet, "parquet") if parquet else (as_csv, "csv")
    _replace(folder / f"runs.{ending}", written(table_of_runs(campaign, rows)))
    _replace(folder / f"cells.{ending}", written(table_of_cells(campaign, cells)))
    sheet = sheet_of(campaign, cells, spec.figures)
    wanted = plots_wanted(campaign, spec.figures)
    note = f"{MOST_PLOTS} of {wanted} plots are drawn: cells.{ending} has all figures"
    page = as_document(
        path.name,
        head=(
            f"{campaign.runs} runs of {campaign.until_s:g} s: {campaign.cells} cells, "
            f"{len(campaign.seeds)} seeds; mean ± {spec.confidence:.1%} interval (Student's t)"
        ),
        notes=[note] if wanted > MOST_PLOTS else [],
        sheets=[sheet],
        plots=plots_of(campaign, cells, spec.figures),
    )
    _replace(folder / PAGE, page.encode())
    return table_text(sheet, where=str(folder / f"cells.{ending}"))


def _replace(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    beside = path.with_name(f".{path.name}.new")
    with beside.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)
