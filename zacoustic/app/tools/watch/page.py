"""The dashboard: gateways as a web page. Needs nicegui, the extra `console`.

NiceGUI includes everything that the browser needs: the page works without internet.
"""

from collections.abc import Sequence
from typing import Any, Final

from nicegui import ui

from zacoustic.app.tools.pages.webpage import Banner
from zacoustic.app.tools.watch.crowd import (
    MOST_PEERS,
    gateways_in_short,
    peers_in_short,
    streams_in_short,
)
from zacoustic.app.tools.watch.drawing import (
    STYLE,
    cause_bars,
    event_lines,
    figure,
    load_chart,
    transfer_bars,
)
from zacoustic.app.tools.watch.graph import graph_of
from zacoustic.app.tools.watch.graphdrawing import graph_legend, graph_svg, graph_words
from zacoustic.app.tools.watch.lookout import Lookout
from zacoustic.app.tools.watch.views import GatewayView, PeerView, StreamView
from zacoustic.app.tools.watch.ways import (
    carried_words,
    carry_words,
    reached_cells,
    route_cells,
    routes_of,
)
from zacoustic.app.tools.watch.words import (
    LOSING,
    NOTHING,
    alarm_of,
    capability_words,
    frame_cells,
    is_quiet,
    is_well,
    link_cells,
    number_words,
    peer_cells,
    share_words,
    size_words,
    state_words,
    stream_cells,
    time_words,
    title_words,
    troubled_first,
    waits_words,
)
from zacoustic.text.safetext import one_line

REFRESH_S: Final = 0.5
"""Period of updates, s."""
GRAPH_REFRESH_S: Final = 2.0
"""Period of updates of the graph, s: with forty nodes it is a hundred times as long as a table."""

_GATEWAY_COLUMNS: Final = (
    ("gateway", "gateway", True), ("air", "on the air", False), ("waiting", "waits", False),
    ("nodes", "nodes", False), ("trouble", "", True),
)  # fmt: skip
_STREAM_COLUMNS: Final = (
    ("id", "id", False), ("name", "stream", True), ("kind", "kind", True),
    ("sent", "sent", False), ("sent_ago", "last", False), ("sent_rate", "rate", False),
    ("heard", "heard", False), ("heard_ago", "last", False), ("heard_rate", "rate", False),
    ("age", "age", False), ("waiting", "waits", False), ("refused", "refused", False),
    ("expired", "expired", False), ("airtime", "airtime", False),
    ("trouble", "", True),
)  # fmt: skip
_PEER_COLUMNS: Final = (
    ("node", "node", True), ("heard", "heard", False), ("range", "range", False),
    ("signal", "signal", False), ("lost", "frames lost", False), ("trouble", "", True),
)  # fmt: skip
_FRAME_COLUMNS: Final = (
    ("what", "what", True), ("bytes", "bytes", False), ("airtime", "airtime", False),
    ("ago", "began", False), ("outcome", "", True),
)  # fmt: skip
_LINK_COLUMNS: Final = (
    ("link", "link", True), ("state", "state", True), ("sent", "sent", False),
    ("heard", "heard", False), ("airtime", "airtime", False),
)  # fmt: skip
_ROUTE_COLUMNS: Final = (
    ("route", "route", True), ("path", "path", True), ("link", "link", True),
    ("sent", "sent", False), ("heard", "heard", False), ("hop", "worst hop from here", True),
)  # fmt: skip
_BOND_COLUMNS: Final = (
    ("bond", "list of links", True), ("in_use", "in use", True), ("by", "last reached by", True),
    ("nodes", "nodes", True),
)  # fmt: skip
_CARRIED_COLUMNS: Final = (("topic", "carried topic", True), ("kept", "kept here", True))
FRAMES_SHOWN: Final = 8
"""Number of newest frames to show of each gateway."""
_AGE_CELL: Final = """<q-td :props="props"><span v-if="props.value" data-form="short"
  :data-age="props.row.%(name)s_s">{{ props.value }}</span>%(behind)s</q-td>"""
_WARN_CELL: Final = '<q-td :props="props" class="warn">{{ props.value }}</q-td>'
_BAD_CELL: Final = '<q-td :props="props" class="bad">{{ props.value }}</q-td>'


_AGO: Final = '<span v-if="props.value !== &quot;never&quot;"> ago</span>'


