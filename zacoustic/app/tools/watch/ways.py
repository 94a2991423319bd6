"""Links, routes and lists of links of a gateway in short words, the same on terminal and page."""

from collections.abc import Iterable, Sequence
from typing import Final

import msgspec

from zacoustic.app.tools.watch.views import (
    CarriedView,
    CarryView,
    GatewayView,
    LinkView,
)
from zacoustic.app.tools.watch.words import NOTHING, size_words, time_words
from zacoustic.core.bond.reach import Reach
from zacoustic.core.relay.relay import Hop
from zacoustic.core.schedule.transmitter import UNHEARD_FRAMES
from zacoustic.status.link import BondDocument, RouteDocument

POOR_HOP: Final = 3
"""A hop with more transmissions than this for each frame that arrives is poor."""
_NODES_SHOWN: Final = 6
"""Most nodes of a path to write out."""
MOST_NODES_NAMED: Final = 8
"""Most nodes to name in a row of a list of links."""


class Reached(msgspec.Struct, frozen=True):
    """Nodes that one list of links reaches in the same way."""

    bond: str
    """Name of the list of links."""
    link: str | None
    """The first of its links that reaches them; None: none does."""
    is_doubtful: bool
    """That link is in doubt, so frames go by the next one as well."""
    nodes: tuple[int, ...]
    """Addresses, in order."""


def cost_of(hop: Hop) -> float:
    """Return the transmissions of a hop for each frame that has arrived."""
    return hop.transmissions / max(1, hop.passed_on)


def worst_hop(hops: Iterable[Hop]) -> Hop | None:
    """Return the hop with most transmissions for each frame; None: nothing was transmitted."""
    used = [hop for hop in hops if hop.transmissions]
    return max(used, key=lambda hop: (cost_of(hop), hop.given_up), default=None)


def is_poor(hop: Hop) -> bool:
    """Tell whether a hop costs much or loses frames, as the doctor judges it."""
    is_known = hop.transmissions >= UNHEARD_FRAMES
    return is_known and (cost_of(hop) > POOR_HOP or hop.given_up > hop.passed_on / 10)


def hop_words(hop: Hop | None) -> str:
    """Return what a hop costs: ``→ 3: 1.4 a frame, 2 given up``."""
    if hop is None:
        return NOTHING
    lost = f", {hop.given_up} given up" if hop.given_up else ""
    return f"→ {hop.next_node}: {cost_of(hop):.1f} a frame{lost}"


def path_words(path: Sequence[int]) -> str:
    """Return a path: ``1–2–3``, of a long one both ends and the number of its hops."""
    if len(path) <= _NODES_SHOWN:
        return "–".join(map(str, path)) or NOTHING
    return f"{path[0]}–{path[1]}–…–{path[-1]}, {len(path) - 1} hops"


def routes_of(view: GatewayView) -> list[tuple[str, RouteDocument | None, Hop | None]]:
    """Return each route over a node: name, its end if it ends there, and the worst hop there."""
    ends = {route.name: route for route in view.routes}
    names = sorted({*ends, *(hop.route for hop in view.hops)})
    return [
        (name, ends.get(name), worst_hop(hop for hop in view.hops if hop.route == name))
        for name in names
    ]


def route_cells(name: str, end: RouteDocument | None, hop: Hop | None) -> tuple[str, ...]:
    """Return what a table says of a route: name, path, link, frames sent, heard, worst hop."""
    if end is None:
        return name, "passes here", "", "", "", hop_words(hop)
    link, frames = f"{end.link} {end.link_state}".strip(), (end.frames_sent, end.frames_heard)
    return name, path_words(end.path), link, *map(str, frames), hop_words(hop)


def carry_words(kept: CarryView) -> str:
    """Return what a node keeps of carried topics: ``3 of its own wait, 2 of them in custody``."""
    said = [f"{kept.own} of its own wait"]
    if kept.own:
        said.append(f"{kept.in_custody} of them in custody")
    if kept.carried:
        room = f"{size_words(kept.carried_bytes)} of {size_words(kept.max_bytes)}"
        said.append(f"{kept.carried} of others, {room}")
    if kept.refused:
        said.append(f"{kept.refused} of others refused, no room")
    if kept.expired:
        said.append(f"{kept.expired} of others expired here")
    return ", ".join(said)


