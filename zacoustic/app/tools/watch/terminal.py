"""Views of gateways drawn on a terminal. Needs rich, the extra `terminal`.

A name in a view is data: it enters a picture through `_cell`, never as a text of rich's, in which
brackets are markup.
"""

from collections.abc import Sequence
from types import TracebackType
from typing import Final, Self

from rich import box
from rich.columns import Columns
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.live import Live
from rich.measure import Measurement
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from zacoustic.app.tools.watch.crowd import gateways_in_short, peers_in_short, streams_in_short
from zacoustic.app.tools.watch.views import GatewayView, PeerView, StreamView
from zacoustic.app.tools.watch.ways import (
    carried_words,
    carry_words,
    is_poor,
    reached_cells,
    reached_of,
    route_cells,
    routes_of,
)
from zacoustic.app.tools.watch.words import (
    LOSING,
    LOST_OUTCOMES,
    OLD_S,
    capability_words,
    frame_cells,
    is_quiet,
    is_well,
    link_cells,
    load_words,
    now_words,
    number_words,
    peer_cells,
    share_words,
    size_words,
    state_words,
    stream_cells,
    time_words,
    title_words,
    transfer_words,
    waits_words,
)
from zacoustic.core.relay.relay import Hop
from zacoustic.status.link import RouteDocument
from zacoustic.text.safetext import one_line

EVENTS_SHOWN: Final = 6
"""Number of newest events to show of each gateway."""
TROUBLES_SHOWN: Final = 3
"""Number of earlier events of trouble to show besides."""
FRAMES_SHOWN: Final = 5
"""Number of newest frames to show of each gateway."""
_MOST_CARRIED: Final = 8
"""Number of carried topics to show of each gateway."""
_BAR_CELLS: Final = 18
_WIDEST: Final = 1000
# Columns of streams omitted on a narrow terminal, by index: the rates, then also the airtime, then
# also the times of the last transmission and reception.
_LACKING: Final = tuple(map(frozenset, ((), (2, 5), (2, 5, 8), (1, 2, 4, 5, 8))))
_GOOD, _BAD, _WEAK, _DIM = "green", "bold red", "yellow", "dim"


