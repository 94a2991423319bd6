"""`LocalNetwork`: the gateway's declarations on its local network, and its view of it."""

import asyncio
import contextlib
from collections.abc import Callable
from typing import Final

import zenoh

from zacoustic.core.engine.events import EngineRestarted, PeerFound, PeerLost
from zacoustic.run.inbox import WakeUp, tell_loop
from zacoustic.zenoh.gateway.dialect.dialects import Dialects
from zacoustic.zenoh.gateway.network.presence import Presence
from zacoustic.zenoh.gateway.network.routes import Routes
from zacoustic.zenoh.gateway.notices import Notify, notice
from zacoustic.zenoh.gateway.redundant import RedundantGateways
from zacoustic.zenoh.session.asking.queries import QueryHandler
from zacoustic.zenoh.session.session import ZenohSession

FAREWELL_LIMIT_S: Final = 3.0
"""Time limit for the last replies at the end, and for undeclaring, s."""


class LocalNetwork:
    """The local network of one gateway; for the loop.

    Args:
        zenoh_session: Its session, open.
        wake_up: Wakes the loop.
        redundant: The gateways there.
        dialects: The local forms of streams.
        routes: The declarations of streams.
        queries: Takes queries.
        tell: Takes notices about the router and other gateways.
    """

    def __init__(
        self,
        zenoh_session: ZenohSession,
        wake_up: WakeUp,
        *,
        redundant: RedundantGateways,
        dialects: Dialects,
        routes: Routes,
        queries: QueryHandler,
        tell: Notify,
    ) -> None:
        self.zenoh_session = zenoh_session
        self.redundant = redundant
        self.queries = queries
        self._wake_up = wake_up
        self._dialects = dialects
        self._routes = routes
        self._tell = tell
        self._has_router = True
        self._loop = asyncio.get_running_loop()
        digest = routes.table.digest.hex()
        self._presence = Presence(redundant.address, digest, zenoh_session, wake_up.ring)

    async def join(self) -> None:
        """Become visible.

        Raises:
            SessionError: Another gateway has the address.
        """
        if self.zenoh_session.mode == "client":
            await self.zenoh_session.worker.run(lambda: self.zenoh_session.watch(self._see_router))
        for address in await self._presence.declare():
            self.redundant.update(address, is_alive=True)
        await self._dialects.open()

    async def open(self, declare: Callable[[], None], attend: Callable[[], None]) -> None:
        """Declare the streams.

        Args:
            declare: Makes further declarations, in the worker.
            attend: Called on the loop when there is something to process.
        """
        self._routes.reconcile()
        await self.zenoh_session.worker.run(declare)  # behind all declarations submitted so far
        self._wake_up.open(attend)
        self._wake_up.ring()

    def attend(self) -> None:
        """Process observations of Zenoh's threads, and the queries."""
        changed = [
            self.redundant.update(address, is_alive=is_alive)
            for address, is_alive in self._presence.take().items()
        ]
        if any(changed):
            self._routes.reconcile()
            alive = self.redundant.alive
            words = f"gateways on this network: {', '.join(map(str, alive))}"
            self._tell(notice("redundant", words, addresses=alive))
        if self._dialects.settle():
            self._routes.reconcile()
        self.queries.serve()

    def note_peer(self, event: PeerLost | PeerFound) -> None:
        """Note that a node was lost or is back, and its programs with it."""
        if self._dialects.note_peer(event.address, is_lost=isinstance(event, PeerLost)):
            self._routes.reconcile()

    def go_on(self, event: EngineRestarted) -> None:
        """Process what waited while there was no engine."""
        self._wake_up.ring()

    async def settle(self) -> None:
        """Wait until all replies are sent, up to a time limit."""
        await self._in_worker(lambda: None)

    async def leave(self, undeclare: Callable[[], None]) -> None:
        """Undeclare everything, and close the session.

        Args:
            undeclare: Undeclares the further declarations, in the worker.
        """

        def undeclare_all() -> None:
            self._routes.undeclare()
            self._dialects.undeclare()
            self._presence.undeclare()
            undeclare()

        await self._in_worker(undeclare_all)
        await self.zenoh_session.close()

    def _see_router(self, is_there: bool) -> None:
        """Note that the router was lost or is back; on Zenoh's thread."""
        tell_loop(self._loop, lambda: self._take_router(is_there))

    def _take_router(self, is_there: bool) -> None:
        if is_there is not self._has_router:
            self._has_router = is_there
            state = "back" if is_there else "lost"
            self._tell(notice("router", state, is_trouble=not is_there, state=state))

    async def _in_worker(self, step: Callable[[], None]) -> None:
        with contextlib.suppress(TimeoutError, zenoh.ZError):
            await self.zenoh_session.worker.run(step, limit_s=FAREWELL_LIMIT_S)
