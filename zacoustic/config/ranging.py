"""The list `ranging`: the ranges that nodes measure periodically."""

from zacoustic.config.problems import Place
from zacoustic.config.sections import RangingEntry


def check_ranging(
    place: Place, entries: tuple[RangingEntry, ...], own: int
) -> tuple[RangingEntry, ...]:
    """Check the list at `place`.

    Args:
        place: Place of the list.
        entries: Its content.
        own: Address of this node, which measures unless an entry names another.

    Raises:
        ConfigError: An entry is wrong; reports the first.
    """
    seen: set[tuple[int, int]] = set()
    for index, entry in enumerate(entries):
        here = place.at(index)
        by = own if entry.by is None else entry.by
        if entry.to == by:
            here.at("to").refuse(
                f"{entry.to} is the node that measures",
                allowed="another node",
                hint="say by whom, so that one file serves a fleet: by: ADDRESS"
                if entry.by is None
                else "",
            )
        if (by, entry.to) in seen:
            here.at("to").refuse(f"{entry.to} a second time", allowed="each node once")
        seen.add((by, entry.to))
    return entries
