"""The figures of a recording as tables: for a terminal, and for a page."""

from datetime import UTC, datetime
from typing import Final

from zacoustic.app.tools.columns import align
from zacoustic.app.tools.inspect.recordings.facts.facts import METRICS
from zacoustic.app.tools.inspect.recordings.report.figures import Figures
from zacoustic.app.tools.inspect.recordings.report.spread import Spread
from zacoustic.app.tools.pages.document import Sheet
from zacoustic.core.base.clock import NS_PER_S
from zacoustic.text.safetext import one_line

_QUALITIES: Final = {
    "snr_db": ("SNR", ", dB", 1),
    "received_level_db": ("level", ", dB", 1),
    "integrity": ("integrity", "", 0),
    "propagation_s": ("delay", ", s", 3),
    "range_m": ("range", ", m", 1),
    "range_rate_m_s": ("range rate", ", m/s", 2),
}
"""Name, unit and number of digits of each measured quantity."""


def head_of(figures: Figures) -> str:
    """Return one line on the recording and its length."""
    began = datetime.fromtimestamp(figures.began_utc_ns // NS_PER_S, UTC)
    nodes = ", ".join(str(node.node) for node in figures.nodes) or "none"
    return (
        f"{began:%Y-%m-%d %H:%M:%S} UTC, {figures.duration_s:.1f} s, nodes {nodes}, "
        f"channel in use {figures.utilisation:.1%}"
    )


def sheets_of(figures: Figures) -> list[Sheet]:
    """Return the tables."""
    sheets = (_streams(figures), _nodes(figures), _links(figures), _commands(figures))
    return [sheet for sheet in sheets if sheet.rows]


def as_text(figures: Figures) -> str:
    """Return everything as text."""
    parts = [*(one_line(line) for line in figures.verdict), one_line(head_of(figures))]
    for sheet in sheets_of(figures):
        right = sheet.header[sheet.left :]
        parts.append(f"\n{sheet.title}\n{align(sheet.header, sheet.rows, right=right)}")
    parts += [f"\n{one_line(note)}" for note in figures.notes]
    return "\n".join(parts)


def _streams(figures: Figures) -> Sheet:
    rows: list[tuple[str, ...]] = []
    for each in figures.streams:
        if not (each.published or each.arrived or each.refused):
            continue
        whole = f"{each.delivered}/{each.expected}" if each.expected else str(each.arrived)
        share = f"{each.delivered / each.expected:.1%}" if each.expected else ""
        ended = ", ".join(f"{number} {word}" for word, number in sorted(each.outcomes.items()))
        rows.append(
            (
                each.name,
                each.kind,
                str(each.published),
                str(each.thinned or ""),
                whole,
                share,
                str(each.failed),
                str(each.refused),
                *_seconds(each.latency_s),
                *_seconds(each.age_s)[:2],
                str(each.transmitted_bytes),
                f"{each.airtime_s:.1f}",
                ended,
            )
        )
    header = (
        "stream", "kind", "published", "left out",
        "arrived", "share", "failed", "refused", "50 %, s",
        "95 %, s", "worst, s", "age 50 %, s", "age 95 %, s", "bytes", "airtime, s", "ended as",
    )  # fmt: skip
    return Sheet("Streams: delivery and latency", header, rows, left=2)


def _commands(figures: Figures) -> Sheet:
    names = {each.stream_id: each.name for each in figures.streams}
    rows: list[tuple[str, ...]] = [
        (
            f"{datetime.fromtimestamp(each.at_ns // NS_PER_S, UTC):%H:%M:%S}",
            str(each.node),
            str(each.by),
            each.what,
            "" if each.stream_id is None else names.get(each.stream_id, str(each.stream_id)),
            f"{each.outcome}: {each.text}" if each.text else each.outcome,
        )
        for each in figures.handled
    ]
    header = ("UTC", "node", "by", "what", "stream", "outcome")
    return Sheet("Remote commands, and frames that did not open", header, rows, left=len(header))


def _nodes(figures: Figures) -> Sheet:
    rows: list[tuple[str, ...]] = []
    for each in figures.nodes:
        exact = {True: "exact", False: "DIFFERS", None: ""}[each.ledger_is_exact]
        outcomes = ", ".join(f"{number} {word}" for word, number in sorted(each.outcomes.items()))
        rows.append(
            (
                str(each.node),
                str(each.epochs),
                str(each.frames),
                str(each.frame_bytes),
                "" if each.ledger_bytes is None else str(each.ledger_bytes),
                exact,
                f"{each.airtime_s:.1f}",
                f"{each.utilisation:.2%}",
                outcomes,
            )
        )
    header = (
        "node", "epochs", "frames", "bytes", "ledger", "sum", "airtime, s", "use", "transmissions",
    )  # fmt: skip
    return Sheet("Nodes: airtime", header, rows)


def _links(figures: Figures) -> Sheet:
    known = [name for name in METRICS if any(getattr(link, name) for link in figures.links)]
    rows = [
        (
            f"{each.source} to {each.node}",
            "" if each.sent is None else str(each.sent),
            str(each.heard),
            "" if each.loss is None else f"{each.loss:.1%}",
            *(text for name in known for text in _quality(name, getattr(each, name))),
        )
        for each in figures.links
    ]
    titles = [_QUALITIES[name] for name in known]
    named = (title for what, unit, _ in titles for title in (f"{what} 50 %{unit}", "from, to"))
    return Sheet("Links: frames and quality", ("link", "sent", "heard", "lost", *named), rows)


def _quality(name: str, spread: Spread | None) -> tuple[str, str]:
    if spread is None:
        return "", ""
    digits = _QUALITIES[name][2]
    return (
        f"{spread.p50:.{digits}f}",
        f"{spread.least:.{digits}f} … {spread.greatest:.{digits}f}",
    )


def _seconds(spread: Spread | None) -> tuple[str, str, str]:
    if spread is None:
        return "", "", ""
    return f"{spread.p50:.2f}", f"{spread.p95:.2f}", f"{spread.greatest:.2f}"
