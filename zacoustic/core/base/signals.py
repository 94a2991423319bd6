"""Signals: somebody tells that something has happened, and does not know who has to do with it."""

from collections.abc import Callable
from typing import Generic, ParamSpec

Told = ParamSpec("Told")


class Signal(Generic[Told]):
    """One kind of event; to be called with what is told of it."""

    def __init__(self) -> None:
        self._hearers: list[Callable[Told, None]] = []

    def connect(self, hearer: Callable[Told, None]) -> None:
        """Tell somebody of each event, after those that have asked before."""
        self._hearers.append(hearer)

    def __call__(self, *args: Told.args, **keywords: Told.kwargs) -> None:
        """Tell all of them."""
        for hearer in self._hearers:
            hearer(*args, **keywords)
