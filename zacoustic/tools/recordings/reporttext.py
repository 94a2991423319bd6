"""The figures of a recording as tables: for a terminal, and for a page."""

from datetime import UTC, datetime

import msgspec

from zacoustic.core.clock import NS_PER_S
from zacoustic.tools.columns import align
from zacoustic.tools.recordings.figures import Figures, Spread


class Sheet(msgspec.Struct, frozen=True):
    """One table."""

    title: str
    """What it shows."""
    header: tuple[str, ...]
    """Name of each column."""
    rows: list[tuple[str, ...]]
    """As many cells each."""
    left: int = 1
    """So many columns are set flush left; the others are numbers."""


def head_of(figures: Figures) -> str:
    """Return what and how long was recorded, one line."""
    began = datetime.fromtimestamp(figures.began_utc_ns // NS_PER_S, UTC)
    nodes = ", ".join(str(node.node) for node in figures.nodes) or "none"
    return (
        f"{began:%Y-%m-%d %H:%M:%S} UTC, {figures.duration_s:.1f} s, nodes {nodes}, "
        f"channel in use {figures.utilisation:.1%}"
    )


def sheets_of(figures: Figures) -> list[Sheet]:
    """Return the tables."""
    return [sheet for sheet in (_streams(figures), _nodes(figures), _links(figures)) if sheet.rows]


def as_text(figures: Figures) -> str:
    """Return everything as text."""
    parts = [head_of(figures)]
    for sheet in sheets_of(figures):
        right = sheet.header[sheet.left :]
        parts.append(f"\n{sheet.title}\n{align(sheet.header, sheet.rows, right=right)}")
    parts += [f"\n{note}" for note in figures.notes]
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
        "stream", "kind", "published", "arrived", "share", "failed", "refused", "50 %, s",
        "95 %, s", "worst, s", "age 50 %, s", "age 95 %, s", "bytes", "airtime, s", "ended as",
    )  # fmt: skip
    return Sheet("Streams: delivery and latency", header, rows, left=2)


def _nodes(figures: Figures) -> Sheet:
    rows: list[tuple[str, ...]] = []
    for each in figures.nodes:
        exact = {True: "exact", False: "DIFFERS", None: ""}[each.ledger_is_exact]
        outcomes = ", ".join(f"{number} {word}" for word, number in sorted(each.outcomes.items()))
        rows.append(
            (
                str(each.node),
                str(each.lives),
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
        "node", "lives", "frames", "bytes", "ledger", "sum", "airtime, s", "use", "transmissions",
    )  # fmt: skip
    return Sheet("Nodes: airtime", header, rows)


def _links(figures: Figures) -> Sheet:
    rows: list[tuple[str, ...]] = []
    for each in figures.links:
        snr, delay = each.snr_db, each.propagation_s
        rows.append(
            (
                f"{each.source} to {each.node}",
                "" if each.sent is None else str(each.sent),
                str(each.heard),
                "" if each.loss is None else f"{each.loss:.1%}",
                "" if snr is None else f"{snr.p50:.1f}",
                "" if snr is None else f"{snr.least:.1f}",
                "" if delay is None else f"{delay.p50:.3f}",
                "" if delay is None else f"{delay.least:.3f}–{delay.greatest:.3f}",
            )
        )
    header = (
        "link", "sent", "heard", "lost", "SNR 50 %, dB", "least, dB", "delay 50 %, s", "range, s",
    )  # fmt: skip
    return Sheet("Links: frames and quality", header, rows)


def _seconds(spread: Spread | None) -> tuple[str, str, str]:
    if spread is None:
        return "", "", ""
    return f"{spread.p50:.2f}", f"{spread.p95:.2f}", f"{spread.greatest:.2f}"
