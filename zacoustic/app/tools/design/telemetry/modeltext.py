"""The report of `zacoustic.app.tools.design.telemetry.modelling` for people."""

from collections.abc import Iterator

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.design.telemetry.modelling import Cost, FitReport, StreamFit

_HEADER = ("id", "name", "samples", "packed", "first", "fitted", "gain", "next", "fitted ", "gain ")


def as_text(report: FitReport) -> str:
    """Return the report as lines."""
    return "\n".join(_paragraphs(report))


def _paragraphs(report: FitReport) -> Iterator[str]:
    yield "fitted to the first half of each recording, measured on the second; bits a sample"
    yield align(_HEADER, [_cells(row) for row in report.streams], right=_HEADER[2:])
    yield "first: of which nothing is known yet; next: behind the one before it"
    yield ""
    for what, cost in (
        ("standing for themselves", report.alone_bytes),
        ("with acknowledged references", report.acknowledged_bytes),
    ):
        yield (
            f"frames of {report.window_s:g} s, {what}: {cost.before:.1f} bytes, "
            f"fitted {cost.after:.1f} ({_percent(cost)})"
        )
    if report.notes:
        yield ""
        yield from (f"note: {note}" for note in report.notes)


def _cells(row: StreamFit) -> tuple[str, ...]:
    return (
        str(row.stream_id),
        row.name,
        str(row.samples),
        f"{row.packed_bits:.0f}",
        *_cost_cells(row.first_bits),
        *_cost_cells(row.next_bits),
    )


def _cost_cells(cost: Cost) -> tuple[str, str, str]:
    return f"{cost.before:.1f}", f"{cost.after:.1f}", _percent(cost)


def _percent(cost: Cost) -> str:
    return f"{-100 * cost.gain:+.0f} %"
