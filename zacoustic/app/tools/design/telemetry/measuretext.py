"""The report of `zacoustic.app.tools.design.telemetry.measuring` for people."""

from collections.abc import Iterator

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.design.telemetry.measuring import (
    LOSSES,
    RECORDS,
    BenchReport,
    DenseBytes,
    Row,
)

_RECORDS = tuple(name.replace("_", " ") for name in RECORDS)
_REFERRING = tuple(f"{loss:.0%}" for loss in LOSSES)
_HEADER = ("id", "name", "frames", *_RECORDS, "dense", *_REFERRING)


def as_text(report: BenchReport) -> str:
    """Return the report as lines."""
    return "\n".join(_paragraphs(report))


def _paragraphs(report: BenchReport) -> Iterator[str]:
    yield "bytes of a frame, mean: each sample alone, and everything of a time together"
    yield align(_HEADER, list(_rows(report)), right=_HEADER[2:])
    yield (
        "dense: each frame stands for itself; then with references to acknowledged frames, of "
        "frames and acknowledgements so many lost"
    )
    yield f"decoded: {report.decoded} frames; different from what was sent: {report.different}"
    if report.notes:
        yield ""
        yield from (f"note: {note}" for note in report.notes)


def _rows(report: BenchReport) -> Iterator[tuple[str, ...]]:
    everything = f"everything of {report.window_s:g} s"
    for row in (*report.streams, report.window):
        yield _cells(row, row.name if row.stream_id else everything)
        if row.dense_fitted is not None:
            blanks = ("",) * len(RECORDS)
            yield ("", "  with the model", "", *blanks, *_dense_cells(row.dense_fitted))


def _cells(row: Row, name: str) -> tuple[str, ...]:
    stream_id = str(row.stream_id) if row.stream_id else ""
    records = [f"{row.records[each]:.1f}" for each in RECORDS]
    return (stream_id, name, str(row.frames), *records, *_dense_cells(row.dense))


def _dense_cells(dense: DenseBytes) -> tuple[str, ...]:
    return tuple(f"{each:.1f}" for each in (dense.alone, *dense.acknowledged.values()))
