"""The network as a graph: who hears whom, by which link, and which routes pass.

Positions are not known. So the layout says nothing of geography: a circle, or a line along the
longest route. The same views give the same graph.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import msgspec

from zacoustic.app.tools.watch.views import GatewayView, PeerView
from zacoustic.app.tools.watch.ways import cost_of, first_link, is_poor
from zacoustic.app.tools.watch.words import OLD_S
from zacoustic.core.bond.reach import Reach
from zacoustic.core.relay.relay import Hop

WIDTH: Final = 1000
"""Width of the drawing, in its own units."""
MOST_NODES: Final = 40
"""Most nodes to draw; gateways first."""
CROWD: Final = 10
"""Names in a drawing of more nodes are shorter."""
_MARGIN: Final = 90.0
_LEAST_LINE: Final = 3
_STATES: Final = (Reach.DOWN, Reach.DOUBT, Reach.UP)


class Node(msgspec.Struct, frozen=True, kw_only=True):
    """A node."""

    address: int
    """Acoustic address."""
    name: str
    """Name in the table; empty: unknown."""
    is_gateway: bool
    """Its gateway was heard on this network."""
    is_grey: bool
    """Its gateway is gone, or every gateway that knows it has lost it."""
    x: float
    """Place from the left, in units of the drawing."""
    y: float
    """Place from the top, in units of the drawing."""


class Way(msgspec.Struct, frozen=True, kw_only=True):
    """A link between two nodes."""

    link: str
    """Name of the link; empty: unknown."""
    is_used: bool
    """A list of links uses it now, or none says."""
    reach: str
    """``up``, ``doubt`` or ``down``, the worse one of both directions; empty: nobody says."""
    frames: int | None
    """Frames that came, both directions together; None: unknown."""
    share: float | None
    """Share of the time in which they came, 0…1; None: unknown."""


class Edge(msgspec.Struct, frozen=True, kw_only=True):
    """Two nodes of which at least one hears the other directly."""

    ends: tuple[int, int]
    """Their addresses, the smaller one first."""
    heard_ago_s: float | None
    """Time since the last frame between them, s; None: never."""
    is_lost: bool
    """Whoever reports it has lost the other, or is gone."""
    hearer: int | None
    """The only one that hears the other, where both have a gateway here; None: both do, or only one
    gateway can tell."""
    ways: tuple[Way, ...]
    """The links between them, by name."""


class Leg(msgspec.Struct, frozen=True, kw_only=True):
    """A hop of a route in the drawing."""

    ends: tuple[int, int]
    """The two nodes, in the order of the path."""
    hops: tuple[tuple[int, Hop], ...]
    """Sender and counters of each direction, as far as they are known."""


class Path(msgspec.Struct, frozen=True, kw_only=True):
    """A route in the drawing."""

    name: str
    """Its name."""
    nodes: tuple[int, ...]
    """Its path; empty: no end has told it."""
    legs: tuple[Leg, ...]
    """Its hops, as far as they are known."""
    worst: tuple[int, Hop] | None
    """Sender and counters of the hop with most transmissions for each frame; None: unknown."""

    @property
    def is_poor(self) -> bool:
        """Whether its worst hop costs much or loses frames."""
        return self.worst is not None and is_poor(self.worst[1])


class Graph(msgspec.Struct, frozen=True, kw_only=True):
    """A network at one moment."""

    nodes: tuple[Node, ...]
    """Its nodes by address."""
    edges: tuple[Edge, ...]
    """Its edges by addresses."""
    paths: tuple[Path, ...]
    """Its routes by name."""
    links: tuple[str, ...]
    """Names of all links, in order."""
    height: int
    """Height of the drawing, in its own units."""
    is_line: bool
    """Nodes stand along a route, not on a circle."""
    more: int
    """Nodes that are not drawn."""

    @property
    def is_alone(self) -> bool:
        """Whether there is nothing to see: at most one node."""
        return len(self.nodes) <= 1


def graph_of(views: Sequence[GatewayView]) -> Graph:
    """Return the graph of all gateways heard."""
    gateways = {view.address: view for view in views}
    names = _names(views)
    paths = _paths(views)
    named = {address for path in paths for leg in path.legs for address in leg.ends}
    ranked = sorted({*names, *named}, key=lambda each: (each not in gateways, each))
    drawn = set(ranked[:MOST_NODES])
    paths = tuple(_within(path, drawn) for path in paths)
    edges = tuple(each for each in _edges(gateways) if set(each.ends) <= drawn)
    line = _line(paths, drawn)
    places, height = _line_places(line, drawn, edges) if line else _circle_places(sorted(drawn))
    lost = _lost(gateways)
    nodes = tuple(
        Node(
            address=address,
            name=names.get(address, ""),
            is_gateway=address in gateways,
            is_grey=not gateways[address].is_alive if address in gateways else address in lost,
            x=places[address][0],
            y=places[address][1],
        )
        for address in sorted(drawn)
    )
    return Graph(
        nodes=nodes,
        edges=edges,
        paths=paths,
        links=tuple(sorted({way.link for edge in edges for way in edge.ways if way.link})),
        height=height,
        is_line=bool(line),
        more=len(ranked) - len(drawn),
    )


def _names(views: Sequence[GatewayView]) -> dict[int, str]:
    """Return the names of all nodes; a gateway's own word for itself counts."""
    names: dict[int, str] = {}
    for view in views:
        for peer in view.peers:
            names[peer.address] = names.get(peer.address) or peer.name
    return names | {view.address: view.name for view in views}


