"""The modelled nodes of a large fleet: one may represent several equal ones.

A frame arrives at every node, so the work of a walk grows with the square of the nodes, and a walk
with 254 of them would have to end within minutes of their start. Nodes that publish and subscribe
the same, with the same settings, differ only in phase. Of those only some are modelled, and each
*represents* several: it transmits the samples of each of them in separate frames, so the offered
traffic is complete. Frames of each node for itself (acknowledgements, confirmations, heartbeats)
are modelled once and counted for each.
"""

from collections.abc import Hashable, Iterator, Mapping
from typing import Final

from zacoustic.app.tools.design.plan.offers import Offer
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access.spec import PollingSpec, slots_of
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable

MOST_WALKED: Final = 32
"""A fleet of up to this size is modelled completely."""
_WALKED: Final = 20
"""Modelled nodes of a larger one; more if it has more different nodes."""


def members_of(
    table: StreamTable, rules: TransmitRules, settings: Mapping[int, Hashable]
) -> dict[int, tuple[int, ...]]:
    """Choose the nodes to model.

    Args:
        table: The streams.
        rules: The config's rules of transmission.
        settings: Settings of each node in the file, by address; the first node is always modelled,
            and so are relays and custodians.

    Returns:
        For each modelled node the nodes it represents, itself the first.
    """
    own: dict[int, tuple[int, ...]] = {address: (address,) for address in settings}
    is_scheduled = any(
        slots_of(each.access) is not None or isinstance(each.access, PollingSpec)
        for each in rules.of_links
    )
    if len(own) <= MOST_WALKED or is_scheduled:
        return own
    alone = {next(iter(settings)), *_named(table, rules)}
    classes: dict[Hashable, list[int]] = {}
    for address, setting in settings.items():
        role = (address if address in alone else None, setting, _part(table, address))
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
    """Let the modelled nodes transmit for those that they represent."""
    speaker = {each: walked for walked, group in members.items() for each in group}
    return [offer.spoken_by(speaker[offer.node]) for offer in offers]


def note_on(members: Mapping[int, tuple[int, ...]]) -> list[str]:
    """Return a remark on a fleet that was modelled in part."""
    nodes = sum(len(group) for group in members.values())
    if nodes == len(members):
        return []
    return [
        f"{len(members)} of {nodes} nodes were walked; each other one is equal to one of them, "
        "which transmitted its samples; acknowledgements and confirmations were counted for all, "
        "but not walked: delays leave them out"
    ]


def _named(table: StreamTable, rules: TransmitRules) -> Iterator[int]:
    """Yield the nodes that do something for others: those of routes, and custodians."""
    for route in rules.routes:
        yield from route.path
    for stream in table.carried:
        if isinstance(stream.spec, TopicSpec) and stream.spec.carry is not None:
            yield from stream.spec.carry.by


def _part(table: StreamTable, address: int) -> Hashable:
    """Return the role of a node in each stream."""
    return tuple(
        (
            stream.may_publish(address),
            stream.may_subscribe(address),
            getattr(stream.spec, "server", None) == address,
        )
        for stream in table
    )
