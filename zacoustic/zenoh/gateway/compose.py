"""Composition of a gateway session: its parts, what they need, and their order.

Each part is made from parts that already exist, and none is changed afterwards. Two things follow
later, when the session opens: the events of the engine, which is made first, and the wake-up of the
loop.
"""

import asyncio
from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from zacoustic.config.lostcontact import LostContactAction
from zacoustic.core.base.trace import TraceRecord
from zacoustic.run.inbox import WakeUp
from zacoustic.run.journal import MemoryJournal
from zacoustic.run.node import PreparedNode
from zacoustic.run.pending import CallEnd, Pending
from zacoustic.status.node import NodeDocument
from zacoustic.zenoh.gateway.dialect.dialects import Dialects
from zacoustic.zenoh.gateway.events.dispatcher import EventDispatcher
from zacoustic.zenoh.gateway.inputerrors import InputErrors
from zacoustic.zenoh.gateway.lostcontact import LostContactActions
from zacoustic.zenoh.gateway.network.network import LocalNetwork
from zacoustic.zenoh.gateway.network.routes import Routes
from zacoustic.zenoh.gateway.notices import Notify
from zacoustic.zenoh.gateway.redundant import RedundantGateways
from zacoustic.zenoh.gateway.requests import RequestHandler
from zacoustic.zenoh.gateway.session import GatewaySession
from zacoustic.zenoh.gateway.status.channel import FrameLog
from zacoustic.zenoh.gateway.status.dates import Dates
from zacoustic.zenoh.gateway.status.documents.dropped import Dropped
from zacoustic.zenoh.gateway.status.documents.link import LinkStatus
from zacoustic.zenoh.gateway.status.documents.objects import Objects
from zacoustic.zenoh.gateway.status.documents.peers import PeerTable
from zacoustic.zenoh.gateway.status.documents.streams import StreamStatus
from zacoustic.zenoh.gateway.status.framefeed import FrameFeed
from zacoustic.zenoh.gateway.status.health import Health
from zacoustic.zenoh.gateway.status.peer_status import PeerStatus
from zacoustic.zenoh.gateway.status.recent_events import Announcer, RecentEvents
from zacoustic.zenoh.gateway.status.traffic import Traffic
from zacoustic.zenoh.gateway.streams.actions import Actions
from zacoustic.zenoh.gateway.streams.handlers import StreamHandlers
from zacoustic.zenoh.gateway.streams.kept import KeptSamples
from zacoustic.zenoh.gateway.streams.matching import MatchingSubscribers
from zacoustic.zenoh.gateway.streams.services import Services
from zacoustic.zenoh.gateway.streams.topics import Topics
from zacoustic.zenoh.requests.context import RequestContext
from zacoustic.zenoh.session.asking.queries import QueryHandler
from zacoustic.zenoh.session.session import ZenohSession

# The engine distinguishes 64 calls to one service. More callers than this on all services together
# would wait for hours on an acoustic channel.
QUERIES_LIMIT: Final = 256
"""Most local queries held at once."""
STOPPING_TEXT: Final = "the gateway is stopping"
"""Error text for queries that are held when the gateway stops."""

MakeDialects = Callable[[ZenohSession, InputErrors, Callable[[], None]], Dialects]
"""Creates the dialects of a session; the last argument wakes the loop."""


