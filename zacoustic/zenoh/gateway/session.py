"""The gateway session: a running gateway, from its first declaration to its last.

Held queries get an error before anything is closed: if a session closes over an unanswered query,
the caller believes that there is no server. So the order at the end is: refuse queries, engine and
link, declarations, session.
"""

import asyncio
import logging

from zacoustic.errors import LinkClosedError
from zacoustic.run.node import PreparedNode
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.gateway.events.dispatcher import EventDispatcher
from zacoustic.zenoh.gateway.lostcontact import LostContactActions
from zacoustic.zenoh.gateway.network.network import LocalNetwork
from zacoustic.zenoh.gateway.requests import RequestHandler
from zacoustic.zenoh.gateway.status.framefeed import FrameFeed
from zacoustic.zenoh.gateway.status.health import Health
from zacoustic.zenoh.gateway.status.recent_events import Announcer
from zacoustic.zenoh.gateway.streams.handlers import StreamHandlers

_logger = logging.getLogger(__name__)


class GatewaySession:
    """A local network and an engine, joined; for the loop. `compose` makes it.

    Args:
        node: The node on the link, which measures ranges.
        runner: Runs the engine on its link; closed with the session.
        network: The local network; left with the session.
        streams: Take local input.
        requests: Takes requests to the gateway itself.
        health: Puts the health report.
        feed: Puts frames while there are subscribers.
        announcer: Emits notices.
        dispatcher: Takes the events of the engine.
        lost_contact: Acts when contact is lost.
    """

    def __init__(
        self,
        node: PreparedNode,
        runner: LinkRunner,
        network: LocalNetwork,
        *,
        streams: StreamHandlers,
        requests: RequestHandler,
        health: Health,
        feed: FrameFeed,
        announcer: Announcer,
        dispatcher: EventDispatcher,
        lost_contact: LostContactActions,
    ) -> None:
        self.runner = runner
        self.network = network
        self.failure: Exception | None = None
        self._node = node
        self._streams = streams
        self._requests = requests
        self._health = health
        self._feed = feed
        self._announcer = announcer
        self.documents = health.documents
        """Returns the current documents of the health report."""
        self._dispatcher = dispatcher
        self._lost_contact = lost_contact
        self._is_closing = False
        self._ended = asyncio.Event()

    async def open(self) -> None:
        """Become visible, open the link, declare the streams.

        After a restart, local subscribers come before the link.

        Raises:
            SessionError: Another gateway has the address.
            LinkOpenError: The link cannot be opened.
            RangeUnavailableError: The config measures ranges, and the link cannot.
        """
        await self.network.join()
        if self._node.is_restart:
            await self._streams.matching.have_returned()
        await self.runner.start(self._dispatcher.deliver, self._health.touch)
        self._streams.recover(self.runner.engine.stored)
        self._node.start_ranging(self.runner)
        await self.network.open(self._declare, self._attend)
        self._health.touch()

    async def close(self) -> None:
        """Stop in the order that leaves no caller waiting."""
        self._is_closing = True
        self.network.queries.close()
        self._streams.close()
        self._lost_contact.close()
        self._announcer.close()
        self._feed.close()
        self._health.close()
        try:
            await self.network.settle()
            await self.runner.close()
        finally:
            await self.network.leave(self._undeclare)
            self._ended.set()

    async def wait_failed(self) -> None:
        """Wait until it ends.

        Raises:
            Exception: The error that stopped it, if it was not closed.
        """
        waits = [
            asyncio.ensure_future(wait) for wait in (self.runner.wait_failed(), self._ended.wait())
        ]
        try:
            await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for wait in waits:
                wait.cancel()
            await asyncio.gather(*waits, return_exceptions=True)
        failure = self.failure or self.runner.failure
        if failure is not None:
            raise failure

    def _attend(self) -> None:
        """Process what Zenoh's threads have handed over; called on each wake-up."""
        if self._is_closing:
            return
        try:
            self.network.attend()
            self._streams.matching.settle()
            self.runner.apply(self._streams.drain)
        except LinkClosedError:
            return  # the runner has failed, and `wait_failed` reports it
        except Exception as error:  # a bug: the gateway ends and reports it
            _logger.exception("gateway %d: stopped by a fault", self.network.redundant.address)
            self.failure = error
            self._ended.set()

    def _declare(self) -> None:
        self._feed.declare()
        self._lost_contact.declare()
        self._streams.services.watch(self.network.redundant.address)
        self._requests.declare(self.network.zenoh_session, self.network.queries)

    def _undeclare(self) -> None:
        self._feed.undeclare()
        self._lost_contact.undeclare()
        self._requests.undeclare()
