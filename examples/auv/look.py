"""How the console looks: its style sheet, its keys, and tables as HTML.

Nothing is loaded from outside. Whatever comes from the vehicle or from the gateway is escaped here.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from examples.auv.ladder import KINDS
from examples.auv.readout import Line, OrderLine, Value, ago
from zacoustic.console import age_html, html_text

_HERE: Final = Path(__file__).parent
CSS: Final = (_HERE / "console.css").read_text(encoding="utf-8")
PRESS_JS: Final = (_HERE / "press.js").read_text(encoding="utf-8")
KEYS_JS: Final = (_HERE / "console.js").read_text(encoding="utf-8")
CLICK_JS: Final = """(event) => {
  const map = event.currentTarget.querySelector('svg');
  const screen = new DOMPoint(event.clientX, event.clientY);
  const point = screen.matrixTransform(map.getScreenCTM().inverse());
  emit(point.x, point.y);
}"""
"""Gives a click on the map in the map's own units."""

KEYS_HINT: Final = (
    "<b>← →</b> rudder <b>↑ ↓</b> elevator <b>+ −</b> thrust <b>0</b> zero <b>space</b> stop"
)

LEGEND: Final = "".join(
    f'<span><i style="background:{kind.colour}"></i>{kind.name}</span>' for kind in KINDS
)


def _age(seconds: float) -> str:
    return age_html(seconds, ago(seconds))


def report_age(age_s: float | None) -> str:
    """Say how old the newest report is."""
    return "no report yet" if age_s is None else f"report {_age(age_s)} old"


def link_and_vehicle(link: str, heard_s: float | None) -> str:
    """Say how the modem is, and how long ago the vehicle was heard."""
    heard = "" if heard_s is None else f", vehicle heard {_age(heard_s)} ago"
    return f"modem {html_text(link)}{heard}"


def values_table(values: Iterable[Value]) -> str:
    """Return the vehicle's values: reported, how old, and what they probably are now."""
    rows = [
        f'<tr><td class="name">{html_text(each.name)}</td>'
        f'<td class="reported">{html_text(each.reported)}</td>'
        f'<td class="age{" is-bad" if each.is_old else ""}">{_age(each.age_s)}</td>'
        f'<td class="predicted">{html_text(each.now)}</td></tr>'
        for each in values
    ]
    if not rows:
        return '<span class="caption">not heard yet</span>'
    head = (
        '<tr><th></th><th class="reported">reported</th><th style="text-align:right">age</th>'
        '<th class="predicted">probably now</th></tr>'
    )
    return f'<table class="lines">{head}{"".join(rows)}</table>'


def lines_table(lines: Iterable[Line], nothing: str) -> str:
    """Return lines as a table; `nothing` stands for none."""
    rows = [
        f'<tr><td class="name">{html_text(each.name)}</td>'
        f"<td{' class=is-bad' if each.is_bad else ''}>{html_text(each.text)}</td>"
        f'<td class="age">{"" if each.age_s is None else _age(each.age_s)}</td></tr>'
        for each in lines
    ]
    if not rows:
        return f'<span class="keys">{html_text(nothing)}</span>'
    return f'<table class="lines">{"".join(rows)}</table>'


def orders_table(orders: Iterable[OrderLine]) -> str:
    """Return the commands and their outcomes, newest first."""
    rows = [
        f'<tr><td class="age">{_age(each.age_s)}</td><td>{html_text(each.text)}'
        f'<br><span class="is-{each.state}">{html_text(each.outcome)}</span></td></tr>'
        for each in orders
    ]
    if not rows:
        return '<span class="keys">no orders yet: begin with “arm”</span>'
    return f'<table class="lines">{"".join(rows)}</table>'
