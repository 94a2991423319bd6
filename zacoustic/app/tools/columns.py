"""Text in columns, for a terminal or a log: no frames, no colours.

A log has a row in one line, however long. On a terminal a broken row cannot be read, so there a
table that is too wide has its further columns below, each part with the first column.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final

from zacoustic.text.safetext import one_line

_GAP: Final = "  "
_limit: ContextVar[int | None] = ContextVar("limit", default=None)


@contextmanager
def within(columns: int | None) -> Iterator[None]:
    """Keep tables to a width; None: there is no limit."""
    token = _limit.set(columns)
    try:
        yield
    finally:
        _limit.reset(token)


def align(
    header: Sequence[str], rows: Sequence[Sequence[str]], *, right: Sequence[str] = ()
) -> str:
    """Format a table in columns of the least width.

    Args:
        header: Name of each column.
        rows: As many cells each as the header; made safe to show in one line.
        right: Names of the right-aligned columns, such as numbers.

    Returns:
        Lines without trailing blanks, joined by line ends; the header is the first. `within` a
        width, a table that is wider is several, with an empty line between them.
    """
    lines = [header, *([one_line(cell) for cell in row] for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    return "\n\n".join(
        "\n".join(_line(header, line, widths, right, part) for line in lines)
        for part in _parts(widths, _limit.get())
    )


def _parts(widths: Sequence[int], limit: int | None) -> list[list[int]]:
    """Return the columns of each part of a table; all parts have the first one."""
    parts = [[0]] if widths else [[]]
    for column in range(1, len(widths)):
        taken = sum(widths[each] + len(_GAP) for each in parts[-1])
        if limit is not None and taken + widths[column] > limit and len(parts[-1]) > 1:
            parts.append([0])
        parts[-1].append(column)
    return parts


def _line(
    header: Sequence[str],
    cells: Sequence[str],
    widths: Sequence[int],
    right: Sequence[str],
    columns: Sequence[int],
) -> str:
    aligned = (
        cells[each].rjust(widths[each])
        if header[each] in right
        else cells[each].ljust(widths[each])
        for each in columns
    )
    return _GAP.join(aligned).rstrip()


def shortened(text: str, letters: int) -> str:
    """Return a text of so many letters at most; of a longer key the end is what tells it apart."""
    return text if len(text) <= letters else f"…{text[1 - letters :]}"


def shortened_apart(texts: Sequence[str], letters: int) -> list[str]:
    """Return texts as `shortened` does, but different ones stay different.

    Of those that end alike so many first letters are kept, before the end, as tell them apart; if
    no such form has room, the whole text is returned.
    """
    found = [shortened(each, letters) for each in texts]
    for kept in range(1, letters - 1):
        alike = _alike(texts, found)
        if not alike:
            return found
        for index in alike:
            text = texts[index]
            found[index] = f"{text[:kept]}…{text[len(text) - letters + kept + 1 :]}"
    for index in _alike(texts, found):
        found[index] = texts[index]
    return found


def _alike(texts: Sequence[str], found: Sequence[str]) -> list[int]:
    """Return the places of forms that stand for different texts."""
    meant: dict[str, set[str]] = {}
    for text, form in zip(texts, found, strict=True):
        meant.setdefault(form, set()).add(text)
    return [index for index, form in enumerate(found) if len(meant[form]) > 1]
