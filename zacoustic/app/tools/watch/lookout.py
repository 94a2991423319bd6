"""The lookout: keeps a watch open while a page is served, with a history of each gateway.

A page is left open for days: it reports a missing router, and the lookout tries again.
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
    """The data of the page.

    Args:
        make: Makes a watch; on the loop.
        where: What it watches, for people.
        node: Address of the only gateway to show; None: all.
    """

    def __init__(self, make: Callable[[], Watch], where: str, node: int | None = None) -> None:
        self.board = Board()
        """The newest documents."""
        self.histories: dict[int, History] = {}
        """The utilisation of each gateway."""
        self.trouble = "connecting"
        """Why nothing is received; empty: no reason known."""
        self.where = where
        self._make = make
        self._node = node

    def addresses(self) -> list[int]:
        """Return the addresses of the gateways to show, in order."""
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
