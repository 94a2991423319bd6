"""The list `routes`: frames that go over other nodes."""

from zacoustic.config.problems import Place
from zacoustic.config.sections import LinkEntry, RouteEntry
from zacoustic.core.base.linktypes import ONE_LINK
from zacoustic.core.relay.route import Route
from zacoustic.core.wire.relay import FIRST_PORT


def read_routes(
    place: Place, entries: tuple[RouteEntry, ...], links: tuple[LinkEntry, ...]
) -> tuple[Route, ...]:
    """Read the routes.

    Args:
        place: The section.
        entries: The list.
        links: The links of the file.

    Raises:
        ConfigError: An entry is wrong; reports the first.
    """
    names = [each.name for each in links if each.name is not None]
    found = []
    for index, entry in enumerate(entries):
        here = place.at("routes").at(index)
        if entry.name in names:
            here.at("name").refuse(
                f'"{entry.name}" a second time', allowed="a name that no link and no route has"
            )
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
