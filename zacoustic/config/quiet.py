"""The list `quiet`: hours of each day in which the node transmits nothing."""

import re
from typing import Final

from zacoustic.config.problems import Place
from zacoustic.config.sections import QuietEntry
from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.schedule.silence import QuietWindow

_TIME: Final = re.compile(r"([01][0-9]|2[0-3]):([0-5][0-9])")
_TIME_ALLOWED: Final = 'a time of day in UTC, "00:00" to "23:59"'


def read_quiet(place: Place, entries: tuple[QuietEntry, ...]) -> tuple[QuietWindow, ...]:
    """Read the list at `place`.

    Args:
        place: Place of the list.
        entries: Its content.

    Raises:
        ConfigError: An entry is wrong; reports the first.
    """
    windows = []
    for index, entry in enumerate(entries):
        here = place.at(index)
        begins_ns = _since_midnight(here.at("from"), entry.begin)
        ends_ns = _since_midnight(here.at("to"), entry.end)
        if begins_ns == ends_ns:
            here.at("to").refuse(
                f'"{entry.end}", when it begins',
                allowed="another time",
                hint="for a silence without end: zacoustic silence",
            )
        windows.append(QuietWindow(begins_ns, ends_ns))
    return tuple(windows)


def _since_midnight(place: Place, written: str) -> int:
    found = _TIME.fullmatch(written)
    if found is None:
        place.refuse(allowed=_TIME_ALLOWED)
    return (int(found[1]) * 60 + int(found[2])) * 60 * NS_PER_S
