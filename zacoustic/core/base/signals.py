"""Signals: a component announces that something has happened, without knowing who acts on it."""

from collections.abc import Callable
from typing import Generic, ParamSpec

Told = ParamSpec("Told")


class Signal(Generic[Told]):
    """One kind of event; call it with the event's arguments."""

    def __init__(self) -> None:
        self._hearers: list[Callable[Told, None]] = []

    def connect(self, hearer: Callable[Told, None]) -> None:
        """Call a hearer for each event, after those that were connected before."""
        self._hearers.append(hearer)

    def __call__(self, *args: Told.args, **keywords: Told.kwargs) -> None:
        """Call all hearers."""
        for hearer in self._hearers:
            hearer(*args, **keywords)