class Composition:
    """The parts of one gateway session, each made once; on the loop.

    Args:
        node: The node on the link.
        zenoh_session: The Zenoh session, open.
        make_dialects: Creates the local forms of streams.
        about: Constant facts for monitors.
        notify: Receives the notices.
        lost_contact: What to do when contact is lost.
    """

    def __init__(
        self,
        node: PreparedNode,
        zenoh_session: ZenohSession,
        make_dialects: MakeDialects,
        *,
        about: NodeDocument,
        notify: Notify,
        lost_contact: Sequence[LostContactAction] = (),
    ) -> None:
        parts = node.parts
        self._node = node
        self._zenoh_session = zenoh_session
        self._about = about
        self._lost_contact = tuple(lost_contact)
        self._clock = parts.clock
        self._wall_clock = parts.host.utc_ns
        self._table = parts.table
        self._ends: Pending[CallEnd] = Pending()
        self._wake_up = WakeUp(asyncio.get_running_loop())
        self._redundant = RedundantGateways(parts.address, self._clock, parts.table.nodes)
        self._dates = Dates(self._clock, self._wall_clock)
        self._recent_events = RecentEvents(self._dates.unix_s)
        self._announcer = Announcer(self._recent_events, notify)
        self._input_errors = InputErrors(self._clock, tell=self._recent_events.input_error)
        self._traffic = Traffic(self._dates.unix_s)
        self._frames = FrameLog(parts.table, lambda: self._runner.engine, unix_s=self._dates.unix_s)
        # A gateway that must act when it hears nobody cannot do that while it is not running.
        self._runner = node.make_runner(self._trace, waits_for_link=bool(self._lost_contact))
        self._context = RequestContext(
            self._runner, self._ends, clock=self._clock, utc_ns=self._wall_clock
        )
        self._dialects = make_dialects(zenoh_session, self._input_errors, self._wake_up.ring)
        self._queries = QueryHandler(
            zenoh_session.worker, self._wake_up.ring, limit=QUERIES_LIMIT, closed_text=STOPPING_TEXT
        )

    def session(self) -> GatewaySession:
        """Create the session."""
        streams = self._streams()
        routes = Routes(
            self._table,
            self._zenoh_session,
            self._redundant,
            streams=streams,
            dialects=self._dialects,
            queries=self._queries,
            runner=self._runner,
        )
        network = LocalNetwork(
            self._zenoh_session,
            self._wake_up,
            redundant=self._redundant,
            dialects=self._dialects,
            routes=routes,
            queries=self._queries,
            tell=self._announcer.tell,
        )
        objects = Objects(self._table)
        lost_contact = LostContactActions(
            self._redundant.address,
            self._lost_contact,
            self._runner,
            self._zenoh_session,
            streams.services.dialects,
            dates=self._dates,
            tell=self._announcer.tell,
        )
        peers = PeerTable(self._runner, self._traffic)
        intake = streams.topics.intake
        status = StreamStatus(self._runner, self._traffic, lambda: routes.jobs, intake)
        sections = (
            self._link_status(),
            peers,
            status,
            objects,
            self._frames,
            Dropped(self._runner, self._input_errors, intake, self._queries, self._zenoh_session),
            self._recent_events,
            PeerStatus(self._runner, clock=self._clock, unix_s=self._dates.unix_s),
            lost_contact,
        )
        health = Health(self._redundant.address, self._zenoh_session, sections, self._dates)
        return GatewaySession(
            self._node,
            self._runner,
            network,
            streams=streams,
            requests=RequestHandler(self._context, self._redundant, health),
            health=health,
            feed=FrameFeed(self._runner, self._zenoh_session),
            announcer=self._announcer,
            dispatcher=EventDispatcher(
                streams,
                self._context,
                objects,
                network,
                traffic=self._traffic,
                peers=peers,
                status=status,
                tell=self._announcer.tell,
                lost_contact=lost_contact,
            ),
            lost_contact=lost_contact,
        )

    def _streams(self) -> StreamHandlers:
        table, zenoh_session, ring = self._table, self._zenoh_session, self._wake_up.ring
        topics = Topics(
            table,
            self._redundant,
            self._input_errors,
            self._dialects,
            KeptSamples(self._runner.keep, clock=self._clock, wall_clock=self._wall_clock),
            clock=self._clock,
            ring=ring,
            submit=zenoh_session.worker.submit,
        )
        self._runner.before_frames = topics.before_frames
        services = Services(
            table,
            zenoh_session,
            self._input_errors,
            self._dialects,
            self._ends,
            clock=self._clock,
            ring=ring,
        )
        actions = Actions(
            self._redundant.address,
            table,
            zenoh_session,
            self._input_errors,
            self._dialects,
            runner=self._runner,
            clock=self._clock,
        )
        matching = MatchingSubscribers(
            table, zenoh_session, self._redundant, topics, self._runner, ring=ring
        )
        return StreamHandlers(topics, services, actions, matching)

    def _link_status(self) -> LinkStatus:
        parts, started_at_unix_s = self._node.parts, round(self._dates.unix_s(), 3)
        return LinkStatus(
            self._runner,
            msgspec.structs.replace(self._about, started_at_unix_s=started_at_unix_s),
            has_journal=not (parts.journal is None or isinstance(parts.journal, MemoryJournal)),
            clock=self._clock,
            dates=self._dates,
            seal=self._node.seal.report if self._node.seal is not None else None,
            tariffs={
                each.name: each.bonded.tariff
                for each in parts.rules.links
                if each.bonded.tariff is not None
            },
        )

    def _trace(self, record: TraceRecord) -> None:
        self._traffic.note(record)
        self._frames.note(record)
