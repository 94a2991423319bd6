"""The graph of the network as SVG with its legend, and the same in words. No external files."""

import math
from collections.abc import Iterator, Sequence
from typing import Final

from zacoustic.app.tools.pages.truth import age_html
from zacoustic.app.tools.watch.graph import (
    CROWD,
    WIDTH,
    Edge,
    Graph,
    Node,
    Path,
    Way,
    is_old,
    rise_past,
)
from zacoustic.app.tools.watch.ways import cost_of, path_words
from zacoustic.app.tools.watch.words import share_words, time_words
from zacoustic.core.relay.relay import Hop
from zacoustic.text.safetext import html_text, one_line

CAPTION: Final = (
    "Positions are not known: places and lengths in this drawing mean nothing. A line joins two "
    "nodes of which one hears the other directly. Frames, and their share of the time, are those "
    "that came since the gateways run."
)
"""What the drawing is not."""
_LINK_COLOURS: Final = ("#1b7fa8", "#d2691e", "#2e8b57", "#b0568f", "#7a6ad8", "#8a7500")
_ROUTE_COLOURS: Final = ("#e0a800", "#00a3a3", "#c75cff", "#6fbf3a")
_GREY: Final = "#8a8a8a"
_BAD: Final = "#d64545"
_RADIUS: Final = 15.0
_SPREAD: Final = 10.0
"""Distance between the lines of two links of one edge."""
_MOST_LABELLED: Final = 10
"""Of more edges none is labelled: the words below the drawing have the figures."""
_MOST_LISTED: Final = 120
"""Most edges to write in words."""
_LETTERS: Final = 16
_LETTERS_IN_CROWD: Final = 8
_LABEL_AT: Final = 0.3
"""Where on a line its figures stand: its middle is that of a worst hop."""

Place = tuple[float, float]


def graph_svg(graph: Graph) -> str:
    """Draw a graph."""
    nodes = {node.address: node for node in graph.nodes}
    drawn = [
        *_paths(graph, nodes),
        *(line for edge in graph.edges for line in _edge(graph, edge, nodes)),
        *_worst_hops(graph, nodes),
        *(_node(graph, node) for node in graph.nodes),
    ]
    said = html_text(summary(graph))
    return (
        f'<svg role="img" aria-label="{said}" viewBox="0 0 {WIDTH} {graph.height}" '
        f'style="width:100%;min-width:40rem;max-height:{graph.height}px;display:block">'
        f"<title>network</title><desc>{said}</desc>{''.join(drawn)}</svg>"
    )


def graph_legend(graph: Graph) -> str:
    """Write which colour is which link and which route, and what the drawing does not say."""
    links = [
        _key(f"link {link}", _link_colour(graph, link), 3) for link in graph.links
    ]  # of one link the colour says nothing new, but its name does
    routes = [
        _key(route_words(path), _route_colour(index), 9) for index, path in enumerate(graph.paths)
    ]
    marks = ["<span>shaded: its gateway is heard here</span>"]
    if any(each.is_lost for each in graph.edges) or any(each.is_grey for each in graph.nodes):
        marks.append(_key("grey, dashed: lost, or its gateway is gone", _GREY, 3, is_dashed=True))
    if any(way.reach for edge in graph.edges for way in edge.ways):
        marks.insert(0, "<span>thick: in use; dashed: in doubt; dotted: does not reach</span>")
    if any(edge.hearer is not None for edge in graph.edges):
        marks.insert(0, "<span>dashed: only one of the two hears the other</span>")
    if any(path.worst is not None for path in graph.paths):
        marks.insert(0, "<span>! worst hop of a route, red if it is poor</span>")
    more = f" {graph.more} more nodes are not drawn." if graph.more else ""
    keys = "".join([*links, *routes, *marks])
    return f'<div class="za-keys">{keys}</div><div class="za-dim">{CAPTION}{more}</div>'


