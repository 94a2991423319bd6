"""The life of a gateway: from a config to a junction of session, engine and link, and back.

::

    Zenoh's threads                       the loop                                      the link
    subscriber ──► Mailbox ──┐                             ┌────────────┐
    queryable ──► QueryDesk ─┼─► Doorbell ──► Exchange ───►│ LinkRunner │──► transmit
    token ──────► Presence ──┘                             │   Engine   │
    put, reply ◄── Island, Worker ◄── Topics, Services ◄───│            │◄── frames
                                                           └────────────┘

Nothing runs on a thread of Zenoh's but handing over; nothing blocks the loop.
"""

import asyncio
import logging
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

import zenoh

from zacoustic import registry
from zacoustic.config import Config, read_config
from zacoustic.core.clock import Clock
from zacoustic.errors import ConfigError
from zacoustic.gateway.complaints import Complaints
from zacoustic.gateway.dialects import Dialects
from zacoustic.gateway.junction import Junction
from zacoustic.gateway.notices import Notice, Notify, Started, Stopped
from zacoustic.island.latching import stamp_samples
from zacoustic.island.session import Island, endpoints_of, mode_of
from zacoustic.journal import Journal, JournalState, MemoryJournal, SqliteJournal, journal_in
from zacoustic.journal.forgotten import forgotten
from zacoustic.journal.thread import recover, release
from zacoustic.link import Link
from zacoustic.permitlog import open_permit_log

_logger = logging.getLogger(__name__)


class Gateway:
    """Joins the Zenoh network of one session to others through a link; an async context manager.

    It lives once: a closed one is not started again.

    Args:
        config: What the node is, with the settings of its Zenoh session.
        link: The modem, not open yet; None: what the config's locator names.
        journal: What the node remembers across restarts, a store or the folder of its file; None:
            the folder that the config names, or nothing.
        notify: Told what people want to know, on the loop; None: logged.
        clock: Where instants come from; the same as the link's.

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
        notify: Notify | None = None,
        clock: Clock = time.monotonic_ns,
    ) -> None:
        self.config = config
        self._zenoh_config = _zenoh_config(config)
        self._link = link or registry.create(_locator(config), config.address)
        journal = journal or config.journal or MemoryJournal()
        if isinstance(journal, str | Path):
            journal = journal_in(journal, config.address)
        self._journal: Journal = journal
        self._notify: Notify = notify or _log
        self._clock = clock
        self._junction: Junction | None = None
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
        notify: Notify | None = None,
    ) -> Self:
        """Make the gateway of a file.

        Args:
            path: A Zenoh config with a section `plugins.acoustic`.
            address: Acoustic address, instead of the file's.
            locator: Locator of the modem, instead of the file's.
            journal: Folder of the journal, instead of the file's.
            notify: Told what people want to know, on the loop; None: logged.

        Raises:
            ConfigError: The file is wrong, or names no link.
            LinkUnavailableError: The link is not installed.
        """
        config = read_config(path, address=address, locator=locator)
        return cls(config, journal=journal, notify=notify)

    async def start(self) -> None:
        """Open the session and the link, and join them; nothing is left open if that fails.

        Raises:
            SessionError: Port in use, router unreachable, or the address is taken.
            LinkOpenError: The link cannot be opened.
            RangeUnavailableError: The file asks for ranges, and the link measures none.
            ConfigError: The journal cannot be used.
        """
        try:
            state = await recover(self._journal)
            if self.config.ros is not None:
                stamp_samples(self._zenoh_config)
            island = await Island.open(self._zenoh_config)
            self._junction = junction = await self._join(island, state)
            await junction.open()
            self._notify(self._started(junction))
        except BaseException:
            await self.close()
            raise

    async def close(self) -> None:
        """Stop; leaves no task, no declaration and no session. May be called again."""
        if self._is_closing:
            await self._closed.wait()
            return
        self._is_closing = True
        try:
            if self._junction is not None:
                await self._junction.close()
                self._notify(Stopped())
            else:
                await release(self._journal)
        finally:
            self._closed.set()

    async def wait_failed(self) -> None:
        """Wait until the gateway ends.

        Raises:
            Exception: What has stopped it, if it was not closed.
        """
        assert self._junction is not None, "the gateway has not been started"
        await self._junction.wait_failed()

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

    def _started(self, junction: Junction) -> Started:
        config, table = self.config, self.config.table
        return Started(
            address=config.address,
            name=config.name or "",
            mode=mode_of(self._zenoh_config),
            zid=str(junction.island.session.zid()),
            endpoints=tuple(
                f"{word} {endpoint}"
                for word in ("listen", "connect")
                for endpoint in endpoints_of(self._zenoh_config, word)
            ),
            link=config.links[0].locator if config.links else type(self._link).__name__,
            link_state=junction.runner.link_state.value,
            streams=tuple(stream.name for stream in table),
            digest=table.digest.hex(),
            journal=str(self._journal.path) if isinstance(self._journal, SqliteJournal) else "",
            forgotten=self._forgotten(),
            siblings=tuple(each for each in junction.siblings.alive if each != config.address),
        )

    async def _join(self, island: Island, state: JournalState) -> Junction:
        try:
            return Junction(
                self.config.address,
                self.config.table,
                island=island,
                link=self._link,
                journal=self._journal,
                state=state,
                ranges=self.config.ranges_to(),
                rules=self.config.rules,
                permit_log=open_permit_log(self.config.permit_log),
                dialects=self._dialects,
                notify=self._notify,
                clock=self._clock,
            )
        except BaseException:
            await island.close()
            raise

    def _dialects(
        self, island: Island, complaints: Complaints, ring: Callable[[], None]
    ) -> Dialects:
        ros, table = self.config.ros, self.config.table
        if ros is None:
            return Dialects(island)
        from zacoustic.gateway.ros import RosDialects

        return RosDialects(self.config.address, table, ros, island, complaints, ring)

    def _forgotten(self) -> str:
        if not isinstance(self._journal, MemoryJournal):
            return ""
        return forgotten(self.config.table, self.config.address)


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
        _logger.info("%s", line)
