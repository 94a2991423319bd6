"""A document: tables and plots in one self-contained HTML file."""

from collections.abc import Sequence
from typing import Final

import msgspec

from zacoustic.app.tools.pages.plots import Plot
from zacoustic.text.safetext import html_text

_STYLE: Final = """
body { font: 14px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 75em; padding: 0 1em; }
h1 { font-size: 1.4em; } h2 { font-size: 1.1em; margin-top: 1.6em; }
table { border-collapse: collapse; } .wide { overflow-x: auto; }
th, td { padding: .2em .7em; text-align: right; white-space: nowrap;
  border-bottom: 1px solid #8884; }
th.l, td.l { text-align: left; } td.bad { color: #b00; font-weight: bold; }
svg { max-width: 100%; height: auto; } .note { color: #b00; }
.verdict { font-weight: bold; margin: .2em 0; }
@media (prefers-color-scheme: dark) { body { background: #111; color: #ddd; }
  td.bad, .note { color: #ff6b6b; } }
"""


class Sheet(msgspec.Struct, frozen=True):
    """One table."""

    title: str
    """Its title."""
    header: tuple[str, ...]
    """Name of each column."""
    rows: list[tuple[str, ...]]
    """Rows with as many cells each."""
    left: int = 1
    """Number of left-aligned columns; the others are numbers."""


def as_document(
    title: str,
    *,
    verdict: Sequence[str] = (),
    head: str = "",
    notes: Sequence[str] = (),
    sheets: Sequence[Sheet] = (),
    plots: Sequence[Plot] = (),
) -> str:
    """Return the document; no text can become a tag.

    Args:
        title: Its title.
        verdict: Conclusions, one line each.
        head: Its sources.
        notes: Remarks.
        sheets: Its tables.
        plots: Its plots.
    """
    name = html_text(title)
    parts = [
        "<!DOCTYPE html>",
        '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{name}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{name}</h1>",
        *(f'<p class="verdict">{html_text(line)}</p>' for line in verdict),
        f"<p>{html_text(head)}</p>",
        *(f'<p class="note">{html_text(note)}</p>' for note in notes),
        *(_table(sheet) for sheet in sheets),
        *(f"<h2>{html_text(plot.title)}</h2>{plot.svg}" for plot in plots),
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def _table(sheet: Sheet) -> str:
    head = "".join(_cell("th", cell, at, sheet) for at, cell in enumerate(sheet.header))
    rows = "".join(
        f"<tr>{''.join(_cell('td', cell, at, sheet) for at, cell in enumerate(row))}</tr>\n"
        for row in sheet.rows
    )
    return (
        f'<h2>{html_text(sheet.title)}</h2><div class="wide" tabindex="0"><table>'
        f"<thead><tr>{head}</tr></thead><tbody>\n{rows}</tbody></table></div>"
    )


def _cell(tag: str, text: str, at: int, sheet: Sheet) -> str:
    kind = ' class="l"' if at < sheet.left else ""
    kind = ' class="bad"' if text == "DIFFERS" else kind
    return f"<{tag}{kind}>{html_text(text)}</{tag}>"
