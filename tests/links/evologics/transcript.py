r"""Transcripts under golden/evologics: what is said on a port, and which records that is.

A line begins with:

- `#` a remark; `@ lines` or `@ packets`: how the bytes are divided from here on. With two words the
  first is how the driver reads the modem, the second how the modem reads the driver;
- `>` what the host says, `<` what the modem says; CR, LF and other bytes are escaped as in Python.
  The line end belongs to it: LF of the host, CR LF of the modem. With `>.` and `<.` there is none;
- `~` before one of these: our encoder does not write it so;
- `=` the records that the line before is, one in each, as an expression.
"""

import enum
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic_evologics.at import commands, messages, notifications, usbl
from zacoustic_evologics.at.framing import CRLF, TCP_LINE_END, Framing

FOLDER: Final = Path(__file__).parents[2] / "golden" / "evologics"
TRANSCRIPTS: Final = sorted(FOLDER.glob("*.txt"))
RECORDS: Final = {
    name: value
    for module in (commands, messages, notifications, usbl)
    for name, value in vars(module).items()
    if isinstance(value, type)
}


class Said(msgspec.Struct, frozen=True):
    """One line of a transcript."""

    by_host: bool
    framing: Framing
    content: bytes
    canonical: bool
    """Our encoder writes it like this."""
    records: tuple[Any, ...]


def read_transcript(path: Path) -> list[Said]:
    said: list[Said] = []
    framings = Framing.LINES, Framing.LINES
    for line in path.read_text(encoding="ascii").splitlines():
        mark, _, text = line.partition(" ")
        match mark[:1]:
            case "@":
                read, _, written = text.partition(" ")
                framings = Framing(read), Framing(written or read)
            case ">" | "<" | "~":
                said.append(_said(mark, text, framings[">" in mark]))
            case "=":
                record = eval(text, dict(RECORDS))
                said[-1] = msgspec.structs.replace(said[-1], records=(*said[-1].records, record))
            case _:
                assert not line or line.startswith("#"), line
    return said


def _said(mark: str, text: str, framing: Framing) -> Said:
    by_host = ">" in mark
    line_end = b"" if mark.endswith(".") else TCP_LINE_END if by_host else CRLF
    content = text.encode("ascii").decode("unicode_escape").encode("latin-1") + line_end
    return Said(by_host, framing, content, mark[0] != "~", ())


def expression(record: Any) -> str:
    """Write a record as a transcript does: defaults left out, members of enumerations by name."""
    if isinstance(record, enum.Enum):
        return f"{type(record).__name__}.{record.name}"
    if not isinstance(record, msgspec.Struct):
        return repr(record)
    fields = [
        f"{field.name}={expression(getattr(record, field.name))}"
        for field in msgspec.structs.fields(record)
        if field.required or getattr(record, field.name) != field.default
    ]
    return f"{type(record).__name__}({', '.join(fields)})"