def _lost(gateways: dict[int, GatewayView]) -> set[int]:
    """Return the nodes that each gateway which runs and knows them has lost."""
    lost: dict[int, bool] = {}
    for view in gateways.values():
        for peer in view.peers:
            is_lost = peer.is_lost or not view.is_alive
            lost[peer.address] = lost.get(peer.address, True) and is_lost
    return {address for address, is_lost in lost.items() if is_lost}


# Edges


def _edges(gateways: dict[int, GatewayView]) -> Iterator[Edge]:
    rows: dict[tuple[int, int], list[tuple[GatewayView, PeerView]]] = {}
    for view in gateways.values():
        for peer in view.peers:
            if peer.address != view.address and _is_direct(peer):
                ends = min(view.address, peer.address), max(view.address, peer.address)
                rows.setdefault(ends, []).append((view, peer))
    for ends in sorted(rows):
        yield _edge(ends, rows[ends], gateways)


def _is_direct(peer: PeerView) -> bool:
    """Tell whether a node was heard without relays, or should be heard."""
    if peer.received is not None and not peer.received:
        return peer.is_lost and peer.heard_ago_s is None
    return peer.heard_ago_s is not None or peer.is_lost


def _edge(
    ends: tuple[int, int],
    rows: Sequence[tuple[GatewayView, PeerView]],
    gateways: dict[int, GatewayView],
) -> Edge:
    ages = [peer.heard_ago_s for _, peer in rows if peer.heard_ago_s is not None]
    hearing = [view.address for view, peer in rows if view.is_alive and not peer.is_lost]
    can_tell = [each for each in ends if each in gateways and gateways[each].is_alive]
    is_one_way = len(can_tell) == len(ends) and len(hearing) == 1
    return Edge(
        ends=ends,
        heard_ago_s=min(ages, default=None),
        is_lost=not hearing,
        hearer=hearing[0] if is_one_way else None,
        ways=_ways(rows),
    )


def _ways(rows: Sequence[tuple[GatewayView, PeerView]]) -> tuple[Way, ...]:
    """Return the links between two nodes, from what both say."""
    frames: dict[str, int] = {}
    shares: dict[str, float | None] = {}
    reach: dict[str, list[Reach]] = {}
    used: set[str] = set()
    for view, peer in rows:
        for each in peer.received or ():
            frames[each.link] = frames.get(each.link, 0) + each.frames
            share = _share(each.airtime_s, view.uptime_s)
            before = shares.get(each.link, 0.0)
            shares[each.link] = None if share is None or before is None else before + share
        for bond in view.bonds:
            for link, state in bond.reach.get(peer.address, {}).items():
                reach.setdefault(link, []).append(state)
            now_used, _ = first_link(bond, peer.address, view.links)
            used |= {now_used} if now_used is not None else set()
    names = sorted({*frames, *reach}) or [""]
    return tuple(
        Way(
            link=name,
            is_used=name in used or name not in reach,
            reach=_worst_of(reach.get(name, ())),
            frames=frames.get(name),
            share=shares.get(name),
        )
        for name in names
    )


def _share(airtime_s: float | None, uptime_s: float | None) -> float | None:
    if airtime_s is None or not uptime_s:
        return None
    return min(airtime_s / uptime_s, 1.0)


def _worst_of(states: Sequence[Reach]) -> str:
    return min(states, key=_STATES.index).value if states else ""


