"""The links of a node, and the link of each stream."""

from typing import Final

from zacoustic.config.access import read_access
from zacoustic.config.bonds import read_bonded
from zacoustic.config.later import check_word
from zacoustic.config.onrmwdesert import check_access as check_access_on_desert
from zacoustic.config.problems import Place
from zacoustic.config.sections import ALLOWED, LinkEntry, Section
from zacoustic.config.streams import Fleet, check_address
from zacoustic.core.profiles.rules import LinkRules
from zacoustic.core.relay.route import Route
from zacoustic.core.streams.keys import fault_of_name
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.wire.seal import LAST_PORT

_FRAME_S: Final = (0.5, 600.0)
"""The shortest and longest bound of a frame's airtime, s."""
_NAMED = 'a name of its own, such as "acoustic" or "radio"'


def read_links(
    place: Place, entries: tuple[LinkEntry, ...], locator: str | None, own: int
) -> tuple[LinkEntry, ...]:
    """Check the links; return those of the node.

    Args:
        place: Place of the list.
        entries: Its content.
        locator: Overrides the whole list: all streams go by this link.
        own: Address of the node.
    """
    names: dict[str, set[int]] = {}
    for index, entry in enumerate(entries):
        here = place.at(index)
        check_word(here.at("wire"), entry.wire, tuple(each.value for each in WireProfile))
        if "/" not in entry.locator.partition("#")[0].lstrip("/"):
            here.at("locator").refuse(allowed='NAME/ADDRESS, such as "sim/127.0.0.1:7000"')
        if entry.name is None and len(entries) > 1:
            here.at("name").refuse("is missing", allowed=_NAMED)
        if entry.name is not None:
            if fault_of_name(entry.name) or set("/@{}") & set(entry.name):
                here.at("name").refuse(allowed="one chunk of a key, without / @ * $ ? # { }")
            others = names.setdefault(entry.name, set())
            owners = set(entry.owners) if entry.owners is not None else set(range(1, 255))
            if owners & others:
                here.at("name").refuse(f'"{entry.name}" a second time', allowed=_NAMED)
            others |= owners
        if len(entries) > 1 and entry.wire != WireProfile.NATIVE.value:
            here.at("wire").refuse(
                f'"{entry.wire}" with {len(entries)} links',
                allowed=f'"{WireProfile.NATIVE.value}", or one link',
            )
    if locator is None:
        mine = tuple(each for each in entries if each.owners is None or own in each.owners)
        if entries and not mine:
            place.refuse(f"none is for node {own}", allowed="at least one link for each node")
        return mine
    wire = entries[0].wire if entries else WireProfile.NATIVE.value
    return (LinkEntry(locator=locator, wire=wire),)


def is_replaced(entries: tuple[LinkEntry, ...], links: tuple[LinkEntry, ...]) -> bool:
    """Return whether an argument gives the node another link, which has no name.

    Args:
        entries: The links of the file.
        links: Those of the node.
    """
    return bool(entries) and not any(each in entries for each in links)


def read_links_of_streams(
    place: Place,
    entries: tuple[LinkEntry, ...],
    links: tuple[LinkEntry, ...],
    routes: tuple[Route, ...],
    own: int,
) -> dict[int, str]:
    """Return the link, or the route that ends here, of each stream that names one.

    Args:
        place: Place of the list of streams.
        entries: The links of the file.
        links: The links of the node: another one, if an argument overrides the file.
        routes: The routes.
        own: Address of the node.
    """
    names = list(dict.fromkeys(entry.name for entry in entries if entry.name is not None))
    own_names = {entry.name for entry in links}
    to_ends = {each.name: each.other_end(own) is not None for each in routes}
    found: dict[int, str] = {}
    for index, _ in enumerate(place.entries):
        here = place.at(index)
        name, stream_id = here.at("link").written, here.at("id").written
        if name is None:
            continue
        if name not in names and name not in to_ends:
            here.at("link").refuse(
                allowed=", ".join((*names, *to_ends)) or "none, no link has a name",
                hint="give the links of the file a name each",
            )
        is_used = to_ends[name] if name in to_ends else len(links) > 1 and name in own_names
        if is_used and isinstance(name, str) and isinstance(stream_id, int):
            found[stream_id] = name
    return found


def _check_frame(place: Place, max_frame_s: float | None) -> None:
    if max_frame_s is not None and not _FRAME_S[0] <= max_frame_s <= _FRAME_S[1]:
        place.at("max_frame_s").refuse(allowed=ALLOWED["max_frame_s"])


def read_link_rules(
    place: Place, written: Section, links: tuple[LinkEntry, ...], fleet: Fleet
) -> tuple[LinkRules, ...]:
    """Read the rules of transmission of each link; `--link` has those of the first.

    Args:
        place: Place of the section.
        written: The section.
        links: The links of the node.
        fleet: The nodes.
    """
    if written.max_airtime is not None and not 0 < written.max_airtime <= 1:
        place.at("max_airtime").refuse(allowed=ALLOWED["max_airtime"])
    _check_frame(place, written.max_frame_s)
    found: list[LinkRules] = []
    ports: dict[int, str] = {}
    names = list(dict.fromkeys(each.name for each in written.links))
    is_whole = all(each.owners is None for each in written.links)
    is_other = is_replaced(written.links, links)
    for index, entry in enumerate(written.links):
        here = place.at("links").at(index)
        access = read_access(here.at("access"), entry.access, fleet.nodes)
        if fleet.wire is WireProfile.RMW_DESERT:
            check_access_on_desert(here.at("access"), access)
        share = entry.max_airtime
        if share is not None and not 0 < share <= 1:
            here.at("max_airtime").refuse(allowed=ALLOWED["max_airtime"])
        share = written.max_airtime if share is None else share
        _check_frame(here, entry.max_frame_s)
        frame_s = written.max_frame_s if entry.max_frame_s is None else entry.max_frame_s
        if entry.port is not None and not 0 <= entry.port <= LAST_PORT:
            here.at("port").refuse(allowed=ALLOWED["port"])
        name = entry.name or ""
        place_in_list = index if is_whole else names.index(entry.name)
        port = place_in_list if entry.port is None else entry.port
        if ports.get(port, name) != name or (is_whole and port in ports):
            here.at("port").refuse(f"{port} a second time", allowed=ALLOWED["port"])
        ports[port] = name
        for number, address in enumerate(entry.owners or ()):
            check_address(here.at("owners").at(number), address, fleet)
        bonded = read_bonded(here, entry)
        own = LinkRules(
            name=name,
            access=access,
            max_airtime=share,
            max_frame_s=frame_s,
            port=entry.port if is_whole else port,
            bonded=bonded,
        )
        if entry in links or (is_other and index == 0):
            found.append(own)
    return tuple(found)
