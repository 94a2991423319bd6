"""The gateway session: an open Zenoh session, an engine and its link, joined; a running gateway.

Held queries get an error before anything is closed: a session that is closed over an unanswered
query lets the caller believe that there is no server. So the end goes: refuse queries, engine and
link, declarations, session.
"""

import asyncio
import contextlib
import logging
import random
from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import zenoh

from zacoustic.core.base.clock import Clock
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import EngineRestarted, Event, PeerFound, PeerLost
from zacoustic.core.engine.makeengine import MakeEngine
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import LinkClosedError
from zacoustic.link.contract import Link
from zacoustic.run.hostclock import HostClock
from zacoustic.run.journal import Journal, JournalState, MemoryJournal
from zacoustic.run.permitlog import PermitLog
from zacoustic.run.replacement.intact import Intact
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.gateway.commands.objects import ObjectDesk
from zacoustic.zenoh.gateway.commands.orders import OrderDesk
from zacoustic.zenoh.gateway.commands.pings import PingDesk
from zacoustic.zenoh.gateway.complaints import Complaints
from zacoustic.zenoh.gateway.dialect.dialects import Dialects
from zacoustic.zenoh.gateway.exchange import Exchange
from zacoustic.zenoh.gateway.notices import Notice, Notify, RouterChanged, SiblingsChanged
from zacoustic.zenoh.gateway.routes import Routes
from zacoustic.zenoh.gateway.siblings import Siblings
from zacoustic.zenoh.gateway.status.chronicle import Chronicle
from zacoustic.zenoh.gateway.status.dates import Dates
from zacoustic.zenoh.gateway.status.framefeed import FrameFeed
from zacoustic.zenoh.gateway.status.health import Counts, Health
from zacoustic.zenoh.gateway.status.presence import Presence
from zacoustic.zenoh.gateway.streams.actions import Actions
from zacoustic.zenoh.gateway.streams.kept import KeptSamples
from zacoustic.zenoh.gateway.streams.onlookers import Onlookers
from zacoustic.zenoh.gateway.streams.services import Services
from zacoustic.zenoh.gateway.streams.topics import Topics
from zacoustic.zenoh.session.asking.queries import QueryDesk
from zacoustic.zenoh.session.doorbell import Doorbell, tell_loop
from zacoustic.zenoh.session.session import Island

FAREWELL_LIMIT_S: Final = 3.0
"""How long the last replies may take at the end, s, and how long undeclaring may."""
# The engine tells 64 calls to one service apart; a caller that needs more than this at once on all
# services together would wait for hours on sound.
QUERIES_LIMIT: Final = 256
"""Local queries that are held at the same time."""
STOPPING_TEXT: Final = "the gateway is stopping"
"""What a caller reads whose query is held then."""

_logger = logging.getLogger(__name__)

MakeDialects = Callable[[Island, Complaints, Callable[[], None]], Dialects]
"""Makes the dialects of a session; the last argument wakes the loop."""


