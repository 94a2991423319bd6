"""Composition of a gateway session: its parts, what they need, and their order.

Each part is made from parts that already exist, and none is changed afterwards. Two things follow
later, when the session opens: the events of the engine, which is made first, and the wake-up of the
loop.
"""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from zacoustic.config.lostcontact import LostContactAction
from zacoustic.core.base.trace import TraceRecord
from zacoustic.run.inbox import WakeUp
from zacoustic.run.journal import MemoryJournal
from zacoustic.run.node import PreparedNode
from zacoustic.run.pending import CallEnd, Pending
from zacoustic.zenoh.gateway.dialect.dialects import Dialects
from zacoustic.zenoh.gateway.events.dispatcher import EventDispatcher
from zacoustic.zenoh.gateway.events.eventnotices import EventNotices
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
from zacoustic.zenoh.gateway.status.report import Report
from zacoustic.zenoh.gateway.status.status import Status
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
        about: Mapping[str, object],
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
        status = self._status(streams, routes, objects, lost_contact)
        notices = EventNotices(self._table, self._context)
        return GatewaySession(
            self._node,
            self._runner,
            network,
            streams=streams,
            requests=RequestHandler(self._context, self._redundant, status.health),
            status=status,
            dispatcher=EventDispatcher(
                streams, self._context, objects, network, status, notices, lost_contact
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
            self._context,
            clock=self._clock,
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

    def _status(
        self,
        streams: StreamHandlers,
        routes: Routes,
        objects: Objects,
        lost_contact: LostContactActions,
    ) -> Status:
        runner, dates = self._runner, self._dates
        started = {"started_at_unix_s": round(dates.unix_s(), 3)}
        journal = self._node.parts.journal
        link = LinkStatus(
            runner,
            {**self._about, **started},
            has_journal=not (journal is None or isinstance(journal, MemoryJournal)),
            clock=self._clock,
            dates=dates,
            seal=self._node.seal.report if self._node.seal is not None else None,
            tariffs={
                each.name: each.bonded.tariff
                for each in self._node.parts.rules.links
                if each.bonded.tariff is not None
            },
        )
        peers = PeerTable(runner, self._traffic)
        stream_status = StreamStatus(
            runner, self._traffic, lambda: routes.jobs, streams.topics.intake
        )
        sections = (
            link,
            peers,
            stream_status,
            objects,
            self._frames,
            Dropped(
                runner,
                self._input_errors,
                streams.topics.intake,
                self._queries,
                self._zenoh_session,
            ),
            self._recent_events,
            PeerStatus(runner, clock=self._clock, unix_s=dates.unix_s),
            lost_contact,
        )
        report = Report(sections, dates)
        return Status(
            report,
            Health(self._redundant.address, self._zenoh_session, report, dates),
            FrameFeed(runner, self._zenoh_session),
            traffic=self._traffic,
            peers=peers,
            streams=stream_status,
            announcer=self._announcer,
        )

    def _trace(self, record: TraceRecord) -> None:
        self._traffic.note(record)
        self._frames.note(record)
