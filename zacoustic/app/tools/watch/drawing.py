"""Charts and bars of the dashboard as SVG and HTML, without external files."""

from collections.abc import Iterable, Sequence
from typing import Final

from zacoustic.app.tools.pages.truth import age_html
from zacoustic.app.tools.watch.history import SPAN_S, Point
from zacoustic.app.tools.watch.views import CauseView, EventView, TransferView
from zacoustic.app.tools.watch.words import share_words, time_words, transfer_words
from zacoustic.text.safetext import html_text

WIDTH, HEIGHT = 600, 90
"""Size of the chart, in its own units."""
STYLE: Final = """
.za { font-variant-numeric: tabular-nums; }
.za-kpi { min-width: 7.5rem; padding: .5rem .8rem; border-radius: .5rem; flex: 1 1 7.5rem;
          background: rgba(128,128,128,.10); overflow-wrap: anywhere; }
.za-kpi .v { font-size: 1.35rem; font-weight: 600; line-height: 1.5rem; white-space: nowrap; }
.za-kpi .k { font-size: .75rem; opacity: .65; }
.za-bars { display: grid; grid-template-columns: max-content 1fr max-content max-content;
           gap: .15rem .7rem; align-items: center; width: 100%; font-size: .85rem; }
.za-bar { height: .7rem; border-radius: .2rem; overflow: hidden;
          background: rgba(128,128,128,.18); }
.za-bar > div { height: 100%; background: #1b7fa8; }
.za-bar.done > div { background: #3a9d5d; }
.za-num { text-align: right; opacity: .8; }
.za-events { display: grid; grid-template-columns: max-content 1fr; gap: .1rem .8rem;
             font-size: .85rem; }
.za-events .t { opacity: .6; text-align: right; white-space: nowrap; }
.za-events .bad { color: #d64545; font-weight: 600; }
.za-dim { opacity: .6; font-size: .85rem; }
.za-h { font-size: .8rem; font-weight: 600; letter-spacing: .04em; text-transform: uppercase;
        opacity: .6; }
.za .q-table th { font-weight: 600; opacity: .7; }
.za .q-table td, .za .q-table th { padding: 2px 6px; height: 28px; }
.za .q-table td span { white-space: nowrap; }
.za-ground { fill: #fff; }
body.body--dark .za-ground { fill: var(--q-dark); }
.za-wide { width: 100%; overflow-x: auto; }
.za-keys { display: flex; flex-wrap: wrap; gap: .2rem 1.2rem; font-size: .85rem; }
.za .warn { color: #c77700; font-weight: 600; }
.za .bad { color: #d64545; font-weight: 600; }
"""
"""Style sheet of the page."""


def load_chart(points: Iterable[Point], now_s: float) -> str:
    """Draw the utilisation over the last ten minutes.

    Args:
        points: The oldest first.
        now_s: The moment at the right edge, s.
    """
    shown = [point for point in points if point.unix_s >= now_s - SPAN_S]
    top = _top(max((point.share for point in shown), default=0.0))
    places = [
        ((point.unix_s - now_s + SPAN_S) / SPAN_S * WIDTH, HEIGHT * (1 - point.share / top))
        for point in shown
    ]
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    drawn = [
        f'<line x1="0" x2="{WIDTH}" y1="{y}" y2="{y}" stroke="currentColor" stroke-opacity=".15"/>'
        for y in (0.5, HEIGHT / 2, HEIGHT - 0.5)
    ]
    if places:
        area = f"{places[0][0]:.1f},{HEIGHT} {line} {places[-1][0]:.1f},{HEIGHT}"
        drawn.append(f'<polygon points="{area}" fill="#1b7fa8" fill-opacity=".25"/>')
        drawn.append(
            f'<polyline points="{line}" fill="none" stroke="#1b7fa8" stroke-width="2" '
            'vector-effect="non-scaling-stroke"/>'
        )
    labels = (
        f'<div style="display:flex;justify-content:space-between" class="za-dim">'
        f"<span>10 min ago</span><span>full height: {share_words(top)}</span><span>now</span></div>"
    )
    return (
        f'<svg aria-label="load" viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none" '
        f'style="width:100%;height:{HEIGHT}px;display:block">{"".join(drawn)}</svg>{labels}'
    )


def cause_bars(causes: Sequence[CauseView]) -> str:
    """Draw the airtime by cause."""
    if not causes:
        return '<div class="za-dim">nothing transmitted</div>'
    rows = "".join(
        f"<span>{html_text(cause.cause)}</span>{_bar(cause.share)}"
        f'<span class="za-num">{cause.airtime_s:.1f} s</span>'
        f'<span class="za-num">{share_words(cause.share)}</span>'
        for cause in causes
    )
    return f'<div class="za-bars">{rows}</div>'


def transfer_bars(transfers: Sequence[TransferView]) -> str:
    """Draw the progress of large samples."""
    if not transfers:
        return '<div class="za-dim">none under way</div>'
    rows = []
    for transfer in transfers:
        share, kind = 0.0, ""
        if transfer.total_bytes:
            share = min(transfer.done_bytes / transfer.total_bytes, 1.0)
        if transfer.outcome is not None:
            share, kind = float(transfer.outcome == "delivered"), "done"
        rows.append(f"<div>{html_text(transfer_words(transfer))}{_bar(share, kind)}</div>")
    return f'<div style="display:grid;gap:.4rem;font-size:.85rem">{"".join(rows)}</div>'


def event_lines(events: Sequence[EventView]) -> str:
    """Write the last events, the newest first; a repeated one is one line."""
    if not events:
        return '<div class="za-dim">none</div>'
    times: dict[tuple[str, str], int] = {}
    for event in events:
        times[event.event, event.text] = times.get((event.event, event.text), 0) + 1
    rows = ""
    for event in events:
        number = times.pop((event.event, event.text), 0)
        if not number:  # shown above already, at its last occurrence
            continue
        again = f" ({number} times)" if number > 1 else ""
        ago = age_html(event.ago_s, time_words(event.ago_s), form="short")
        rows += (
            f'<span class="t">{ago} ago</span>'
            f'<span class="{"bad" if event.is_trouble else ""}">'
            f"{html_text(event.text)}{again}</span>"
        )
    return f'<div class="za-events">{rows}</div>'


def figure(name: str, value: str, *, note: str = "", kind: str = "") -> str:
    """Write one number with its name.

    Args:
        name: Its name.
        value: The number.
        note: A few words below.
        kind: Class of the number: warn, bad, or none.
    """
    below = f'<div class="k">{html_text(note)}</div>' if note else ""
    head = f'<div class="k">{html_text(name)}</div>'
    return f'<div class="za-kpi">{head}<div class="v {kind}">{html_text(value)}</div>{below}</div>'


def _bar(share: float, kind: str = "") -> str:
    width = f"{share * 100:.1f}%"
    return f'<div class="za-bar {kind}"><div style="width:{width}"></div></div>'


def _top(share: float) -> float:
    """Return the upper limit of a chart: the next of a few round shares."""
    return next(top for top in (0.05, 0.1, 0.2, 0.5, 1.0) if share <= top)