class Page:
    """One browser's view of all gateways.

    Args:
        lookout: Its data.
    """

    def __init__(self, lookout: Lookout) -> None:
        self._lookout = lookout
        self._sections: list[_Section] = []
        ui.page_title("zacoustic")
        self._banner = Banner("NOT CURRENT")
        ui.add_css(STYLE)
        ui.dark_mode(value=None)  # as set in the browser
        ui.colors(primary="#155e7c", positive="#1b7a34", negative="#b3261e")  # 4.5 : 1
        with ui.header().classes("items-center q-py-sm"):
            ui.label("zacoustic").classes("text-h6").props("role=heading aria-level=1")
            self._where = ui.label().classes("opacity-80")
        with ui.column().classes("za w-full gap-6"):
            self._trouble = ui.label().classes("text-h6 bad").mark("trouble")
            self._network = _Network()
            self._body = ui.column().classes("w-full gap-8 za-live")
            self._others = _table(_GATEWAY_COLUMNS).mark("gateways")
            self._rest = ui.label().classes("za-dim").mark("rest")
        ui.timer(REFRESH_S, self.refresh)
        ui.timer(GRAPH_REFRESH_S, self.refresh_graph)
        self.refresh()

    def refresh_graph(self) -> None:
        """Show the network as it is at present."""
        lookout = self._lookout
        self._network.show([lookout.board.view(each) for each in lookout.addresses()])

    def refresh(self) -> None:
        """Show the present state."""
        lookout = self._lookout
        addresses = lookout.addresses()
        number = f"{len(addresses)} gateway{'' if len(addresses) == 1 else 's'}"
        self._where.set_text(f"{number} on {lookout.where}")
        views = [lookout.board.view(address) for address in addresses]
        self._banner.beat(alarm_of(views, lookout.trouble))
        # The banner shows it above the gateways.
        trouble = "" if addresses else lookout.trouble or "no gateway has been heard yet"
        self._trouble.set_text(trouble)
        self._trouble.set_visibility(bool(trouble))
        if self._network.number != len(addresses):
            self.refresh_graph()
        whole, others, rest = gateways_in_short(views)
        while len(self._sections) < len(whole):
            with self._body:
                self._sections.append(_Section())
        for index, section in enumerate(self._sections):
            section.card.set_visibility(index < len(whole))
        for section, view in zip(self._sections, whole, strict=False):
            history = lookout.histories.get(view.address)
            chart = load_chart(history.points if history else (), view.unix_s)
            section.show(view, chart)
        _fill(self._others, [gateway_row(each) for each in others])
        self._others.set_visibility(bool(others))
        self._rest.set_text(f"{rest}: zacoustic dashboard --node N shows one" if rest else "")


class _Network:
    """The graph of all gateways; made inside of the element that holds it."""

    def __init__(self) -> None:
        self.number = 0
        """Number of gateways in it."""
        self._is_open = True
        with ui.card().classes("w-full q-pa-sm za-live") as self._card:
            self._whole = ui.expansion("network", value=True).classes("w-full").mark("network")
            with self._whole:
                self._graph = ui.html(sanitize=False).classes("za-wide").mark("graph")
                self._legend = ui.html(sanitize=False).classes("w-full").mark("legend")
                with ui.expansion("the same in words").classes("w-full").props("dense"):
                    self._words = ui.html(sanitize=False).classes("w-full").mark("description")
        self._card.set_visibility(False)

    def show(self, views: Sequence[GatewayView]) -> None:
        """Show the present network; of one node alone only a line that opens."""
        graph = graph_of(views)
        self.number = len(views)
        self._card.set_visibility(bool(graph.nodes))
        if self._is_open is graph.is_alone:  # otherwise it stays as the reader has left it
            self._is_open = not graph.is_alone
            self._whole.set_value(self._is_open)
        self._graph.set_content(graph_svg(graph))
        self._legend.set_content(graph_legend(graph))
        self._words.set_content(graph_words(graph))


