"""The lists `links` of streams, and `default_links`: several links used as one."""

from zacoustic.config.problems import Place
from zacoustic.config.sections import LinkEntry, RouteEntry
from zacoustic.core.bond.spec import Bond, BondLink, LinkCost, Tariff
from zacoustic.core.relay.route import Route
from zacoustic.core.wire.relay import LAST_ROUTE


class Bonds:
    """The bonds of one file: one for each list of two or more links.

    All nodes have the same lists in the same order, so they give each bond the same number: the
    highest that no route has, and so on downwards.

    Args:
        routes: The routes of the file.
    """

    def __init__(self, routes: tuple[Route, ...]) -> None:
        taken = {each.route_id for each in routes}
        self._free = [each for each in range(LAST_ROUTE, 0, -1) if each not in taken]
        self._found: dict[tuple[str, ...], Bond] = {}

    @property
    def found(self) -> tuple[Bond, ...]:
        """The bonds so far."""
        return tuple(self._found.values())

    def name_of(self, place: Place) -> str:
        """Return the name of the link, or bond, that the list at a place stands for.

        Raises:
            ConfigError: It is one list too many.
        """
        names = tuple(place.written)
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
    place: Place, routes: tuple[Route, ...], *, is_in_use: bool
) -> tuple[tuple[Bond, ...], dict[int, str], str]:
    """Read the lists of links of a section.

    Args:
        place: Place of the section.
        routes: The routes of the file.
        is_in_use: Whether the node has these links; with another one by argument it has not.

    Returns:
        The bonds, the link or bond of each stream that has a list, and that of all others; empty:
        the first link.

    Raises:
        ConfigError: There are too many lists, or a stream has both `link` and `links`.
    """
    bonds = Bonds(routes)
    default, of_streams = "", {}
    here = place.at("default_links")
    if here.written is not None:
        default = bonds.name_of(here)
    for stream in place.at("streams").items:
        if stream.at("links").written is None:
            continue
        if stream.at("link").written is not None:
            stream.at("links").refuse("beside link", allowed="one of the two")
        of_streams[stream.at("id").written] = bonds.name_of(stream.at("links"))
    return (bonds.found, of_streams, default) if is_in_use else ((), {}, "")


def read_bonded(entry: LinkEntry | RouteEntry) -> BondLink:
    """Return how bonds treat a link or route."""
    cost = (entry.cost if isinstance(entry, LinkEntry) else None) or LinkCost.AIRTIME
    return BondLink(
        cost=LinkCost.MONEY if isinstance(cost, Tariff) else cost,
        tariff=cost if isinstance(cost, Tariff) else None,
        probe_s=entry.probe_s or 0.0,
        down_after_s=entry.down_after_s or 0.0,
    )