def graph_words(graph: Graph) -> str:
    """Write the same as a list, for who cannot see the drawing."""
    names = {node.address: title_of(node) for node in graph.nodes}
    rows = [f"<li>{html_text(_node_words(node))}</li>" for node in graph.nodes]
    rows += [
        f"<li>{html_text(_edge_words(edge, names))}, heard {_age(edge)}</li>"
        for edge in graph.edges[:_MOST_LISTED]
    ]
    if len(graph.edges) > _MOST_LISTED:
        rows.append(f"<li>and {len(graph.edges) - _MOST_LISTED} more pairs of nodes</li>")
    rows += [f"<li>{html_text(route_words(path))}</li>" for path in graph.paths]
    return f'<ul class="za-dim">{"".join(rows)}</ul>'


def summary(graph: Graph) -> str:
    """Return the graph in one sentence."""
    gateways = [node for node in graph.nodes if node.is_gateway]
    grey = [node for node in graph.nodes if node.is_grey]
    lost = [edge for edge in graph.edges if edge.is_lost]
    words = [
        _count(len(graph.nodes) + graph.more, "node"),
        _count(len(gateways), "gateway"),
        f"{_count(len(graph.edges), 'pair')} in which one hears the other",
    ]
    words += [f"{_count(len(lost), 'pair')} lost"] if lost else []
    words += [f"grey: {', '.join(title_of(node) for node in grey)}"] if grey else []
    words += [route_words(path) for path in graph.paths]
    return f"Network: {'; '.join(words)}"


def title_of(node: Node) -> str:
    """Return address and name of a node."""
    return f"{node.address} {node.name}".rstrip()


def route_words(path: Path) -> str:
    """Return a route with its path and its worst hop."""
    nodes = path_words(path.nodes) if path.nodes else "neither end is heard here"
    worst = f"worst hop {_hop_words(*path.worst)}" if path.worst else "no frame over a hop yet"
    return f"route {path.name}: {nodes}, {worst}"


def _hop_words(sender: int, hop: Hop) -> str:
    return (
        f"{sender}→{hop.next_node}: {cost_of(hop):.1f} transmissions for each frame, "
        f"{hop.given_up} given up"
    )


# Nodes


def _node(graph: Graph, node: Node) -> str:
    colour = _GREY if node.is_grey else "currentColor"
    dashes = ' stroke-dasharray="4 3"' if node.is_grey else ""
    fill = colour if node.is_gateway else "none"
    shown = one_line(node.name)
    is_crowd = len(graph.nodes) > CROWD
    letters, size = (_LETTERS_IN_CROWD, 12) if is_crowd else (_LETTERS, 14)
    if len(shown) > letters:
        shown = f"{shown[: letters - 1]}…"
    x, y, anchor = _label_place(graph, node)
    return (
        f'<g class="node{" grey" if node.is_grey else ""}"><title>{html_text(_node_words(node))}'
        f'</title><circle cx="{node.x}" cy="{node.y}" r="{_RADIUS}" class="za-ground"/>'
        f'<circle cx="{node.x}" cy="{node.y}" r="{_RADIUS}" fill="{fill}" fill-opacity=".15" '
        f'stroke="{colour}" stroke-width="2"{dashes}/>'
        f'<text x="{node.x}" y="{node.y + 5}" text-anchor="middle" font-size="14" '
        f'font-weight="600" fill="{colour}">{node.address}</text>'
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}" '
        f'fill="{colour}" unicode-bidi="isolate">{html_text(shown)}</text></g>'
    )


def _label_place(graph: Graph, node: Node) -> tuple[float, float, str]:
    """Return where a name begins, outside of the circle or below the line."""
    middle = graph.height / 2
    off_x, off_y = node.x - WIDTH / 2, node.y - middle
    is_flat = abs(off_y) > 0.8 * max(abs(each.y - middle) for each in graph.nodes)
    if graph.is_line or len(graph.nodes) <= 1 or (is_flat and off_y):
        is_above = not graph.is_line and off_y < -1
        return node.x, node.y + (-_RADIUS - 8 if is_above else _RADIUS + 17), "middle"
    side = 1 if off_x > 0 else -1
    return node.x + side * (_RADIUS + 7), node.y + 5, "start" if side > 0 else "end"


def _node_words(node: Node) -> str:
    kind = "gateway" if node.is_gateway else "node"
    gone = (", its gateway is gone" if node.is_gateway else ", lost") if node.is_grey else ""
    return f"{kind} {title_of(node)}{gone}"


# Edges


