"""The list `quiet`: hours of each day in which the node transmits nothing."""

from zacoustic.config.problems import Place
from zacoustic.config.sections import QuietEntry
from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.schedule.silence import QuietWindow


def read_quiet(place: Place, entries: tuple[QuietEntry, ...]) -> tuple[QuietWindow, ...]:
    """Read the list at `place`.

    Args:
        place: Place of the list.
        entries: Its content.

    Raises:
        ConfigError: An entry ends when it begins.
    """
    windows = []
    for index, entry in enumerate(entries):
        here = place.at(index)
        begins_ns, ends_ns = _since_midnight(entry.begin), _since_midnight(entry.end)
        if begins_ns == ends_ns:
            here.at("to").refuse(
                f'"{entry.end}", when it begins',
                allowed="another time",
                hint="for a silence without end: zacoustic silence",
            )
        windows.append(QuietWindow(begins_ns, ends_ns))
    return tuple(windows)


def _since_midnight(written: str) -> int:
    hours, minutes = written.split(":")
    return (int(hours) * 60 + int(minutes)) * 60 * NS_PER_S
