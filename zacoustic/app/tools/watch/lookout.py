"""The lookout: keeps a watch open for as long as a page is served, and a history of each gateway.

A page is left open for days: a router that is not there, or not any more, is said on it and tried
again.
"""

import asyncio
import contextlib
from collections.abc import Callable
from typing import Final

from zacoustic.app.tools.watch.board import Board
from zacoustic.app.tools.watch.history import STEP_S, History
from zacoustic.app.tools.watch.watching import Watch
from zacoustic.errors import SessionError
from zacoustic.zenoh.session.session import WORDS

RETRY_S: Final = 5.0
"""Time between two attempts to reach the router, s."""


class Lookout:
    """What the page shows.

    Args:
        make: Makes a watch; on the loop.
        where: What it watches, for people.
        node: Address of the only gateway that is wanted; None: all.
    """

    def __init__(self, make: Callable[[], Watch], where: str, node: int | None = None) -> None:
        self.board = Board()
        """What is known."""
        self.histories: dict[int, History] = {}
        """How much each gateway was on the air."""
        self.trouble = "connecting"
        """Why nothing is heard; empty: something may be."""
        self.where = where
        self._make = make
        self._node = node

    def addresses(self) -> list[int]:
        """Return the gateways that are shown, in order."""
        return [each for each in self.board.addresses() if self._node in (None, each)]

    async def run(self) -> None:
        """Watch, until it is cancelled."""
        while True:
            try:
                async with self._make() as watch:
                    self.board = watch.board
                    while True:
                        self.trouble = "" if watch.is_connected else WORDS[False]
                        self.note()
                        with contextlib.suppress(TimeoutError):
                            async with asyncio.timeout(STEP_S):
                                watch.changed.clear()
                                await watch.changed.wait()
            except SessionError as error:
                self.trouble = str(error)
            await asyncio.sleep(RETRY_S)

    def note(self) -> None:
        """Add a point to each history."""
        for address in self.addresses():
            self.histories.setdefault(address, History()).note(self.board.view(address))
