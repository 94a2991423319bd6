"""A gateway from a config to a session that joins network and link, and to its end.

::

    Zenoh's threads                       the loop                                      the link
    subscriber ─► Mailbox ──────┐                          ┌────────────┐
    queryable ──► QueryHandler ─┼─► WakeUp ─► Session ────►│ LinkRunner │──► transmit
    token ──────► Presence ─────┘                          │   Engine   │
    put, reply ◄─ Network, Worker ◄── Topics, Services ◄───│            │◄── frames
                                                           └────────────┘

Zenoh's threads only hand data over; nothing blocks the loop.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AsyncExitStack
from functools import partial
from importlib import metadata
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import zenoh

from zacoustic.config import Config, read_config
from zacoustic.core.base.clock import Clock
from zacoustic.core.base.qos import Durability
from zacoustic.errors import ConfigError, LocalError
from zacoustic.link import registry
from zacoustic.link.contract import Link
from zacoustic.run.hostclock import HostClock
from zacoustic.run.journal import Journal, MemoryJournal, SqliteJournal, journal_in
from zacoustic.run.journal.forgotten import forgotten
from zacoustic.run.node import LinkNode, OpenRecording, PreparedNode
from zacoustic.status.node import NodeDocument
from zacoustic.text.installing import with_extra
from zacoustic.text.safetext import one_line, without_secrets
from zacoustic.zenoh.gateway.compose import Composition
from zacoustic.zenoh.gateway.dialect.dialects import Dialects
from zacoustic.zenoh.gateway.inputerrors import InputErrors
from zacoustic.zenoh.gateway.notices import Notice, Notify, notice
from zacoustic.zenoh.gateway.session import GatewaySession
from zacoustic.zenoh.session.latching import stamp_samples
from zacoustic.zenoh.session.session import (
    ZenohSession,
    endpoints_of,
    listen_at,
    listen_here,
    mode_of,
)

if TYPE_CHECKING:
    from zacoustic.zenoh.gateway.status.metrics import MetricsServer

_logger = logging.getLogger(__name__)


class Gateway:
    """Joins the local Zenoh network to remote ones through a link; an async context manager.

    It starts only once: a closed gateway cannot start again.

    Args:
        config: The node, with the settings of its Zenoh session.
        link: The modem, not open yet; None: the link that the config's locator names.
        journal: Journal, or the folder of its file; None: the folder that the config names, or no
            journal.
        record: File of the recording; None: no recording. Needs the extra `recording`.
        notify: Receives the notices, on the loop; None: they are logged.
        metrics: Host and port at which it answers Prometheus; None: the config's.
        clock: Source of instants, the same as the link's.
        host: Clock of the computer, for hours of the day and slots; None: this computer's.

    Raises:
        ConfigError: The config has no Zenoh settings or no link.
        LinkUnavailableError: The link is not installed.
    """

    def __init__(
        self,
        config: Config,
        *,
        link: Link | None = None,
        journal: Journal | str | Path | None = None,
        record: str | Path | None = None,
        notify: Notify | None = None,
        metrics: tuple[str, int] | None = None,
        clock: Clock = time.monotonic_ns,
        host: HostClock | None = None,
    ) -> None:
        self.config = config
        self._zenoh_config = _zenoh_config(config)
        self._listens_here = listen_here(self._zenoh_config)
        journal = journal or config.journal
        if isinstance(journal, str | Path):
            journal = journal_in(journal, config.address)
        self._parts = LinkNode(
            address=config.address,
            table=config.table,
            link=link or registry.create(_locator(config), config.address),
            beside={
                each.name: registry.create(each.locator, config.address)
                for each in config.links[1:]
                if each.name is not None
            },
            rules=config.rules,
            ranges=config.ranges_to(),
            journal=journal,
            permits=config.permit_log,
            security=config.security,
            clock=clock,
            host=host or HostClock(),
        )
        self._notify: Notify = notify or _log
        self._metrics_place = metrics or config.metrics
        self._metrics: MetricsServer | None = None
        self._record = record
        self._node: PreparedNode | None = None
        self._session: GatewaySession | None = None
        self._is_closing = False
        self._closed = asyncio.Event()

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        *,
        address: int | None = None,
        locator: str | None = None,
        journal: str | Path | None = None,
        listen: Sequence[str] = (),
        record: str | Path | None = None,
        notify: Notify | None = None,
        metrics: tuple[str, int] | None = None,
    ) -> Self:
        """Create a gateway from a file.

        Args:
            path: A Zenoh config with a section `plugins.acoustic`.
            address: Acoustic address; overrides the file's.
            locator: Locator of the modem; overrides the file's.
            journal: Folder of the journal; overrides the file's.
            listen: Zenoh endpoints to listen at; override the file's, unless empty.
            record: File of the recording; None: no recording.
            notify: Receives the notices, on the loop; None: they are logged.
            metrics: Host and port at which it answers Prometheus; None: the file's.

        Raises:
            ConfigError: The file is wrong, or names no link.
            LinkUnavailableError: The link is not installed.
        """
        config = read_config(path, address=address, locator=locator)
        if listen:
            listen_at(_zenoh_config(config), listen)
        return cls(config, journal=journal, record=record, notify=notify, metrics=metrics)

    async def start(self) -> None:
        """Open the session and the link, and join them; if that fails, nothing stays open.

        Raises:
            SessionError: A port is in use, the router cannot be reached, or the address is taken.
            LinkOpenError: The link cannot be opened, or the metrics' port is in use.
            RangeUnavailableError: The file asks for ranges, and the link measures none.
            ConfigError: The journal or the recording cannot be opened.
        """
        try:
            node = self._node = await self._parts.prepare(self._recorder())
            table, latched = self.config.table, Durability.TRANSIENT_LOCAL
            if self.config.ros or any(each.qos.durability is latched for each in table):
                stamp_samples(self._zenoh_config)
            zenoh_session = await ZenohSession.open(self._zenoh_config)
            session = self._session = await self._join(node, zenoh_session)
            await session.open()
            await self._serve_metrics(session)
            self._notify(self._started(session, node))
        except BaseException:
            await self.close()
            raise

    async def close(self) -> None:
        """Stop, without leaving a task, a declaration or a session. May be called again."""
        if self._is_closing:
            await self._closed.wait()
            return
        self._is_closing = True
        try:
            async with AsyncExitStack() as last_first:  # each, even if others fail
                if self._node is not None:
                    last_first.push_async_callback(self._node.close)
                if self._session is not None:
                    last_first.push_async_callback(self._session.close)
                if self._metrics is not None:
                    last_first.push_async_callback(self._metrics.close)
            if self._session is not None:
                self._notify(notice("stopped", ""))
        finally:
            self._closed.set()

    async def wait_failed(self) -> None:
        """Wait until the gateway ends.

        Raises:
            LocalError: The gateway has not been started.
            Exception: The error that stopped it, unless it was closed.
        """
        if self._session is None:
            raise LocalError("the gateway has not been started", hint="await start() before")
        await self._session.wait_failed()

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self,
        exc_type: type[BaseException] | None,
        exc: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    def _started(self, session: GatewaySession, node: PreparedNode) -> Notice:
        config, table, journal = self.config, self.config.table, self._parts.journal
        alive = session.network.redundant.alive
        facts = {
            "address": config.address,
            "name": config.name or "",
            "mode": mode_of(self._zenoh_config),
            "zid": str(session.network.zenoh_session.session.zid()),
            "endpoints": tuple(
                f"{word} {without_secrets(endpoint)}"
                for word in ("listen", "connect")
                for endpoint in endpoints_of(self._zenoh_config, word)
            ),
            "listens_here": self._listens_here,
            "link": self._locator,
            "link_state": session.runner.link_state.value,
            "streams": tuple(stream.name for stream in table),
            "digest": table.digest.hex(),
            "journal": str(journal.path) if isinstance(journal, SqliteJournal) else "",
            "forgotten": self._forgotten(),
            "metrics": self._metrics.url if self._metrics is not None else "",
            "recording": str(node.recording.path) if node.recording is not None else "",
            "redundant": tuple(each for each in alive if each != config.address),
        }
        return Notice(event="started", says=tuple(_started_lines(facts)), facts=facts)

    @property
    def _locator(self) -> str:
        links = self.config.links
        return without_secrets(links[0].locator) if links else type(self._parts.link).__name__

    def _about(self) -> NodeDocument:
        """Return the constant facts for the health report."""
        config = self.config
        return NodeDocument(
            address=config.address,
            name=config.name or "",
            version=metadata.version("zacoustic"),
            wire=config.table.wire.value,
            link=self._locator,
        )

    async def _serve_metrics(self, session: GatewaySession) -> None:
        if self._metrics_place is None:
            return
        try:
            from zacoustic.zenoh.gateway.status.metrics import MetricsServer
        except ModuleNotFoundError as error:
            raise ConfigError(
                f"metrics: needs {error.name}, which is not installed", hint=with_extra("metrics")
            ) from error
        self._metrics = MetricsServer(
            *self._metrics_place, session.documents, self.config.metrics_names
        )
        await self._metrics.open()

    def _recorder(self) -> OpenRecording | None:
        """Return the function that opens the recording; None: no recording."""
        if self._record is None:
            return None
        from zacoustic.run.recording.live import open_recording

        ros = self.config.ros
        return partial(
            open_recording,
            self._record,
            clock=self._parts.clock,
            ros=ros.streams if ros is not None else None,
            trouble=lambda text: self._notify(notice("recording", text, detail=text)),
        )

    async def _join(self, node: PreparedNode, zenoh_session: ZenohSession) -> GatewaySession:
        try:
            return Composition(
                node,
                zenoh_session,
                self._dialects,
                about=self._about(),
                notify=self._notify,
                lost_contact=self.config.lost_contact,
            ).session()
        except BaseException:
            await zenoh_session.close()
            raise

    def _dialects(
        self, zenoh_session: ZenohSession, input_errors: InputErrors, ring: Callable[[], None]
    ) -> Dialects:
        ros, table = self.config.ros, self.config.table
        if ros is None:
            return Dialects(zenoh_session, self._parts.clock)
        from zacoustic.zenoh.gateway.dialect.ros import RosDialects

        return RosDialects(
            self.config.address, table, ros, zenoh_session, input_errors, ring,
            clock=self._parts.clock,
        )  # fmt: skip

    def _forgotten(self) -> str:
        journal = self._parts.journal
        if not (journal is None or isinstance(journal, MemoryJournal)):
            return ""
        lines = [forgotten(self.config.table, self.config.address)]
        if self.config.lost_contact:
            lines.append("lost_contact without a journal: each start begins the countdown anew")
        return "; ".join(filter(None, lines))


def _zenoh_config(config: Config) -> zenoh.Config:
    if config.zenoh_config is None:
        raise ConfigError(
            f"{config.source}: no Zenoh settings", hint="read it by zacoustic.config.read_config"
        )
    return config.zenoh_config


def _locator(config: Config) -> str:
    if not config.links:
        raise ConfigError(
            f"{config.source}: plugins.acoustic.links: names no modem",
            hint='add links: [ { locator: "NAME/ADDRESS" } ], or give --link NAME/ADDRESS',
        )
    return config.links[0].locator


def _log(notice: Notice) -> None:
    for line in notice.lines():
        _logger.info("%s", one_line(line))


def _started_lines(facts: dict[str, Any]) -> Iterator[str]:
    """Yield what a gateway says at its start, one line for each fact that there is."""
    here = ["only this computer reaches it: no listen in the file"] * facts["listens_here"]
    streams = facts["streams"]
    lines = [
        ("address", f"{facts['address']} {facts['name']}"),
        ("session", f"{facts['mode']} {facts['zid']}"),
        *(("endpoint", each) for each in (*facts["endpoints"], *here)),
        ("link", f"{facts['link']} ({facts['link_state']})"),
        ("streams", f"{len(streams)}: {', '.join(streams)}"),
        ("digest", facts["digest"]),
        ("journal", facts["journal"] or facts["forgotten"]),
        *((head, facts[head]) for head in ("metrics", "recording")),
        *(("redundant", f"gateway {each}") for each in facts["redundant"]),
    ]
    yield from (f"{head:<10}{line}".rstrip() for head, line in lines if line)
