"""The links of a node, and the link of each stream."""

from zacoustic.config.bonds import read_bonded
from zacoustic.config.onrmwdesert import check_access as check_access_on_desert
from zacoustic.config.problems import Place
from zacoustic.config.sections import LinkEntry, Section
from zacoustic.core.profiles.rules import LinkRules
from zacoustic.core.relay.route import Route
from zacoustic.core.schedule.access.spec import AccessSpec, AutoSpec
from zacoustic.core.streams.wireprofile import WireProfile

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
        if entry.name is None and len(entries) > 1:
            here.at("name").refuse("is missing", allowed=_NAMED)
        if entry.name is not None:
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
    place: Place, links: tuple[LinkEntry, ...], routes: tuple[Route, ...], own: int
) -> dict[int, str]:
    """Return the link, or the route that ends here, of each stream that names one.

    Args:
        place: Place of the list of streams.
        links: The links of the node: another one, if an argument overrides the file.
        routes: The routes.
        own: Address of the node.
    """
    own_names = {entry.name for entry in links}
    to_ends = {each.name: each.other_end(own) is not None for each in routes}
    found: dict[int, str] = {}
    for here in place.items:
        name, stream_id = here.at("link").written, here.at("id").written
        is_used = to_ends[name] if name in to_ends else len(links) > 1 and name in own_names
        if is_used and name is not None:
            found[stream_id] = name
    return found


def access_of(entry: LinkEntry) -> AccessSpec | None:
    """Return the medium access of a link; None: the file says nothing of it."""
    return AutoSpec() if entry.access == "auto" else entry.access


def read_link_rules(
    place: Place, written: Section, links: tuple[LinkEntry, ...], wire: WireProfile
) -> tuple[LinkRules, ...]:
    """Read the rules of transmission of each link; `--link` has those of the first.

    Args:
        place: Place of the section.
        written: The section.
        links: The links of the node.
        wire: The wire profile.
    """
    found: list[LinkRules] = []
    ports: dict[int, str] = {}
    names = list(dict.fromkeys(each.name for each in written.links))
    is_whole = all(each.owners is None for each in written.links)
    is_other = is_replaced(written.links, links)
    for index, entry in enumerate(written.links):
        here = place.at("links").at(index)
        access = access_of(entry)
        if wire is WireProfile.RMW_DESERT:
            check_access_on_desert(here.at("access"), access)
        share = written.max_airtime if entry.max_airtime is None else entry.max_airtime
        frame_s = written.max_frame_s if entry.max_frame_s is None else entry.max_frame_s
        name = entry.name or ""
        place_in_list = index if is_whole else names.index(entry.name)
        port = place_in_list if entry.port is None else entry.port
        if ports.get(port, name) != name or (is_whole and port in ports):
            here.at("port").refuse(
                f"{port} a second time",
                allowed="another one for each link, and the same at both ends",
            )
        ports[port] = name
        own = LinkRules(
            name=name,
            access=access,
            max_airtime=share,
            max_frame_s=frame_s,
            port=entry.port if is_whole else port,
            bonded=read_bonded(entry),
        )
        if entry in links or (is_other and index == 0):
            found.append(own)
    return tuple(found)
