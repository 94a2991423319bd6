"""`Node`: one participant, from `open` to `close`."""

import asyncio
import threading
from collections.abc import AsyncIterator, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import msgspec

from zacoustic.config import Config
from zacoustic.core.base.stats import EngineStats, LedgerEntry
from zacoustic.core.peers.measurements import Range
from zacoustic.core.streams.commands import CommandState, RemoteCommand, check_timeout
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.core.wire.routing import RoutingRequest
from zacoustic.errors import ConfigError, LocalError, SessionError
from zacoustic.link.contract import Link
from zacoustic.run.journal import Journal, journal_in
from zacoustic.zenoh.node.api.catalogue import Catalogue
from zacoustic.zenoh.node.api.endpoints import EndpointMaker
from zacoustic.zenoh.node.api.eventlog import EventLog
from zacoustic.zenoh.node.api.identity import identify
from zacoustic.zenoh.node.carrier import Carrier, NodeEvent
from zacoustic.zenoh.requests.commands import row_of
from zacoustic.zenoh.requests.routing import ROUTING, RoutingReport

COMMAND_TIMEOUT_S: Final = 60.0
"""Default time limit of a command, s."""
_ITS_OWN: Final = "on Zenoh the gateway keeps the journal"
_RECORDS: Final = "on Zenoh the gateway records, or zacoustic record"


