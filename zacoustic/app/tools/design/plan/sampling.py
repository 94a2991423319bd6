"""Which nodes of a large fleet are walked: one may stand for several that are equal.

A frame arrives at every node, so the work of a walk grows with the square of the nodes, and with
254 of them it would end within the first minutes of their start. Nodes that publish and subscribe
the same, with the same settings, are equal but for their phase. Of those some are walked, each of
which *stands for* several: it transmits the samples of each of them, in frames of their own, so
what is offered to the channel is whole. What each node transmits by itself (acknowledgements,
confirmations, heartbeats) is walked once and counted for each.
"""

from collections.abc import Hashable, Mapping
from typing import Final

from zacoustic.app.tools.design.plan.offers import Offer
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access.spec import ClockedSpec, PollingSpec
from zacoustic.core.streams.table import StreamTable

MOST_WALKED: Final = 32
"""A fleet of so many nodes is walked whole."""
_WALKED: Final = 20
"""Of a larger one; more if it has more different nodes."""


def members_of(
    table: StreamTable, rules: TransmitRules, settings: Mapping[int, Hashable]
) -> dict[int, tuple[int, ...]]:
    """Choose the nodes to walk.

    Args:
        table: The streams.
        rules: The config's rules of transmission.
        settings: What the file says of each node, by address; the first node is never stood for.

    Returns:
        For each node to walk the nodes it stands for, itself the first.
    """
    own: dict[int, tuple[int, ...]] = {address: (address,) for address in settings}
    is_scheduled = any(
        isinstance(each.access, ClockedSpec | PollingSpec) for each in rules.of_links
    )
    if len(own) <= MOST_WALKED or is_scheduled:
        return own
    first = next(iter(settings))
    classes: dict[Hashable, list[int]] = {}
    for address, setting in settings.items():
        role = (address == first, setting, _part(table, address))
        classes.setdefault(role, []).append(address)
    left = max(0, _WALKED - len(classes))
    others = len(own) - len(classes)
    members: dict[int, tuple[int, ...]] = {}
    for equal in classes.values():
        walked = 1 + round(left * (len(equal) - 1) / others) if others else 1
        for index in range(walked):
            group = equal[index::walked]
            members[group[0]] = tuple(group)
    return dict(sorted(members.items())) if len(members) <= MOST_WALKED else own


def spoken(offers: list[Offer], members: Mapping[int, tuple[int, ...]]) -> list[Offer]:
    """Let the nodes that are walked speak for those that they stand for."""
    speaker = {each: walked for walked, group in members.items() for each in group}
    return [offer.spoken_by(speaker[offer.node]) for offer in offers]


def note_on(members: Mapping[int, tuple[int, ...]]) -> list[str]:
    """Return what to say about a fleet that was not walked whole."""
    nodes = sum(len(group) for group in members.values())
    if nodes == len(members):
        return []
    return [
        f"{len(members)} of {nodes} nodes were walked; each other one is equal to one of them, "
        "which transmitted its samples; acknowledgements and confirmations were counted for all, "
        "but not walked: delays leave them out"
    ]


def _part(table: StreamTable, address: int) -> Hashable:
    """Return what a node has to do with each stream."""
    return tuple(
        (
            stream.may_publish(address),
            stream.may_subscribe(address),
            getattr(stream.spec, "server", None) == address,
        )
        for stream in table
    )
