"""The list `ranging`: the ranges that nodes measure periodically."""

import math

from zacoustic.config.problems import Place
from zacoustic.config.sections import ALLOWED, RangingEntry
from zacoustic.config.streams import Fleet, check_address
from zacoustic.core.peers.ranging import LEAST_PERIOD_S, LONGEST_PERIOD_S


def check_ranging(
    place: Place, entries: tuple[RangingEntry, ...], own: int, fleet: Fleet
) -> tuple[RangingEntry, ...]:
    """Check the list at `place`.

    Args:
        place: Place of the list.
        entries: Its content.
        own: Address of this node, which measures unless an entry names another.
        fleet: The nodes.

    Raises:
        ConfigError: An entry is wrong; reports the first.
    """
    seen: set[tuple[int, int]] = set()
    for index, entry in enumerate(entries):
        here = place.at(index)
        check_address(here.at("to"), entry.to, fleet)
        if entry.by is not None:
            check_address(here.at("by"), entry.by, fleet)
        by = own if entry.by is None else entry.by
        if entry.to == by:
            here.at("to").refuse(
                f"{entry.to} is the node that measures",
                allowed="another node",
                hint="say by whom, so that one file serves a fleet: by: ADDRESS"
                if entry.by is None
                else "",
            )
        if not (
            math.isfinite(entry.every_s) and LEAST_PERIOD_S <= entry.every_s <= LONGEST_PERIOD_S
        ):
            here.at("every_s").refuse(allowed=ALLOWED["every_s"])
        if (by, entry.to) in seen:
            here.at("to").refuse(f"{entry.to} a second time", allowed="each node once")
        seen.add((by, entry.to))
    return entries
