"""Short views of many gateways, nodes and streams: faults first, and one line for the rest.

In a fleet of forty each gateway has forty rows of nodes, and there are forty gateways if their
local networks are joined. Nobody reads that. Up to a number everything is shown in order; above it
only what needs attention, and the number of the others.
"""

from collections.abc import Sequence
from typing import Final

from zacoustic.app.tools.watch.views import GatewayView, PeerView, StreamView
from zacoustic.app.tools.watch.words import (
    LOSING,
    is_well,
    time_words,
    trouble_words,
    troubled_first,
)

MOST_GATEWAYS: Final = 6
"""Most gateways shown in full, those with faults first."""
MOST_PEERS: Final = 12
"""Of more nodes only those with a fault are shown one by one."""
MOST_TROUBLED: Final = 24
"""Most nodes or gateways with a fault to show."""
MOST_STREAMS: Final = 40
"""Most streams to show, those with faults first."""


def gateways_in_short(
    views: Sequence[GatewayView],
) -> tuple[list[GatewayView], list[GatewayView], str]:
    """Return the gateways to show in full, those to show as a row, and words for the rest."""
    if len(views) <= MOST_GATEWAYS:
        return list(views), [], ""
    ranked = sorted(views, key=_gateway_rank)
    whole, others = ranked[:MOST_GATEWAYS], ranked[MOST_GATEWAYS:]
    troubled = [each for each in others if _gateway_rank(each)[0] < _FINE]
    shown = troubled[:MOST_TROUBLED]
    left = len(others) - len(shown)
    amiss = len(troubled) - len(shown)
    words = f"and {left} gateways" + (f", {amiss} of them with troubles" if amiss else ", all well")
    return whole, shown, words if left else ""


def peers_in_short(
    peers: Sequence[PeerView], *, is_complete: bool = False
) -> tuple[list[PeerView], str]:
    """Return the nodes to show, and words for the rest; empty: there is none."""
    if is_complete or len(peers) <= MOST_PEERS:
        return list(peers), ""
    troubled = [each for each in peers if not _is_well(each)]
    well = [each for each in peers if _is_well(each)]
    shown, more = troubled[:MOST_TROUBLED], troubled[MOST_TROUBLED:]
    words = [f"{len(more)} more nodes with troubles"] if more else []
    if well:
        longest_s = max(each.heard_ago_s or 0.0 for each in well)
        words.append(f"well: {len(well)} nodes, each heard in the last {time_words(longest_s)}")
    return shown, "; ".join(words)


def streams_in_short(streams: Sequence[StreamView]) -> tuple[list[StreamView], str]:
    """Return the streams to show, and words for the rest; empty: there is none."""
    left = len(streams) - MOST_STREAMS
    if left <= 0:
        return list(streams), ""
    return troubled_first(streams)[:MOST_STREAMS], f"and {left} streams"


_FINE: Final = 2


def _gateway_rank(view: GatewayView) -> tuple[int, int]:
    if not is_well(view):
        return 0, view.address
    amiss = any(not _is_well(each) for each in view.peers if each.heard_ago_s is not None)
    return 1 if amiss else _FINE, view.address


def _is_well(peer: PeerView) -> bool:
    is_heard = peer.heard_ago_s is not None
    return is_heard and (peer.per or 0) <= LOSING and not trouble_words(peer)