def _edge(graph: Graph, edge: Edge, nodes: dict[int, Node]) -> Iterator[str]:
    start, end = (nodes[each] for each in edge.ends)
    names = {node.address: title_of(node) for node in (start, end)}
    is_labelled = len(graph.edges) <= _MOST_LABELLED
    for index, way in enumerate(edge.ways):
        shift = (index - (len(edge.ways) - 1) / 2) * _SPREAD
        bend = _bend(graph, start, end)
        path, point = _curve(_aside(start, end, shift), bend, _LABEL_AT)
        colour = _GREY if edge.is_lost else _link_colour(graph, way.link)
        faded = ' stroke-opacity=".45"' if is_old(edge) or _is_crowd(graph) else ""
        yield (
            f'<path class="edge{" lost" if edge.is_lost else ""}" d="{path}" fill="none" '
            f'stroke="{colour}" stroke-width="{_thickness(edge, way)}"{_dashes(edge, way)}{faded}>'
            f"<title>{html_text(f'{_ends_words(edge, names)}: {_way_words(way)}')}</title></path>"
        )
        if is_labelled and way.frames:
            _, middle = _curve(_aside(start, end, 0.0), bend, _LABEL_AT)
            yield _figures(point, middle, f"{way.frames}, {share_words(way.share)}", colour)


def _figures(point: Place, middle: Place, words: str, colour: str) -> str:
    """Write the figures of a link beside its line, away from the other links of the edge."""
    (x, y), anchor = point, "middle"
    off_x, off_y = x - middle[0], y - middle[1]
    if abs(off_x) > abs(off_y):
        x, y, anchor = x + math.copysign(5, off_x), y + 4, "start" if off_x > 0 else "end"
    else:
        y += 14 if off_y > 0 else -5
    return (
        f'<text class="figures" x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="12" '
        f'fill="{colour}">{words}</text>'
    )


def _thickness(edge: Edge, way: Way) -> float:
    is_one_of_several = len(edge.ways) > 1 or bool(way.reach)
    return 4 if is_one_of_several and way.is_used and not edge.is_lost else 1.5


def _dashes(edge: Edge, way: Way) -> str:
    if edge.is_lost or way.reach == "doubt" or edge.hearer is not None:
        return ' stroke-dasharray="7 5"'
    return ' stroke-dasharray="2 5"' if way.reach == "down" else ""


def _is_crowd(graph: Graph) -> bool:
    return len(graph.edges) > 4 * _MOST_LABELLED


def _edge_words(edge: Edge, names: dict[int, str]) -> str:
    ways = "; ".join(_way_words(way) for way in edge.ways)
    return f"{_ends_words(edge, names)}: {ways}"


def _ends_words(edge: Edge, names: dict[int, str]) -> str:
    words = " and ".join(names[each] for each in edge.ends)
    words += ", lost" if edge.is_lost else ""
    return words + (f", only {edge.hearer} hears the other" if edge.hearer is not None else "")


def _way_words(way: Way) -> str:
    words = [f"link {way.link}"] if way.link else []
    words += {"up": ["up"], "doubt": ["in doubt"], "down": ["does not reach"]}.get(way.reach, [])
    words += ["in use"] if way.reach and way.is_used else []
    if way.frames is not None:
        words.append(f"{_count(way.frames, 'frame')}, {share_words(way.share)} of the time")
    return ", ".join(words) or "frames not counted"


def _age(edge: Edge) -> str:
    if edge.heard_ago_s is None:
        return "never"
    return f"{age_html(edge.heard_ago_s, time_words(edge.heard_ago_s), form='short')} ago"


# Routes


def _paths(graph: Graph, nodes: dict[int, Node]) -> Iterator[str]:
    """Draw routes as broad bands beneath all else, beside each other where they share a hop."""
    number = len(graph.paths)
    for index, path in enumerate(graph.paths):
        shift = (index - (number - 1) / 2) * min(_SPREAD, 40 / number)
        for leg in path.legs:
            start, end = (nodes[each] for each in sorted(leg.ends))
            curve, _ = _curve(_aside(start, end, shift), _bend(graph, start, end))
            said = [_hop_words(sender, hop) for sender, hop in leg.hops]
            words = f"route {path.name}, {'; '.join(said) or 'hop without counters'}"
            yield (
                f'<path class="route" d="{curve}" fill="none" stroke="{_route_colour(index)}" '
                f'stroke-width="9" stroke-opacity=".45" stroke-linecap="round">'
                f"<title>{html_text(words)}</title></path>"
            )


