"""The verdict of a report: its one-line summary."""

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from zacoustic.app.tools.inspect.recordings.figures import Figures, StreamFigures

_NAMED: Final = 5
"""So many streams are named; the worst first."""


def verdict_of(figures: "Figures") -> list[str]:
    """Return it: what is known not to have arrived, then what was left out on purpose."""
    expected = sum(each.expected for each in figures.streams)
    delivered = sum(each.delivered for each in figures.streams)
    if not expected:
        arrived = sum(each.arrived for each in figures.streams)
        return [f"{arrived} samples arrived; what did not is not known from these recordings"]
    short = [each for each in figures.streams if each.delivered < each.expected]
    short.sort(key=lambda each: each.delivered / each.expected)
    lines = [f"everything arrived: {delivered} of {expected} samples, calls and goals"]
    if short:
        lines = [f"{expected - delivered} of {expected} did not arrive: {_named(short)}"]
    refused = sum(each.refused for each in figures.streams)
    if refused:
        whose = ", ".join(each.name for each in figures.streams if each.refused)
        lines.append(f"{refused} were refused and never sent: {whose}")
    lines += [
        f"{each.name}: {each.thinned} of {each.published} left out on purpose by min_interval_s"
        for each in figures.streams
        if each.thinned
    ]
    worst = max((link.loss for link in figures.links if link.loss is not None), default=None)
    if worst is not None:
        lines.append(f"of the frames {worst:.0%} were lost on the worst link")
    return lines


def _named(streams: "list[StreamFigures]") -> str:
    words = [
        f"{each.name} {each.expected - each.delivered} of {each.expected}"
        for each in streams[:_NAMED]
    ]
    more = len(streams) - _NAMED
    return ", ".join(words) + (f", and {more} more streams" if more > 0 else "")