class Node(EndpointMaker):
    """One participant: on its own link, or on the local Zenoh network.

    An asynchronous context manager, which calls `open` and `close`. Use the node and its endpoints
    on the loop that opened it; `Publisher.publish` works in any thread.

    Args:
        name_or_address: A name, which the configuration may list, or an acoustic address.
        config: File with the section `plugins.acoustic`, or the result of `read_config`.
        link: *Direct mode*, without Zenoh: a locator (``evologics/serial:/dev/ttyUSB0``), or a link
            that is not open yet. None: a Zenoh session.
        connect: Zenoh endpoints to connect to; None: the router that `config` describes, or any
            router found.
        address: Acoustic address, if neither name nor config gives it.
        journal: Direct mode: journal, or the folder of its file; None: the folder that `config`
            names, or no journal.
        record: Direct mode: file of the recording (MCAP); None: no recording. Needs the extra
            `recording`.
    """

    def __init__(
        self,
        name_or_address: str | int,
        *,
        config: str | Path | Config | None = None,
        link: str | Link | None = None,
        connect: str | Sequence[str] | None = None,
        address: int | None = None,
        journal: Journal | str | Path | None = None,
        record: str | Path | None = None,
    ) -> None:
        super().__init__(str(name_or_address))
        self._arguments = (name_or_address, config, address)
        self._link = link
        self._connect = connect
        self._journal = journal
        self._record = record
        self._events = EventLog()
        self.address: int | None = None
        """The node's acoustic address; None before `open`, and on Zenoh if it has none."""

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    async def open(self) -> None:
        """Open the link or the session.

        Raises:
            ConfigError: The configuration, an argument or the journal is wrong.
            LinkUnavailableError, LinkOpenError: The link cannot be opened.
            SessionError: No Zenoh router can be reached.
        """
        if self._carrier is not None or self._is_closed:
            raise LocalError(f"node {self.name} was opened already", hint="make a new Node")
        name_or_address, config, address = self._arguments
        identity = identify(name_or_address, config=config, address=address)
        table = identity.table()
        carrier = await self._make_carrier(identity.config, identity.address, table)
        await carrier.open()
        self.name, self.address = identity.name, identity.address
        self._loop, self._thread = asyncio.get_running_loop(), threading.get_ident()
        self._carrier = carrier
        self._catalogue = Catalogue(identity, table, carrier)

    async def close(self) -> None:
        """Close all endpoints, then the link or the session. May be called again.

        The node still acknowledges received samples, for at most 5 s, but receives nothing more.
        Other queued samples are lost; call `flush` first if they matter.
        """
        self._is_closed = True
        carrier, self._carrier = self._carrier, None
        if carrier is None:
            return
        for subscription in tuple(self._subscriptions):
            subscription.close()
        tasks = self._tasks - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        try:
            if tasks:
                await asyncio.wait(tasks)
        finally:
            await carrier.close()
            self._events.close()

    async def flush(self, *, timeout_s: float | None = None) -> None:
        """Wait until all published samples have left this node.

        On a link: the queue is empty, and the last transmission has ended. Whether it arrived is
        unknown.

        Args:
            timeout_s: Time limit, s; None: no limit, which is for ever on a link that stays down.

        Raises:
            TimeoutError: Something has not left in time.
            LinkClosedError: The node has failed.
        """
        async with asyncio.timeout(timeout_s):
            await self._opened().flush()

    async def range(self, peer: int | str, *, timeout_s: float = 30.0) -> Range:
        """Measure the range of another node; direct mode only.

        The node requests an acknowledgement from the other modem, for a frame that goes anyway or
        for one of a single byte, and its modem measures the delay. The node repeats an exchange
        that brings no range.

        Args:
            peer: Acoustic address of the node, or its name in the configuration.
            timeout_s: Time limit, s; one exchange over 1500 m takes about 3 s.

        Raises:
            LocalError: There is no such node, it is this one, or this node is not open.
            RangeUnavailableError: The link measures no ranges, or none to that node.
            CallTimeoutError: No range was measured in time.
            LinkClosedError: The node was closed, or has failed.
        """
        carrier = self._opened()
        if isinstance(peer, str):
            peer = self._known().address_of(peer)
        return await carrier.range(peer, timeout_s)

    async def command(
        self, peer: int | str, command: RemoteCommand, *, timeout_s: float = COMMAND_TIMEOUT_S
    ) -> CommandState:
        """Send a command to another node, or to this one: be silent, resume, override a topic.

        The other node executes the command on arrival, at most once, and answers when the command
        is in its journal, if it has one. The answer to a command that begins a silence is the last
        frame before it: a node that does not answer may be silent.

        Args:
            peer: Acoustic address of the node, or its name in the configuration.
            command: The command.
            timeout_s: Time limit, s, at most 600.

        Returns:
            The state of the node after the command.

        Raises:
            LocalError: There is no such node, the time limit is too long, or the command makes no
                sense here.
            ServiceError: The node refuses the command, with a reason.
            CallTimeoutError: No answer came in time; the node may have executed the command.
            DeliveryError: The command cannot be sent from here.
            LinkClosedError: The node was closed, or has failed.
        """
        carrier = self._opened()
        check_timeout(timeout_s)
        if isinstance(peer, str):
            peer = self._known().address_of(peer)
        state: CommandState = (await carrier.ask(row_of(command), peer, command, timeout_s)).state()
        return state

    async def routing(
        self, peer: int, request: RoutingRequest, *, timeout_s: float = COMMAND_TIMEOUT_S
    ) -> RoutingReport:
        """Send a command about routes to another node, or to this one.

        Args:
            peer: Acoustic address of the node that executes it.
            request: The command; `via` has the nodes between.
            timeout_s: Time limit, s, at most 600.

        Raises:
            LocalError: There is no such node, the time limit is too long, or the command makes no
                sense here.
            ServiceError: A node refuses the command, with a reason.
            CallTimeoutError: No answer came in time; the node may have executed the command.
            DeliveryError: The command cannot be sent from here.
            LinkClosedError: The node was closed, or has failed.
        """
        carrier = self._opened()
        check_timeout(timeout_s)
        return await carrier.ask(ROUTING, peer, request, timeout_s)

    def refuse(self, progress: ObjectProgress) -> bool:
        """Refuse the rest of an incoming large sample.

        The publisher gets the outcome `refused` and may publish the sample again.

        Args:
            progress: The sample's progress from `events`.

        Returns:
            Whether the sample was still under way; False on Zenoh, where samples arrive whole.

        Raises:
            LocalError: The sample is an outgoing one (cancel its `Delivery`), or the node is not
                open.
            LinkClosedError: The node was closed, or has failed.
        """
        if progress.object_id is not None:
            raise LocalError("an own sample cannot be refused", hint="cancel its Delivery")
        return self._opened().refuse(progress.peer, progress.transfer)

    # State of the node

    def events(self) -> AsyncIterator[NodeEvent]:
        """Iterate over events other than samples and calls: recent ones first, then new ones.

        - `LinkStateChanged`: the link goes up or down. On Zenoh, the connection to the router does,
          and there is no other event.
        - `JournalStateChanged`, `JournalDoubted`: the journal cannot be written, or can be again;
          it may lack the last writes.
        - `AddressShared`: two nodes have one address.
        - `SilenceChanged`: transmit silence has begun by command, or has ended.
        - `StreamOverridden`: a command overrides the settings of a topic.
        - `PeerReachable`: a link of a list of links reaches a node, or does not any more;
        - `PeerSeen`, `PeerLost`, `PeerFound`: a peer is heard for the first time, or has restarted;
          it is lost, or heard again, if the configuration has `lost_after_s`.
        - `ContactLost`, `ContactRestored`: nobody was heard for the time of an entry of
          `lost_contact`, or somebody is again. A gateway acts then; a node only says so.
        - `SubscribersChanged`: nodes subscribe to an on-demand topic of this node, or unsubscribe.
        - `DeadlineMissed`: no sample of a topic with `deadline_s` was published, or came, in time.
        - `StreamsDiffer`: a peer defines streams differently.
        - `PeerMeasured`, `ModemRead`: the modem has measured a peer, or reports its own values.
        - `CustodyChanged`: a node takes a sample of a carried topic along, or has no room for it.
        - `DeliveryEnded`: a sample from before this node's restart has its outcome.
        - `ObjectProgress`: a large sample, outgoing or incoming, has progressed or ended.
        - `AccessStateChanged`: a schedule does not hold, is not in use, or is as it should be.
        - `BulkChanged`: large samples to a node go by another service of the modem from now on.
        - `ClockStateChanged`, `NothingHeard`, `EngineRestarted`, `SealAlarm`, `RosEntitySeen`.

        The iteration ends with the node.
        """
        return self._events.read()

    def topics(self) -> list[str]:
        """Return the names of the topics that this node may subscribe to."""
        return self._known().topics()

    def find_stream(self, name: str) -> Stream | None:
        """Find the stream of a name or of a key; None on Zenoh without a configuration.

        Raises:
            LocalError: No stream has that name.
        """
        return self._known().find(name)

    @property
    def stats(self) -> EngineStats:
        """The counters; on Zenoh the gateway counts the frames."""
        return self._opened().stats

    def expired(self) -> dict[int, int]:
        """Return how many samples and calls expired unsent, by stream id; empty on Zenoh."""
        return self._opened().expired()

    def ledger(self) -> list[LedgerEntry]:
        """Return all bytes given to the link, by stream and cause; empty on Zenoh."""
        return self._opened().ledger()

    # Below the methods above

    async def _make_carrier(
        self, config: Config | None, address: int | None, table: StreamTable
    ) -> Carrier:
        if self._link is None:
            if self._journal is not None:
                raise ConfigError("journal is given without link; allowed: with it", hint=_ITS_OWN)
            if self._record is not None:
                raise ConfigError("record is given without link; allowed: with it", hint=_RECORDS)
            try:
                from zacoustic.zenoh.node.onzenoh.onzenoh import ZenohCarrier
            except ModuleNotFoundError as error:
                raise SessionError(
                    f"a node without link needs {error.name}, which is not installed",
                    hint="pip install eclipse-zenoh",
                ) from error
            return ZenohCarrier(config, self._connect, report=self._events.add)
        if self._connect is not None:
            raise ConfigError("connect is given beside link; allowed: one of the two")
        if address is None:
            raise ConfigError(
                f"node {self.name} has no address", hint="give address=1..254, or config=FILE"
            )
        return await self._make_link_carrier(self._link, config, address, table)

    async def _make_link_carrier(
        self, link: str | Link, config: Config | None, address: int, table: StreamTable
    ) -> Carrier:
        from zacoustic.link import registry
        from zacoustic.run.node import LinkNode
        from zacoustic.zenoh.node.onlink.onlink import LinkCarrier

        parts = LinkNode(
            address=address,
            table=table,
            link=registry.create(link, address) if isinstance(link, str) else link,
        )
        journal = self._journal
        if config is not None:
            journal = journal or config.journal
            parts = msgspec.structs.replace(
                parts,
                ranges=config.ranges_to(),
                rules=config.rules.on_one_link(),
                permits=config.permit_log,
                security=config.security,
            )
        if isinstance(journal, str | Path):
            journal = journal_in(journal, address)
        record = None
        if self._record is not None:
            from zacoustic.run.recording.live import open_recording

            record = partial(open_recording, self._record)
        prepared = await msgspec.structs.replace(parts, journal=journal).prepare(record)
        try:
            return LinkCarrier(prepared, report=self._events.add, fail=self._fail)
        except BaseException:
            await prepared.close()
            raise

    def _fail(self, error: Exception) -> None:
        for subscription in tuple(self._subscriptions):
            subscription.fail(error)
        self._events.close(error)
