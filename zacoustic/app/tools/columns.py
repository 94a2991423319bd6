"""Text in columns, for a terminal or a log: no frames, no colours, no width limit."""

from collections.abc import Sequence

from zacoustic.text.safetext import one_line


def align(
    header: Sequence[str], rows: Sequence[Sequence[str]], *, right: Sequence[str] = ()
) -> str:
    """Format a table in columns of the least width.

    Args:
        header: Name of each column.
        rows: As many cells each as the header; made safe to show in one line.
        right: Names of the right-aligned columns, such as numbers.

    Returns:
        Lines without trailing blanks, joined by line ends; the header is the first.
    """
    lines = [header, *([one_line(cell) for cell in row] for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    return "\n".join(_line(header, line, widths, right) for line in lines)


def _line(
    header: Sequence[str], cells: Sequence[str], widths: Sequence[int], right: Sequence[str]
) -> str:
    aligned = (
        cell.rjust(width) if name in right else cell.ljust(width)
        for name, cell, width in zip(header, cells, widths, strict=True)
    )
    return "  ".join(aligned).rstrip()


def shortened(text: str, letters: int) -> str:
    """Return a text of so many letters at most; of a longer key the end is what tells it apart."""
    return text if len(text) <= letters else f"…{text[1 - letters :]}"
