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
from zacoustic.errors import ConfigError, LocalError, SessionError
from zacoustic.link.contract import Link
from zacoustic.run.journal import Journal, journal_in
from zacoustic.zenoh.node.api.catalogue import Catalogue
from zacoustic.zenoh.node.api.endpoints import EndpointMaker
from zacoustic.zenoh.node.api.eventlog import EventLog
from zacoustic.zenoh.node.api.identity import identify
from zacoustic.zenoh.node.carrier import Carrier, NodeEvent

COMMAND_TIMEOUT_S: Final = 60.0
"""How long a command is tried by default, s."""
_ITS_OWN: Final = "on Zenoh the gateway keeps the journal"
_RECORDS: Final = "on Zenoh the gateway records, or zacoustic record"


class Node(EndpointMaker):
    """One participant: on its own link, or on the local Zenoh network.

    An asynchronous context manager; `open` and `close` are the same by hand. Everything here and
    on the endpoints is for the loop it was opened on; `Publisher.publish` is for any thread.

    Args:
        name_or_address: A name, which the configuration may list, or an acoustic address.
        config: The file with the section `plugins.acoustic`, or the result of `read_config`.
        link: *Direct mode*: a locator (``evologics/serial:/dev/ttyUSB0``), or a link that is not
            open yet; then there is no Zenoh. None: a Zenoh session.
        connect: Zenoh endpoints to connect to; None: the router that `config` describes, or
            any that is found.
        address: Acoustic address, if neither name nor config gives it.
        journal: Direct mode: keeps what must survive a restart, a store or the folder of its
            file; None: the folder that `config` names, or nothing.
        record: Direct mode: file into which everything is recorded (MCAP); None: nothing is. Needs
            the extra `recording`.
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
        """Its acoustic address, known when it is open."""

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
            SessionError: No Zenoh router is reached.
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

        It still acknowledges what has come, for 5 s at most, and hears nothing more. What else
        is queued is lost: `flush` before, if that matters.
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
        """Wait until everything that was published has left this node.

        On a link: nothing is queued, and the last transmission has ended. Whether it arrived is
        unknown.

        Args:
            timeout_s: How long to wait, s; None: for ever, as on a link that stays down.

        Raises:
            TimeoutError: It has not left in time.
            LinkClosedError: The node has failed.
        """
        async with asyncio.timeout(timeout_s):
            await self._opened().flush()

    async def range(self, peer: int | str, *, timeout_s: float = 30.0) -> Range:
        """Measure the range of another node; direct mode only.

        The modem is asked to acknowledge a frame to that node, one that goes anyway or one of a
        single byte, and measures how long the answer takes. An exchange without a range is
        repeated.

        Args:
            peer: Acoustic address of the node, or its name in the configuration.
            timeout_s: How long to wait, s; one exchange over 1500 m takes about 3 s.

        Raises:
            LocalError: No such node, this one itself, or the node is not open.
            RangeUnavailableError: The link measures no ranges, or none to that node.
            CallTimeoutError: None was measured in time.
            LinkClosedError: The node was closed, or has failed.
        """
        carrier = self._opened()
        if isinstance(peer, str):
            peer = self._known().address_of(peer)
        return await carrier.range(peer, timeout_s)

    async def command(
        self, peer: int | str, command: RemoteCommand, *, timeout_s: float = COMMAND_TIMEOUT_S
    ) -> CommandState:
        """Give a command to another node, or to this one: be silent, resume, override a topic.

        It is executed on arrival, at most once, and answered when it is in that node's journal,
        if it has one. The answer to the command that begins a silence is the last frame of that
        node: without an answer it may still be silent.

        Args:
            peer: Acoustic address of the node, or its name in the configuration.
            command: The command.
            timeout_s: How long to try, s, at most 600.

        Returns:
            The state there then.

        Raises:
            LocalError: No such node, a longer time, or the command makes no sense here.
            ServiceError: The node refuses it, with a reason.
            CallTimeoutError: No answer in time; it may have been executed.
            DeliveryError: It cannot be given from here.
            LinkClosedError: The node was closed, or has failed.
        """
        carrier = self._opened()
        check_timeout(timeout_s)
        if isinstance(peer, str):
            peer = self._known().address_of(peer)
        return await carrier.command(peer, command, timeout_s)

    def refuse(self, progress: ObjectProgress) -> bool:
        """Refuse the rest of an incoming large sample.

        Its publisher gets the outcome `refused`; it may be published again.

        Args:
            progress: Its progress from `events`.

        Returns:
            Whether it was still under way; False on Zenoh, where nothing is in parts.

        Raises:
            LocalError: It is an own one (cancel its `Delivery`), or the node is not open.
            LinkClosedError: The node was closed, or has failed.
        """
        if progress.object_id is not None:
            raise LocalError("an own sample cannot be refused", hint="cancel its Delivery")
        return self._opened().refuse(progress.peer, progress.transfer)

    # What the node knows

    def events(self) -> AsyncIterator[NodeEvent]:
        """Iterate over events besides samples and calls, the last ones first.

        The link goes up or down; the journal cannot be written, or can be again; silence has
        begun by command, or has ended; a command overrides a topic (`StreamOverridden`); a peer is
        seen, or restarts; it is lost (`PeerLost`), or found again (`PeerFound`), where the
        configuration has `lost_after_s`; others subscribe to an on-demand topic of this node, or
        unsubscribe (`SubscribersChanged`); of a topic with `deadline_s` no sample came in time,
        here or from elsewhere (`DeadlineMissed`); a peer defines a stream in another way; the modem
        has measured a peer (`PeerMeasured`), or reports values of itself (`ModemRead`); a sample of
        a former boot epoch of this node has ended (`DeliveryEnded`); a large sample, outgoing or
        incoming, has progressed or ended (`ObjectProgress`). On Zenoh only the
        first: the connection to the router. Ends with the node.
        """
        return self._events.read()

    def topics(self) -> list[str]:
        """Return the names of the topics that this node may subscribe to; none without streams."""
        return self._known().topics()

    def find_stream(self, name: str) -> Stream | None:
        """Find the stream of a name or of a key; None: on Zenoh without a configuration.

        Raises:
            LocalError: There is none of that name.
        """
        return self._known().find(name)

    @property
    def stats(self) -> EngineStats:
        """The counters; on Zenoh no frames, they are the gateway's."""
        return self._opened().stats

    def expired(self) -> dict[int, int]:
        """Return the samples that expired before their transmission, by stream id; not on Zenoh."""
        return self._opened().expired()

    def ledger(self) -> list[LedgerEntry]:
        """Return every byte given to the link, by stream and cause; on Zenoh nothing."""
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
