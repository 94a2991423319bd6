"""A report as one page: tables and plots in one self-contained HTML file."""

from collections.abc import Sequence

from zacoustic.app.tools.inspect.recordings.report.figures import Figures
from zacoustic.app.tools.inspect.recordings.report.reporttext import head_of, sheets_of
from zacoustic.app.tools.pages.document import as_document
from zacoustic.app.tools.pages.plots import Plot


def as_page(figures: Figures, plots: Sequence[Plot], *, title: str) -> str:
    """Return the page.

    Args:
        figures: Its contents.
        plots: Its plots.
        title: Its title.
    """
    return as_document(
        title,
        verdict=figures.verdict,
        head=head_of(figures),
        notes=figures.notes,
        sheets=sheets_of(figures),
        plots=plots,
    )