class _Section:
    """One gateway; made inside of the element that holds it."""

    def __init__(self) -> None:
        with ui.card().classes("w-full gap-3") as self.card:
            with ui.row().classes("items-center gap-3"):
                self._title = ui.label().classes("text-h5")
                self._state = ui.badge().classes("text-body2 q-pa-xs").mark("state")
                self._modem = ui.label().classes("za-dim")
            self._figures = ui.html(sanitize=False).classes("w-full").mark("figures")
            with ui.row().classes("w-full items-start gap-6"):
                with ui.column().classes("gap-3").style("flex: 3 1 42rem; min-width: 0"):
                    _heading("streams")
                    self._streams = _table(_STREAM_COLUMNS, sent_ago="", heard_ago="", age="").mark(
                        "streams"
                    )
                    self._more_streams = ui.label().classes("za-dim").mark("more streams")
                    self._quiet = ui.checkbox("quiet streams as well").mark("quiet")
                    with ui.column().classes("w-full gap-3") as self._ways:
                        _heading("links and routes")
                        self._links = _table(_LINK_COLUMNS).mark("links")
                        self._routes = _table(_ROUTE_COLUMNS).mark("routes")
                        self._bonds = _table(_BOND_COLUMNS).mark("bonds")
                        self._carried = _table(_CARRIED_COLUMNS).mark("carried")
                    _heading("nodes")
                    self._peers = _table(_PEER_COLUMNS, heard=_AGO).mark("peers")
                    self._more_peers = ui.label().classes("za-dim").mark("more peers")
                    self._all = ui.checkbox("all nodes").mark("all nodes")
                    _heading("last frames")
                    self._frames = _table(_FRAME_COLUMNS, ago=_AGO).mark("frames")
                with ui.column().classes("gap-3").style("flex: 2 1 22rem; min-width: 0"):
                    _heading("on the air")
                    self._chart = ui.html(sanitize=False).classes("w-full").mark("chart")
                    _heading("airtime went for")
                    self._causes = ui.html(sanitize=False).classes("w-full").mark("causes")
                    _heading("large samples")
                    self._transfers = ui.html(sanitize=False).classes("w-full").mark("transfers")
                    _heading("events")
                    self._events = ui.html(sanitize=False).classes("w-full").mark("events")

    def show(self, view: GatewayView, chart: str) -> None:
        """Show the present view."""
        self._title.set_text(title_words(view))
        self._state.set_text(state_words(view))
        self._state.props(f"color={'positive' if is_well(view) else 'negative'}")
        self._modem.set_text(_modem_words(view))
        self._figures.set_content(_figures(view))
        wanted = [each for each in view.streams if self._quiet.value or not is_quiet(each)]
        streams, more = streams_in_short(troubled_first(wanted))
        _fill(self._streams, [stream_row(each) for each in streams])
        self._more_streams.set_text(more)
        self._show_ways(view)
        peers, more = peers_in_short(view.peers, is_complete=self._all.value)
        _fill(self._peers, [peer_row(each) for each in peers])
        self._more_peers.set_text(more)
        self._all.set_visibility(len(view.peers) > MOST_PEERS)
        _fill(self._frames, frame_rows(view))
        self._chart.set_content(chart)
        self._causes.set_content(cause_bars(view.causes))
        self._transfers.set_content(transfer_bars(view.transfers))
        self._events.set_content(event_lines(view.events))

    def _show_ways(self, view: GatewayView) -> None:
        """Show several links, routes, lists of links and carried topics, as far as there are."""
        links, routes, bonds = link_rows(view), route_rows(view), bond_rows(view)
        carried = carried_rows(view)
        for table, rows in (
            (self._links, links), (self._routes, routes), (self._bonds, bonds),
            (self._carried, carried),
        ):  # fmt: skip
            _fill(table, rows)
            table.set_visibility(bool(rows))
        self._ways.set_visibility(bool(links or routes or bonds or carried))


def link_rows(view: GatewayView) -> list[dict[str, Any]]:
    """Return the rows of links; none for one alone."""
    if len(view.links) <= 1:
        return []
    return [_row(link.name, _LINK_COLUMNS, link_cells(link)) for link in view.links]


def route_rows(view: GatewayView) -> list[dict[str, Any]]:
    """Return the rows of routes that end at a node or pass it."""
    return [
        _row(name, _ROUTE_COLUMNS, route_cells(name, end, hop))
        for name, end, hop in routes_of(view)
    ]


def bond_rows(view: GatewayView) -> list[dict[str, Any]]:
    """Return the rows of lists of links, one for the nodes that are reached alike."""
    return [
        _row(number, _BOND_COLUMNS, cells) for number, (_, cells) in enumerate(reached_cells(view))
    ]


def carried_rows(view: GatewayView) -> list[dict[str, Any]]:
    """Return the rows of carried topics of which something is kept."""
    return [
        {
            "id": number,
            "topic": one_line(stream.stream),
            "kept": one_line("; ".join(carried_words(stream, view))),
        }
        for number, stream in enumerate(view.carry.streams if view.carry is not None else ())
    ]


def gateway_row(view: GatewayView) -> dict[str, Any]:
    """Return the row of a gateway in the list of many."""
    return {
        "id": view.address,
        "gateway": title_words(view),
        "air": share_words(view.utilisation),
        "waiting": view.waiting or "",
        "nodes": len(view.peers),
        "trouble": "" if is_well(view) else state_words(view),
    }


