"""The lists `links` of streams, and `default_links`: several links used as one."""

from typing import Any

import msgspec

from zacoustic.config.problems import Place, shown
from zacoustic.config.sections import ALLOWED, LinkEntry, RouteEntry
from zacoustic.core.base.clock import DURATIONS, is_duration
from zacoustic.core.bond.spec import Bond, BondLink, LinkCost, Tariff
from zacoustic.core.relay.route import Route
from zacoustic.core.wire.relay import LAST_ROUTE
from zacoustic.errors import ConfigError


class Bonds:
    """The bonds of one file: one for each list of two or more links.

    All nodes have the same lists in the same order, so they give each bond the same number: the
    highest that no route has, and so on downwards.

    Args:
        links: The links of the file.
        routes: The routes of the file.
    """

    def __init__(self, links: tuple[LinkEntry, ...], routes: tuple[Route, ...]) -> None:
        names = [each.name for each in links if each.name is not None]
        self._names = list(dict.fromkeys([*names, *(each.name for each in routes)]))
        taken = {each.route_id for each in routes}
        self._free = [each for each in range(LAST_ROUTE, 0, -1) if each not in taken]
        self._found: dict[tuple[str, ...], Bond] = {}

    @property
    def found(self) -> tuple[Bond, ...]:
        """The bonds so far."""
        return tuple(self._found.values())

    def name_of(self, place: Place, written: object) -> str:
        """Return the name of the link, or bond, that a list stands for.

        Raises:
            ConfigError: It names no links, or one twice.
        """
        allowed = ", ".join(self._names) or "none, no link has a name"
        if not isinstance(written, list | tuple) or not written:
            place.refuse(allowed=f"a list of links: {allowed}")
        for index, each in enumerate(written):
            if each not in self._names:
                place.at(index).refuse(allowed=allowed, hint="give the links a name each")
            if each in written[:index]:
                place.at(index).refuse(f'"{each}" a second time', allowed="each link once")
        names = tuple(written)
        if len(names) == 1:
            return str(names[0])
        if names not in self._found:
            if not self._free:
                place.refuse(
                    "one list too many", allowed=f"{LAST_ROUTE} different lists and routes"
                )
            self._found[names] = Bond(number=self._free.pop(0), links=names)
        return self._found[names].name


def read_bonds(
    place: Place, links: tuple[LinkEntry, ...], routes: tuple[Route, ...], *, is_in_use: bool
) -> tuple[tuple[Bond, ...], dict[int, str], str]:
    """Read the lists of links of a section.

    Args:
        place: Place of the section.
        links: The links of the file.
        routes: The routes of the file.
        is_in_use: Whether the node has these links; with another one by argument it has not.

    Returns:
        The bonds, the link or bond of each stream that has a list, and that of all others; empty:
        the first link.

    Raises:
        ConfigError: A list is wrong, or a stream has both `link` and `links`.
    """
    bonds = Bonds(links, routes)
    default, of_streams = "", {}
    here = place.at("default_links")
    if here.written is not None:
        default = bonds.name_of(here, here.written)
    for index, _ in enumerate(place.at("streams").entries):
        stream = place.at("streams").at(index)
        written, stream_id = stream.at("links").written, stream.at("id").written
        if written is None:
            continue
        if stream.at("link").written is not None:
            stream.at("links").refuse("beside link", allowed="one of the two")
        name = bonds.name_of(stream.at("links"), written)
        if isinstance(stream_id, int):
            of_streams[stream_id] = name
    return (bonds.found, of_streams, default) if is_in_use else ((), {}, "")


def read_bonded(place: Place, entry: LinkEntry | RouteEntry) -> BondLink:
    """Read how bonds treat a link or route.

    Raises:
        ConfigError: A value is outside its range.
    """
    cost, tariff = LinkCost.AIRTIME, None
    if isinstance(entry, LinkEntry) and entry.cost is not None:
        cost, tariff = _read_cost(place.at("cost"), entry.cost)
    for name in ("probe_s", "down_after_s"):
        value = getattr(entry, name)
        if value is not None and not is_duration(value):
            place.at(name).refuse(allowed=DURATIONS)
    return BondLink(
        cost=cost,
        tariff=tariff,
        probe_s=entry.probe_s or 0.0,
        down_after_s=entry.down_after_s or 0.0,
    )


def _read_cost(place: Place, written: str | dict[str, Any]) -> tuple[LinkCost, Tariff | None]:
    """Read what frames cost: a word, or a price."""
    if not isinstance(written, dict):
        costs = {each.value: each for each in LinkCost}
        if written not in costs:
            place.refuse(allowed=ALLOWED["cost"])
        return costs[written], None
    try:
        return LinkCost.MONEY, msgspec.convert(written, Tariff, strict=True)
    except (ConfigError, msgspec.ValidationError) as error:
        place.refuse(f"{shown(written)}: {error}", allowed=ALLOWED["cost"])