def _worst_hops(graph: Graph, nodes: dict[int, Node]) -> Iterator[str]:
    """Mark the worst hop of each route with a sign in its middle."""
    marked: set[tuple[int, int]] = set()
    for path in graph.paths:
        if path.worst is None:
            continue
        sender, hop = path.worst
        if not {sender, hop.next_node} <= nodes.keys():
            continue
        ends = min(sender, hop.next_node), max(sender, hop.next_node)
        start, end = (nodes[each] for each in ends)
        _, (x, y) = _curve((start.x, start.y, end.x, end.y), _bend(graph, start, end))
        colour = _BAD if path.is_poor else "currentColor"
        words = f"route {path.name}, worst hop {_hop_words(sender, hop)}"
        yield (
            f'<g class="worst{" poor" if path.is_poor else ""}"><title>{html_text(words)}</title>'
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="9" class="za-ground"/>'
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="9" fill="none" stroke="{colour}" '
            f'stroke-width="3"/><text x="{x:.1f}" y="{y + 5:.1f}" text-anchor="middle" '
            f'font-size="14" font-weight="700" fill="{colour}">!</text>'
        )
        if ends not in marked:
            shown = f"{cost_of(hop):.1f} a frame"
            yield (
                f'<text x="{x:.1f}" y="{y - 24:.1f}" text-anchor="middle" font-size="12" '
                f'fill="{colour}">{shown}</text>'
            )
        marked.add(ends)
        yield "</g>"


# Geometry and colours


def _aside(start: Node, end: Node, shift: float) -> tuple[float, float, float, float]:
    """Return both ends of a line, moved to its side."""
    length = math.hypot(end.x - start.x, end.y - start.y) or 1.0
    off_x, off_y = -(end.y - start.y) / length * shift, (end.x - start.x) / length * shift
    return start.x + off_x, start.y + off_y, end.x + off_x, end.y + off_y


def _bend(graph: Graph, start: Node, end: Node) -> float:
    """Return how far a line is bent to pass the nodes between its ends."""
    if not graph.is_line or start.y != end.y:
        return 0.0
    row = [node.x for node in graph.nodes if node.y == start.y]
    between = sum(min(start.x, end.x) < x < max(start.x, end.x) for x in row)
    rise = rise_past(between)
    return -rise if start.x < end.x else rise


def _curve(
    ends: tuple[float, float, float, float], bend: float, at: float = 0.5
) -> tuple[str, Place]:
    """Return the path of a line, and a point of it, 0…1 of the way along."""
    x1, y1, x2, y2 = ends
    length = math.hypot(x2 - x1, y2 - y1) or 1.0
    x = (x1 + x2) / 2 - (y2 - y1) / length * bend
    y = (y1 + y2) / 2 + (x2 - x1) / length * bend
    first, second, third = (1 - at) ** 2, 2 * at * (1 - at), at**2
    point = first * x1 + second * x + third * x2, first * y1 + second * y + third * y2
    if not bend:
        return f"M{x1:.1f},{y1:.1f}L{x2:.1f},{y2:.1f}", point
    return f"M{x1:.1f},{y1:.1f}Q{x:.1f},{y:.1f} {x2:.1f},{y2:.1f}", point


def _link_colour(graph: Graph, link: str) -> str:
    links: Sequence[str] = graph.links
    return _LINK_COLOURS[links.index(link) % len(_LINK_COLOURS)] if link in links else "#1b7fa8"


def _route_colour(index: int) -> str:
    return _ROUTE_COLOURS[index % len(_ROUTE_COLOURS)]


def _key(words: str, colour: str, thickness: int, *, is_dashed: bool = False) -> str:
    dashes = ' stroke-dasharray="7 5"' if is_dashed else ""
    return (
        f'<span><svg width="28" height="10" aria-hidden="true" style="display:inline-block">'
        f'<line x1="0" x2="28" y1="5" y2="5" stroke="{colour}" '
        f'stroke-width="{thickness}"{dashes}/></svg> {html_text(words)}</span>'
    )


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'' if number == 1 else 's'}"