def carried_words(kept: CarriedView, view: GatewayView) -> list[str]:
    """Return what a gateway keeps of one topic, in short lines: how much for whom, and with whom.

    A custodian is named with the time since it was heard: one that never comes back is seen there.
    """
    peers, names = {each.address: each for each in view.peers}, names_of(view)
    waits = [f"{count} for {each} wait" for each, count in kept.own.items()]
    lines = [", ".join(waits)] if waits else []
    for address, count in kept.custodians.items():
        peer = peers.get(address)
        heard_s = None if peer is None else peer.heard_ago_s
        heard = "not heard" if heard_s is None else f"heard {time_words(heard_s)} ago"
        lost = ", LOST" if peer is not None and peer.is_lost else ""
        name = f"{address} {names.get(address, '')}".rstrip()
        lines.append(f"{count} of them in custody of {name}, {heard}{lost}")
    if kept.carried:
        for_whom = ", ".join(f"{count} for {each}" for each, count in kept.carried.items())
        lines.append(f"of others {for_whom}, {size_words(kept.carried_bytes)}")
    if kept.oldest_s is not None and kept.ends_in_s is not None:
        ends = time_words(kept.ends_in_s)
        lines.append(f"oldest {time_words(kept.oldest_s)}, first expires in {ends}")
    return lines


def reached_of(view: GatewayView) -> list[Reached]:
    """Return which nodes are reached by which link, the best links first."""
    return [each for bond in view.bonds for each in _reached_by(bond, view.links)]


def first_link(
    bond: BondDocument, address: int, links: Sequence[LinkView] = ()
) -> tuple[str | None, bool]:
    """Return the first link of a list that reaches a node, and whether it is in doubt.

    Args:
        bond: The list.
        address: The node.
        links: The links of the gateway: one that is down reaches nobody.
    """
    down = {link.name for link in links if link.state != "up"}
    reach = bond.reach.get(address, {})
    for state in (Reach.UP, Reach.DOUBT):
        for link in bond.links:
            if reach.get(link) is state and link not in down:
                return link, state is Reach.DOUBT
    return None, False


def _reached_by(bond: BondDocument, links: Sequence[LinkView]) -> list[Reached]:
    groups: dict[tuple[str | None, bool], list[int]] = {}
    for address in sorted(bond.reach):
        groups.setdefault(first_link(bond, address, links), []).append(address)
    order = {link: index for index, link in enumerate(bond.links)}

    def rank(item: tuple[str | None, bool]) -> tuple[int, bool]:
        link, is_doubtful = item
        return len(order) if link is None else order[link], is_doubtful

    return [
        Reached(bond.name, link, is_doubtful, tuple(groups[link, is_doubtful]))
        for link, is_doubtful in sorted(groups, key=rank)
    ]


def by_words(reached: Reached) -> str:
    """Return the link that reaches nodes, in words."""
    if reached.link is None:
        return "no link"
    return f"{reached.link}, in doubt" if reached.is_doubtful else reached.link


def nodes_words(reached: Reached, names: dict[int, str]) -> str:
    """Return the nodes with their names; of many the first ones, and the number of the others."""
    shown = [f"{each} {names.get(each, '')}".rstrip() for each in reached.nodes[:MOST_NODES_NAMED]]
    left = len(reached.nodes) - len(shown)
    return ", ".join(shown) + (f" and {left} more" if left else "")


def reached_cells(view: GatewayView) -> list[tuple[Reached, tuple[str, ...]]]:
    """Return the nodes that are reached alike, each with the cells of its row.

    Cells: the list of links, its link in use, the link that reaches the nodes, their names.
    """
    in_use, names = {bond.name: bond.in_use for bond in view.bonds}, names_of(view)
    return [
        (each, (each.bond, in_use[each.bond] or NOTHING, by_words(each), nodes_words(each, names)))
        for each in reached_of(view)
    ]


def names_of(view: GatewayView) -> dict[int, str]:
    """Return the names of the nodes that a gateway knows."""
    return {view.address: view.name} | {each.address: each.name for each in view.peers}
