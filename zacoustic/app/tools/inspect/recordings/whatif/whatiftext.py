"""The result of a what-if run, as text for people."""

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.inspect.recordings.report.figures import Figures, StreamFigures
from zacoustic.app.tools.inspect.recordings.report.spread import Spread
from zacoustic.app.tools.inspect.recordings.whatif.whatif import WhatIf

_HEADER = (
    "stream", "arrived", "again", "what if", "50 %, s", "again", "what if", "95 %, s", "again",
    "what if", "bytes", "again", "what if",
)  # fmt: skip


def as_text(found: WhatIf) -> str:
    """Return one table of all streams, and one line about the channel."""
    columns = (found.recorded, found.again, found.changed)
    by_name = [{each.name: each for each in figures.streams} for figures in columns]
    rows = []
    for name in by_name[0]:
        three = [streams.get(name) for streams in by_name]
        if any(each is not None and (each.published or each.arrived) for each in three):
            rows.append(
                (
                    name,
                    *(_share(each) for each in three),
                    *(_seconds(each, "p50") for each in three),
                    *(_seconds(each, "p95") for each in three),
                    *("" if each is None else str(each.transmitted_bytes) for each in three),
                )
            )
    lines = [align(_HEADER, rows, right=_HEADER[1:])]
    airtimes = [_airtime_s(figures) for figures in columns]
    duration_s = found.recorded.duration_s or 1.0
    lines.append(
        "airtime: "
        + ", ".join(
            f"{word} {airtime_s:.1f} s ({airtime_s / duration_s:.1%})"
            for word, airtime_s in zip(("recorded", "again", "what if"), airtimes, strict=True)
        )
    )
    if found.losses:
        told = ", ".join(f"{link} {share:.1%}" for link, share in found.losses.items())
        lines.append(f"frames that nothing overlapped and that were lost all the same: {told}")
    if found.not_taken:
        lines.append(f"{found.not_taken} samples, calls and commands were not taken")
    return "\n".join([*lines, *found.notes])


def _share(stream: StreamFigures | None) -> str:
    if stream is None:
        return ""
    if not stream.expected:
        return str(stream.arrived)
    return f"{stream.delivered}/{stream.expected}"


def _seconds(stream: StreamFigures | None, name: str) -> str:
    spread: Spread | None = None if stream is None else stream.latency_s
    return "" if spread is None else f"{getattr(spread, name):.2f}"


def _airtime_s(figures: Figures) -> float:
    return sum(node.airtime_s for node in figures.nodes)
