"""`Dispatcher`: hands each event of an engine to those who take its type."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, get_args

from zacoustic.core.engine.events import Event

Take = Callable[[Any], object]
"""Takes an event of one type."""


class Dispatcher:
    """Hands on events; for the loop.

    Args:
        takers: The takers of each type, in order; none: nobody needs it.
    """

    def __init__(self, takers: Mapping[type[Any], Iterable[Take]]) -> None:
        forgotten = set(get_args(Event)) - takers.keys()
        assert not forgotten, f"nobody takes {forgotten}"
        self._takers = {kind: tuple(each) for kind, each in takers.items()}

    def deliver(self, event: Event) -> None:
        """Take an event of the engine."""
        for take in self._takers.get(type(event), ()):  # a transport's own events have no taker
            take(event)
