"""The tables as text for a terminal, and as the page docs/reference.md."""

import textwrap
from collections.abc import Iterator, Sequence
from typing import Final

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.design.reference.tables import SECTION, KeyRow, KeyTable

COLUMNS: Final = 100
_WIDTH: Final = 96
_HEAD: Final = f"""\
# Every key of the configuration

`zacoustic config schema --markdown` writes this page from the records that read a file.
`zacoustic config schema TABLE` prints one table on a terminal, and
`zacoustic config schema --json` prints a JSON Schema for editors.
[config.md](config.md) explains the keys with examples.

All keys stand below `{SECTION}`. A key that is not listed is an error.
"""


def as_text(table: KeyTable) -> str:
    """Return one table for a terminal."""
    lines = [f"{table.name}: {table.meaning}", ""]
    for row in table.rows:
        lines.append(f"{row.key}  ({row.type}; {_default(row)})")
        lines.extend(_indented(row.meaning))
        if row.allowed:
            lines.extend(_indented(f"allowed: {row.allowed}"))
    return "\n".join(lines)


def list_of_tables(known: Sequence[KeyTable]) -> str:
    """Return the names of the tables with their meanings."""
    return align(("TABLE", "WHAT IT IS"), [(table.name, table.meaning) for table in known])


def as_markdown(known: Sequence[KeyTable]) -> str:
    """Return the page."""
    return "\n".join([_HEAD, *(line for table in known for line in _section(table))])


def _section(table: KeyTable) -> Iterator[str]:
    yield f"## `{table.name}`"
    yield ""
    yield table.meaning
    yield ""
    if not table.rows:
        yield "It has no keys."
    for row in table.rows:
        yield from _item(row)
    yield ""


def _item(row: KeyRow) -> list[str]:
    default = _code(row.default) if row.default else ""
    state = "*required*" if row.default is None else f"default {default}" if default else "optional"
    allowed = f" Allowed: {row.allowed}." if row.allowed else ""
    text = f"- `{row.key}` ({row.type}, {state}): {_marked(row.meaning)}{allowed}"
    return textwrap.wrap(
        text, COLUMNS, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )


def _default(row: KeyRow) -> str:
    if row.default is None:
        return "required"
    return f"default: {row.default}" if row.default else "optional"


def _indented(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="    ", subsequent_indent="    ")


def _code(text: str) -> str:
    return f"`{text}`" if text else ""


def _marked(text: str) -> str:
    """Convert code marks: docstrings have two backquotes, the page has one."""
    return text.replace("``", "`")
