"""The table `flood`, and streams with `flood: true`: frames that every node passes on."""

from zacoustic.config.problems import Place
from zacoustic.config.sections import FloodEntry, LinkEntry, RouteEntry
from zacoustic.core.base.linktypes import ONE_LINK
from zacoustic.core.relay.flood import FLOOD_NAME, Flood
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.wire.flood import FLOOD_PORT


def read_flood(
    place: Place,
    written: FloodEntry | None,
    links: tuple[LinkEntry, ...],
    routes: tuple[RouteEntry, ...],
    wire: WireProfile,
) -> tuple[Flood | None, dict[int, str]]:
    """Read how frames are flooded.

    Args:
        place: The section.
        written: The table.
        links: The links of the file.
        routes: Its routes.
        wire: The wire profile.

    Returns:
        How they go, None if nothing is flooded; and the link of each stream that is.

    Raises:
        ConfigError: A name or a port is that of flooding, or a stream has a link beside it.
    """
    of_streams = _flooded_streams(place, wire)
    if written is None and not of_streams:
        return None, {}
    written = written or FloodEntry()
    names = (each.name for each in links if each.name is not None)
    taken: dict[str, list[str | None]] = {
        "links": [each.name for each in links],
        "routes": [each.name for each in routes],
    }
    for key, names_there in taken.items():
        for index, name in enumerate(names_there):
            if name == FLOOD_NAME:
                place.at(key).at(index).at("name").refuse(
                    allowed=f'another name: "{FLOOD_NAME}" is that of flooded streams'
                )
    for index, link in enumerate(links):
        if link.port == FLOOD_PORT:
            place.at("links").at(index).at("port").refuse(
                allowed=f"another number: {FLOOD_PORT} is that of flooded streams"
            )
    flood = Flood(
        link=written.link or next(names, ONE_LINK),
        hops=written.hops,
        max_airtime=written.max_airtime,
    )
    return flood, of_streams


def _flooded_streams(place: Place, wire: WireProfile) -> dict[int, str]:
    found: dict[int, str] = {}
    for stream in place.at("streams").items:
        if not stream.at("flood").written:
            continue
        if wire is WireProfile.RMW_DESERT:
            stream.at("flood").refuse('on wire: "rmw_desert"', allowed='on wire: "native"')
        for key in ("link", "links", "carry"):
            if stream.at(key).written is not None:
                stream.at("flood").refuse(f"beside {key}", allowed="one of the two")
        found[stream.at("id").written] = FLOOD_NAME
    return found
