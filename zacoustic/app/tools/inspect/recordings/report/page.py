"""A report as one page: tables and plots in one HTML file that needs nothing from elsewhere."""

from collections.abc import Sequence

from zacoustic.app.tools.inspect.recordings.report.figures import Figures
from zacoustic.app.tools.inspect.recordings.report.reporttext import head_of, sheets_of
from zacoustic.app.tools.pages.document import as_document
from zacoustic.app.tools.pages.plots import Plot


def as_page(figures: Figures, plots: Sequence[Plot], *, title: str) -> str:
    """Return the page.

    Args:
        figures: Its contents.
        plots: What it shows.
        title: What it is of.
    """
    return as_document(
        title,
        verdict=figures.verdict,
        head=head_of(figures),
        notes=figures.notes,
        sheets=sheets_of(figures),
        plots=plots,
    )