class Junction:
    """One session, one engine, one link; for the loop.

    Args:
        address: Acoustic address of this node.
        table: Its streams.
        island: Its session, open; closed with the junction.
        link: Its link, not open yet; closed with the junction.
        journal: Where the engine's writes go.
        state: What the journal has kept for this boot epoch.
        ranges: Nodes whose range is measured periodically, each with its period, s.
        rules: When, and how much, this node may transmit.
        permit_log: Takes each emission, or None; closed with the junction.
        dialects: Makes the local forms of streams.
        about: Its constant facts for monitors.
        notify: Told what people want to know.
        clock: Where instants come from.
        host: The clock of this computer.
        make_engine: Makes the engine.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        *,
        island: Island,
        link: Link,
        journal: Journal,
        state: JournalState,
        ranges: Mapping[int, float],
        rules: TransmitRules,
        permit_log: PermitLog | None,
        dialects: MakeDialects,
        about: Mapping[str, object],
        notify: Notify,
        clock: Clock,
        host: HostClock,
        make_engine: MakeEngine = Engine,
    ) -> None:
        self.failure: Exception | None = None
        self.siblings = Siblings(address, clock)
        self.island = island
        self._notify = notify
        self._is_closing = False
        self._has_router = True
        self._ranges = ranges
        self._ended = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._doorbell = Doorbell(self._loop, self._attend)
        ring = self._doorbell.ring

        def renew(epoch: int, stored: Mapping[str, bytes]) -> Engine:
            seed = random.SystemRandom().getrandbits(64)
            _logger.info("node %d: epoch %d, seed %d", address, epoch, seed)
            return make_engine(
                address=address,
                table=table,
                epoch=epoch,
                rng=random.Random(seed),
                stored=host.named(stored),
                rules=rules,
                trace=self._trace,
            )

        self.runner = LinkRunner(
            Intact(renew, state.boot_epoch, state.entries),
            link,
            self._deliver,
            renew=renew,
            clock=clock,
            journal=journal,
            wall_clock=host.utc_ns,
            clock_error_s=rules.clock_error_s,
            ask_clock=host.ask,
            permit_log=permit_log,
        )
        dates = Dates(clock, host.utc_ns)
        self._chronicle = Chronicle(dates.unix_s)
        self._complaints = Complaints(clock, tell=self._chronicle.complain)
        self._presence = Presence(address, table.digest.hex(), island, ring)
        self._desk = QueryDesk(island.worker, ring, limit=QUERIES_LIMIT, closed_text=STOPPING_TEXT)
        self._dialects = dialects(island, self._complaints, ring)
        self._topics = Topics(
            table,
            self.siblings,
            self._complaints,
            self._dialects,
            KeptSamples(self.runner.keep, clock=clock, wall_clock=host.utc_ns),
            clock=clock,
            ring=ring,
        )
        self._services = Services(
            table, island, self._complaints, self._dialects, clock=clock, ring=ring
        )
        self._actions = Actions(
            address,
            table,
            island,
            self._complaints,
            self._dialects,
            runner=self.runner,
            clock=clock,
        )
        self._onlookers = Onlookers(
            table, island, self.siblings, self._topics, self.runner, ring=ring
        )
        self._routes = Routes(
            table,
            island,
            self.siblings,
            topics=self._topics,
            services=self._services,
            actions=self._actions,
            onlookers=self._onlookers,
            dialects=self._dialects,
            desk=self._desk,
            runner=self.runner,
        )
        self._objects = ObjectDesk(table, self.runner)
        self._feed = FrameFeed(self.runner, island)
        self._health = Health(
            self.runner,
            island,
            objects=self._objects,
            chronicle=self._chronicle,
            about=about,
            jobs=lambda: self._routes.jobs,
            losses=self._losses,
            is_journal_kept=not isinstance(journal, MemoryJournal),
            dates=dates,
            clock=clock,
        )
        self._orders = OrderDesk(
            table, self.runner, self.siblings, clock=clock, wall_clock=host.utc_ns
        )
        self._pings = PingDesk(self.runner, self.siblings, clock=clock)
        self._own_queryables: list[zenoh.Queryable[None]] = []
        self._exchange = Exchange(
            table,
            topics=self._topics,
            services=self._services,
            actions=self._actions,
            objects=self._objects,
            health=self._health,
            orders=self._orders,
            pings=self._pings,
            detail=lambda: self.runner.link_detail,
            notify=self._tell,
        )

    async def open(self) -> None:
        """Become visible, open the link, declare the streams.

        Raises:
            SessionError: Another gateway has the address.
            LinkOpenError: The link cannot be opened.
            RangeUnavailableError: The config measures ranges, and the link cannot.
        """
        if self.island.mode == "client":
            await self.island.worker.run(lambda: self.island.watch(self._see_router))
        for address in await self._presence.declare():
            self.siblings.update(address, is_alive=True)
        await self._dialects.open()
        await self.runner.start()
        self._topics.recover(self.runner.engine.stored)
        for address, every_s in self._ranges.items():
            self.runner.apply(partial(_repeat_range, address, every_s))
        self._routes.reconcile()
        await self.island.worker.run(self._declare_own)  # and all that was to be declared
        self._health.touch()
        self._doorbell.ring()

    async def close(self) -> None:
        """Stop in the order that leaves no caller waiting."""
        self._is_closing = True
        self._desk.close()
        self._onlookers.close()
        self._feed.close()
        self._services.close()
        self._actions.close()
        self._health.close()
        try:
            await self._in_worker(lambda: None)  # all replies are out
            await self.runner.close()
        finally:
            await self._in_worker(self._undeclare)
            await self.island.close()
            self._ended.set()

    async def wait_failed(self) -> None:
        """Wait until it ends.

        Raises:
            Exception: What has stopped it, if it was not closed.
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

    def documents(self) -> dict[str, object]:
        """Return the documents of the health report as they are now."""
        return self._health.documents()

    def _attend(self) -> None:
        """Take in what Zenoh's threads have handed over; the answer to the doorbell."""
        if self._is_closing:
            return
        try:
            self._take_presence()
            if self._dialects.settle():
                self._routes.reconcile()
            for held, serve in self._desk.take():
                serve(held)
            self._onlookers.settle()
            self.runner.apply(self._exchange.drain)
        except LinkClosedError:
            return  # the runner has failed, and `wait_failed` says so
        except Exception as error:
            _logger.exception("gateway %d: stopped by a fault", self.siblings.address)
            self.failure = error
            self._ended.set()

    def _take_presence(self) -> None:
        changed = [
            self.siblings.update(address, is_alive=is_alive)
            for address, is_alive in self._presence.take().items()
        ]
        if any(changed):
            self._routes.reconcile()
            self._health.touch()
            self._tell(SiblingsChanged(addresses=self.siblings.alive))

    def _see_router(self, is_there: bool) -> None:
        """Note that the router was lost or is back; on Zenoh's thread."""
        tell_loop(self._loop, lambda: self._take_router(is_there))

    def _take_router(self, is_there: bool) -> None:
        if is_there is not self._has_router:
            self._has_router = is_there
            self._tell(RouterChanged(state="back" if is_there else "lost"))

    def _trace(self, record: TraceRecord) -> None:
        self._health.trace(record)

    def _deliver(self, event: Event) -> None:
        self._exchange.deliver(event)
        if isinstance(event, EngineRestarted):
            self._doorbell.ring()  # the island goes on
        if isinstance(event, PeerLost | PeerFound):
            is_lost = isinstance(event, PeerLost)
            if self._dialects.note_peer(event.address, is_lost=is_lost):
                self._routes.reconcile()

    def _tell(self, notice: Notice) -> None:
        self._chronicle.note(notice)
        if not self._is_closing:
            self._notify(notice)

    def _losses(self) -> Counts:
        """Useless local input, by stream and reason."""
        found = {name: dict(counts) for name, counts in self._complaints.counts.items()}
        for name, counts in self._topics.losses().items():
            found.setdefault(name, {}).update(counts)
        if self._desk.refused:
            found["queries"] = {"refused": self._desk.refused}
        if self.island.lost:
            found["session"] = {"lost": self.island.lost}
        return found

    def _declare_own(self) -> None:
        self._feed.declare()
        self._services.watch(self.runner.engine.address)
        for expression, serve, complete in (
            (self._health.expression, self._health.answer, True),
            (self._objects.key, self._objects.serve, True),
            *((key, self._orders.serve, True) for key in self._orders.own_keys),
            # Not complete: the gateway of a local node answers alone.
            *((key, self._orders.serve_beyond, False) for key in self._orders.keys_beyond),
            (self._pings.key, self._pings.serve, False),
        ):
            queryable = self.island.session.declare_queryable(
                zenoh.KeyExpr(expression),
                self.island.callback(partial(self._desk.admit, serve)),
                complete=complete,
                allowed_origin=zenoh.Locality.REMOTE,
            )
            self._own_queryables.append(queryable)

    def _undeclare(self) -> None:
        self._routes.undeclare()
        self._dialects.undeclare()
        self._presence.undeclare()
        self._feed.undeclare()
        for queryable in self._own_queryables:
            queryable.undeclare()  # type: ignore[no-untyped-call]

    async def _in_worker(self, step: Callable[[], None]) -> None:
        with contextlib.suppress(TimeoutError, zenoh.ZError):
            await self.island.worker.run(step, limit_s=FAREWELL_LIMIT_S)


def _repeat_range(address: int, every_s: float, engine: Engine, now: int) -> None:
    engine.ranging.repeat(address, every_s, now)