# Routes


def _paths(views: Sequence[GatewayView]) -> tuple[Path, ...]:
    nodes: dict[str, tuple[int, ...]] = {}
    hops: dict[str, list[tuple[int, Hop]]] = {}
    for view in views:
        for route in view.routes:
            nodes.setdefault(route.name, route.path)
        for hop in view.hops:
            hops.setdefault(hop.route, []).append((view.address, hop))
    return tuple(
        _path(name, nodes.get(name, ()), hops.get(name, ())) for name in sorted({*nodes, *hops})
    )


def _path(name: str, nodes: tuple[int, ...], hops: Sequence[tuple[int, Hop]]) -> Path:
    pairs = list(itertools.pairwise(nodes))
    known = set(pairs) | {(end, start) for start, end in pairs}
    for sender, hop in hops:
        pair = sender, hop.next_node
        if not nodes and pair not in known:
            pairs.append(pair)
            known |= {pair, (hop.next_node, sender)}
    legs = tuple(
        Leg(
            ends=pair,
            hops=tuple(
                (sender, hop) for sender, hop in hops if {sender, hop.next_node} == set(pair)
            ),
        )
        for pair in pairs
    )
    used = [(sender, hop) for leg in legs for sender, hop in leg.hops if hop.transmissions]
    worst = max(used, key=lambda each: (cost_of(each[1]), each[1].given_up), default=None)
    return Path(name=name, nodes=nodes, legs=legs, worst=worst)


def _within(path: Path, drawn: set[int]) -> Path:
    """Return what of a path lies between nodes that are drawn."""
    legs = tuple(leg for leg in path.legs if set(leg.ends) <= drawn)
    return msgspec.structs.replace(path, legs=legs)


# Places


def _line(paths: Iterable[Path], drawn: set[int]) -> tuple[int, ...]:
    """Return the path to draw as a line, at least half of all nodes; empty: a circle is drawn."""
    fitting = [path.nodes for path in paths if set(path.nodes) <= drawn]
    longest = max(fitting, key=len, default=())
    is_long = len(longest) >= max(_LEAST_LINE, math.ceil(len(drawn) / 2))
    return longest if is_long else ()


def _line_places(
    line: Sequence[int], drawn: set[int], edges: Sequence[Edge]
) -> tuple[dict[int, tuple[float, float]], int]:
    """Return the places of nodes along a path, with the others in a row below, and the height."""
    others = sorted(drawn - set(line))
    order = {address: index for index, address in enumerate(line)}
    steps = [abs(order[one] - order[other]) for one, other in (each.ends for each in edges)
             if {one, other} <= order.keys()]  # fmt: skip
    rise = 60.0 + rise_past(max(steps, default=1) - 1) / 2
    places = _row(line, rise)
    height = rise + 110.0
    if others:
        places |= _row(others, rise + 170.0)
        height += 190.0
    return places, round(height)


def rise_past(between: int) -> float:
    """Return how far to bend a line that passes this many nodes of a row."""
    return 34.0 + min(between, 6) * 18.0 if between > 0 else 0.0


def _row(addresses: Sequence[int], y: float) -> dict[int, tuple[float, float]]:
    if len(addresses) == 1:
        return {addresses[0]: (WIDTH / 2, y)}
    step = (WIDTH - 2 * _MARGIN) / (len(addresses) - 1)
    return {each: (round(_MARGIN + index * step, 1), y) for index, each in enumerate(addresses)}


def _circle_places(addresses: Sequence[int]) -> tuple[dict[int, tuple[float, float]], int]:
    """Return the places of nodes on an ellipse, the first one on the left, and the height."""
    number = len(addresses)
    if number <= 1:
        return dict.fromkeys(addresses, (WIDTH / 2, 60.0)), 130
    tall = 60.0 if number == 2 else min(110.0 + number * 12.0, 270.0)
    wide = 250.0 if number <= 4 else 340.0 if number <= CROWD else 400.0
    middle = tall + 60.0
    places = {}
    for index, each in enumerate(addresses):
        angle = math.pi + 2 * math.pi * index / number
        places[each] = (
            round(WIDTH / 2 + wide * math.cos(angle), 1),
            round(middle + tall * math.sin(angle), 1),
        )
    return places, round(2 * middle)


def is_old(edge: Edge) -> bool:
    """Tell whether nothing crossed an edge for long."""
    return edge.heard_ago_s is None or edge.heard_ago_s > OLD_S
