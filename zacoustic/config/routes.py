"""The list `routes` and the table `relay`: frames that go over other nodes."""

from zacoustic.config.problems import Place
from zacoustic.config.sections import ALLOWED, LinkEntry, RelayEntry, RouteEntry
from zacoustic.config.streams import Fleet, check_address
from zacoustic.core.base.clock import is_duration
from zacoustic.core.base.linktypes import ONE_LINK
from zacoustic.core.relay.relay import MOST_IN_CUSTODY, RelayRules
from zacoustic.core.relay.route import MOST_NODES, Route
from zacoustic.core.streams.keys import fault_of_name
from zacoustic.core.wire.relay import FIRST_PORT, LAST_ROUTE


def read_routes(
    place: Place,
    entries: tuple[RouteEntry, ...],
    links: tuple[LinkEntry, ...],
    fleet: Fleet,
) -> tuple[Route, ...]:
    """Read the routes.

    Args:
        place: The section.
        entries: The list.
        links: The links of the file.
        fleet: The nodes.

    Raises:
        ConfigError: An entry is wrong; reports the first.
    """
    names = [each.name for each in links if each.name is not None]
    taken = {*names}
    ids: set[int] = set()
    found = []
    for index, entry in enumerate(entries):
        here = place.at("routes").at(index)
        if not 1 <= entry.id <= LAST_ROUTE or entry.id in ids:
            here.at("id").refuse(allowed=f"1..{LAST_ROUTE}, another one for each route")
        ids.add(entry.id)
        if fault_of_name(entry.name) or set("/@{}") & set(entry.name):
            here.at("name").refuse(allowed="one chunk of a key, without / @ * $ ? # { }")
        if entry.name in taken:
            here.at("name").refuse(
                f'"{entry.name}" a second time', allowed="a name that no link and no route has"
            )
        taken.add(entry.name)
        _check_path(here.at("path"), entry.path, fleet)
        if entry.link is not None and entry.link not in names:
            here.at("link").refuse(allowed=", ".join(names) or "none, no link has a name")
        if not is_duration(entry.lifetime_s, or_zero=True):
            here.at("lifetime_s").refuse(allowed=ALLOWED["lifetime_s"])
        found.append(
            Route(
                route_id=entry.id,
                name=entry.name,
                path=entry.path,
                link=entry.link or next(iter(names), ONE_LINK),
                lifetime_s=entry.lifetime_s,
            )
        )
    for index, link in enumerate(links):
        if found and link.port is not None and link.port >= FIRST_PORT:
            place.at("links").at(index).at("port").refuse(
                allowed=f"0..{FIRST_PORT - 1}: routes have the numbers above"
            )
    return tuple(found)


def read_relay(place: Place, written: RelayEntry | None) -> RelayRules:
    """Read how much the node does for the routes of others.

    Raises:
        ConfigError: A value is outside its range.
    """
    if written is None:
        return RelayRules()
    if not 0 < written.max_airtime <= 1:
        place.at("max_airtime").refuse(allowed=ALLOWED["max_airtime"])
    if not 1 <= written.queue <= MOST_IN_CUSTODY:
        place.at("queue").refuse(allowed=ALLOWED["queue"])
    return RelayRules(max_airtime=written.max_airtime, queue=written.queue)


def _check_path(place: Place, path: tuple[int, ...], fleet: Fleet) -> None:
    if not 2 <= len(path) <= MOST_NODES:
        place.refuse(allowed=f"2..{MOST_NODES} addresses, from one end to the other")
    for index, address in enumerate(path):
        check_address(place.at(index), address, fleet)
        if address in path[:index]:
            place.at(index).refuse(f"{address} a second time", allowed="each node once")