def stream_row(stream: StreamView) -> dict[str, Any]:
    """Return the row of a stream."""
    sent, sent_ago, sent_rate, heard, heard_ago, heard_rate, *others = stream_cells(stream)
    age, waiting, airtime, trouble = others
    cells = (
        str(stream.id), stream.name, stream.kind,
        sent, sent_ago, _or_nothing(sent_rate), heard, heard_ago, _or_nothing(heard_rate), age,
        waiting, str(stream.refused or ""), str(stream.expired or ""), airtime, trouble,
    )  # fmt: skip
    ages = ("sent_ago_s", "heard_ago_s", "age_s")
    row = _row(stream.id, _STREAM_COLUMNS, cells)
    return row | {name: getattr(stream, name) for name in ages} | {"id": stream.id}


def peer_row(peer: PeerView) -> dict[str, Any]:
    """Return the row of a node."""
    row = _row(peer.address, _PEER_COLUMNS, peer_cells(peer))
    row |= {"heard": _unless_never(peer.heard_ago_s) or "never", "heard_s": peer.heard_ago_s}
    row["lost"] += " !" if (peer.per or 0) > LOSING else ""
    return row


def frame_rows(view: GatewayView) -> list[dict[str, Any]]:
    """Return the rows of the last frames, the one being sent on top."""
    now = [] if view.transmitting is None else [(view.transmitting, "being sent")]
    rows = [*now, *((frame, "") for frame in view.frames[:FRAMES_SHOWN])]
    return [
        _row(number, _FRAME_COLUMNS, frame_cells(frame, outcome)) | {"ago_s": frame.ago_s}
        for number, (frame, outcome) in enumerate(rows)
    ]


def _row(
    number: int | str, columns: Sequence[tuple[str, str, bool]], cells: Sequence[str]
) -> dict[str, Any]:
    """Return a row of a table; names in it are data."""
    names = (name for name, _, _ in columns)
    return {"id": number, **dict(zip(names, map(one_line, cells), strict=True))}


def _figures(view: GatewayView) -> str:
    damaged = f"{view.frames_damaged} damaged" if view.frames_damaged else ""
    journal = "bad" if view.journal not in ("kept", "none") else ""
    window = f"of the last {time_words(view.window_s)}" if view.window_s else ""
    busy = "warn" if (view.utilisation or 0) > 0.5 else ""
    sent = f"{size_words(view.whole.bytes_sent)}, {view.whole.airtime_s:.0f} s"
    figures = [
        figure("on the air", share_words(view.utilisation), note=window, kind=busy),
        figure(
            "waiting",
            str(view.waiting),
            note=one_line(waits_words(view.whole.waits)) or "samples, calls, goals",
        ),
        figure("frames sent", str(view.whole.frames_sent), note=sent),
        figure("frames heard", str(view.whole.frames_heard), note=damaged or "none damaged",
               kind="warn" if damaged else ""),
        figure("journal", view.journal, kind=journal),
        figure("runs for", time_words(view.uptime_s), note=f"zacoustic {view.version}"),
    ]  # fmt: skip
    if (kept := view.carry) is not None:
        busy = "warn" if kept.refused or kept.expired else ""
        figures.append(
            figure("carried", str(kept.own + kept.carried), note=carry_words(kept), kind=busy)
        )
    if view.modem.battery_v is not None:
        figures.append(
            figure("modem", number_words(view.modem.battery_v, "V"), note=view.modem.firmware)
        )
    return f'<div style="display:flex;gap:.6rem;flex-wrap:wrap">{"".join(figures)}</div>'


def _modem_words(view: GatewayView) -> str:
    words = [view.link, view.wire]
    words += [capability_words(view.whole), f"table {view.digest}" if view.digest else ""]
    return " · ".join(word for word in words if word)


def _heading(text: str) -> None:
    ui.label(text).classes("za-h")


def _table(columns: Sequence[tuple[str, str, bool]], **ages: str) -> ui.table:
    """Make a table; `ages` names the columns whose ages count on, and the texts after them."""
    told = [
        {"name": name, "field": name, "label": label, "align": "left" if is_left else "right"}
        for name, label, is_left in columns
    ]
    made = ui.table(columns=told, rows=[], row_key="id", pagination=0)
    made.props("dense flat hide-pagination wrap-cells").classes("w-full")
    made.add_slot("body-cell-trouble", _BAD_CELL)
    for name in ("refused", "expired"):
        made.add_slot(f"body-cell-{name}", _WARN_CELL)
    for name, behind in ages.items():
        made.add_slot(f"body-cell-{name}", _AGE_CELL % {"name": name, "behind": behind})
    return made


def _fill(table: ui.table, rows: list[dict[str, Any]]) -> None:
    if table.rows != rows:
        table.rows = rows


def _unless_never(seconds: float | None) -> str:
    return "" if seconds is None else time_words(seconds)


def _or_nothing(words: str) -> str:
    return "" if words == NOTHING else words