class Terminal:
    """Redraws pictures in one place; a context manager.

    Args:
        console: The console; default: a new one on standard output.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console()
        self._live = Live(
            console=self._console, auto_refresh=False, screen=self._console.is_terminal
        )

    def __enter__(self) -> Self:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._live.stop()

    def show(self, picture: RenderableType) -> None:
        """Draw; without a terminal one picture below the other."""
        if self._console.is_terminal:
            self._live.update(picture, refresh=True)
        else:
            self._console.print(picture)
            self._console.file.flush()


def waiting_picture(where: str) -> RenderableType:
    """Draw that no gateway has been heard yet."""
    return _cell(f"no gateway has been heard on {where} yet; Ctrl-C ends", _WEAK)


def picture(views: Sequence[GatewayView], *, is_complete: bool = False) -> RenderableType:
    """Draw gateways, one below the other.

    Args:
        views: View of each.
        is_complete: Include all gateways and nodes, and quiet streams.
    """
    if is_complete:
        return Group(*(_gateway(view, is_complete=True) for view in views))
    whole, others, rest = gateways_in_short(views)
    return Group(
        *(_gateway(view, is_complete=False) for view in whole),
        *([_gateway_table(others)] if others else []),
        *([Text(rest, style=_DIM)] if rest else []),
    )


def _gateway_table(views: Sequence[GatewayView]) -> Table:
    table = _table("gateway", right=("on the air", "waiting"))
    table.add_column("")
    for view in views:
        state = _cell(state_words(view), _GOOD if is_well(view) else _BAD)
        table.add_row(
            _cell(title_words(view)), share_words(view.utilisation), str(view.waiting), state
        )
    return table


def _gateway(view: GatewayView, *, is_complete: bool) -> RenderableType:
    return Group(
        Rule(_cell(f" {title_words(view)} ", "bold"), align="left"),
        _head(view),
        *_ways(view),
        _streams(view, is_complete=is_complete),
        *([_peers(view, is_complete=is_complete)] if view.peers else []),
        Columns([_causes(view), _transfers(view)], padding=(0, 4)),
        *([_frames(view)] if view.frames else []),
        _events(view),
    )


def _head(view: GatewayView) -> RenderableType:
    state = _cell(state_words(view), _GOOD if is_well(view) else _BAD)
    modem = [view.link, view.wire, *([view.modem.firmware] if view.modem.firmware else [])]
    modem.append(capability_words(view.whole))
    if view.modem.battery_v is not None:
        modem.append(number_words(view.modem.battery_v, "V"))
    state.append_text(_cell(f"   {' · '.join(word for word in modem if word)}", _DIM))
    line = Text("on the air ", style=_DIM)
    line.append(load_words(view), style=_WEAK if (view.utilisation or 0) > 0.5 else "")
    damaged = f", {view.frames_damaged} damaged" if view.frames_damaged else ""
    whole = view.whole
    line.append(f"   frames {whole.frames_sent} sent, {whole.frames_heard} heard{damaged}")
    line.append(f"   {view.waiting} waiting", style=_WEAK if view.waiting else "")
    if whole.waits is not None:
        line.append_text(_cell(f"   {waits_words(whole.waits)}", _WEAK))
    line.append_text(_cell(f"   {now_words(view)}" if view.transmitting else "", "cyan"))
    line.append_text(_cell(f"   journal {view.journal}, runs {time_words(view.uptime_s)}", _DIM))
    return Group(state, line, *_carried(view))


def _carried(view: GatewayView) -> list[Text]:
    """Draw what is kept of carried topics, if there are any."""
    if view.carry is None:
        return []
    kept = view.carry
    is_short = kept.refused or kept.expired
    head = _cell(f"carried: {carry_words(kept)}", _WEAK if is_short else _DIM)
    lines = [
        f"  {stream.stream}: {'; '.join(carried_words(stream, view))}"
        for stream in kept.streams[:_MOST_CARRIED]
    ]
    return [head, *(_cell(line, _DIM) for line in lines)]


def _ways(view: GatewayView) -> list[RenderableType]:
    """Draw several links, routes, and by which link each node is reached, as far as there are."""
    routes, reached = routes_of(view), reached_of(view)
    return [
        *([_links(view)] if len(view.links) > 1 else []),
        *([_Fitting(_routes(routes), _routes(routes, is_narrow=True))] if routes else []),
        *([_reached(view)] if reached else []),
    ]


def _links(view: GatewayView) -> Table:
    table = _table("link", "state", right=("sent", "heard", "airtime"))
    for link in view.links:
        name, state, *figures = link_cells(link)
        style = _GOOD if link.state == "up" else _BAD
        table.add_row(_cell(name), _cell(state, style), *figures)
    return table


def _routes(
    routes: Sequence[tuple[str, RouteDocument | None, Hop | None]], *, is_narrow: bool = False
) -> Table:
    """Draw routes; the frames are those of the ends, and a narrow table lacks them."""
    table = _table("route", "path", "link", right=() if is_narrow else ("sent", "heard"))
    table.add_column("worst hop from here", no_wrap=True, overflow="ellipsis")
    for name, end, hop in routes:
        route, path, link, sent, heard, worst = route_cells(name, end, hop)
        table.add_row(
            _cell(route),
            _cell(path),
            _cell(link, _GOOD if end is None or end.link_state == "up" else _BAD),
            *(() if is_narrow else (sent, heard)),
            _cell(worst, _BAD if hop is not None and is_poor(hop) else ""),
        )
    return table


def _reached(view: GatewayView) -> Table:
    """Draw by which link each node is reached, one line for those that are reached alike."""
    table, known = _table("list of links", "in use", "last reached by", "nodes"), ""
    for each, (bond, in_use, by, nodes) in reached_cells(view):
        is_first, known = bond != known, bond
        style = _BAD if each.link is None else _WEAK if each.is_doubtful else ""
        whose = (bond, in_use) if is_first else ("", "")
        table.add_row(*map(_cell, whose), _cell(by, style), _cell(nodes))
    return table


def _cell(text: str, style: str = "") -> Text:
    """Return a text that may contain names, so that rich does not interpret it."""
    return Text(one_line(text), style=style)


def _table(*left: str, right: Sequence[str] = ()) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1))
    for name in left:
        table.add_column(name, no_wrap=True, overflow="ellipsis")
    for name in right:
        table.add_column(name, no_wrap=True, justify="right")
    return table


class _Fitting:
    """The first of several pictures that fits the width; else the last one."""

    def __init__(self, *pictures: RenderableType) -> None:
        self._pictures = pictures

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        room = options.update(max_width=_WIDEST)
        yield next(
            (
                each
                for each in self._pictures
                if Measurement.get(console, room, each).maximum <= options.max_width
            ),
            self._pictures[-1],
        )


def _streams(view: GatewayView, *, is_complete: bool) -> RenderableType:
    shown = [each for each in view.streams if is_complete or not is_quiet(each)]
    quiet = len(view.streams) - len(shown)
    rest = [f"quiet: {quiet} stream{'s' if quiet > 1 else ''}"] if quiet else []
    if not is_complete:
        shown, more = streams_in_short(shown)
        rest += [more] if more else []
    table = _Fitting(*(_stream_table(shown, lacking) for lacking in _LACKING))
    lines = [Text(", ".join(rest), style=_DIM)] if rest else []
    return Group(*([table] if shown or not lines else []), *lines)


def _stream_table(streams: Sequence[StreamView], lacking: frozenset[int]) -> Table:
    """Draw streams, without some columns on the right."""
    right = ("sent", "ago", "rate", "heard", "ago", "rate", "age", "waits", "airtime")
    kept = [index for index in range(len(right)) if index not in lacking]
    table = _table("id", "stream", right=[right[index] for index in kept])
    table.add_column("")
    for stream in streams:
        *cells, trouble = stream_cells(stream)
        figures = [Text(cells[index], _WEAK if right[index] == "waits" else "") for index in kept]
        table.add_row(str(stream.id), _cell(stream.name), *figures, _cell(trouble, _BAD))
    return table


def _peers(view: GatewayView, *, is_complete: bool) -> RenderableType:
    """Draw the other nodes; of many only those with a fault, and a line for the rest."""
    shown, rest = peers_in_short(view.peers, is_complete=is_complete)
    line = [Text(rest, style=_DIM)] if rest else []
    return Group(*([_peer_table(shown)] if shown or not rest else []), *line)


def _peer_table(peers: Sequence[PeerView]) -> Table:
    table = _table("node", right=("heard", "range", "signal", "frames lost"))
    table.add_column("")
    for peer in peers:
        node, heard, far, signal, lost, trouble = peer_cells(peer)
        table.add_row(
            _cell(node),
            Text(heard, style=_WEAK if (peer.heard_ago_s or 0) > OLD_S else ""),
            far,
            signal,
            Text(lost, style=_WEAK if (peer.per or 0) > LOSING else ""),
            _cell(trouble, _BAD),
        )
    return table


def _causes(view: GatewayView) -> RenderableType:
    if not view.causes:
        return Text("nothing transmitted", style=_DIM)
    table = _table("airtime for", right=("s", "share"))
    table.add_column("")
    for cause in view.causes:
        cells = round(cause.share * _BAR_CELLS)
        bar = Text("█" * cells, style="cyan").append("·" * (_BAR_CELLS - cells), style=_DIM)
        table.add_row(_cell(cause.cause), f"{cause.airtime_s:.1f}", share_words(cause.share), bar)
    return table


def _transfers(view: GatewayView) -> RenderableType:
    if not view.transfers:
        return Text("")
    table = _table("large samples")
    for transfer in view.transfers:
        style = _DIM if transfer.outcome is not None else ""
        words = _cell(transfer_words(transfer), style)
        if transfer.outcome is None and transfer.total_bytes:
            cells = round(min(transfer.done_bytes / transfer.total_bytes, 1) * _BAR_CELLS)
            words.append(f"  {'█' * cells}", style="cyan").append("·" * (_BAR_CELLS - cells))
        table.add_row(words)
    return table


def _frames(view: GatewayView) -> RenderableType:
    table = _table("last frames", right=("bytes", "airtime", "ago"))
    table.add_column("")
    for frame in view.frames[:FRAMES_SHOWN]:
        what, *figures, outcome = frame_cells(frame)
        is_lost = frame.outcome in LOST_OUTCOMES
        table.add_row(
            _cell(what, "cyan" if frame.way == "out" else ""),
            *figures,
            _cell(outcome, _WEAK if is_lost else _DIM),
        )
    return table


def _events(view: GatewayView) -> RenderableType:
    older = [event for event in view.events[EVENTS_SHOWN:] if event.is_trouble][:TROUBLES_SHOWN]
    lines = [
        Text(f"{time_words(event.ago_s):>8} ago  ", style=_DIM).append_text(
            _cell(event.text, _BAD if event.is_trouble else "")
        )
        for event in (*view.events[:EVENTS_SHOWN], *older)
    ]
    dropped = ", ".join(f"{count} {reason}" for reason, count in sorted(view.dropped.items()))
    if dropped:
        lines.append(_cell(f"dropped off the channel: {dropped}", _WEAK))
    if size_bytes := view.whole.bytes_sent:
        used = f"{size_words(size_bytes)} in {view.whole.airtime_s:.1f} s of airtime"
        lines.append(Text(used, style=_DIM))
    return Group(*lines)
