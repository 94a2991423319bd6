"""`LinkNode`: the parts of a node on its links, and its runner.

A gateway and a program's node in direct mode start the same way: the journal begins a boot epoch,
recording and permit log open, and an engine is made from the journal, now and whenever one has
raised.
"""

import asyncio
import logging
import random
import time
from collections.abc import Awaitable, Callable, Mapping
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import msgspec

from zacoustic.core.base.clock import Clock
from zacoustic.core.base.trace import TraceSink
from zacoustic.core.engine.engine import Engine
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import ConfigError
from zacoustic.link.contract import Link
from zacoustic.run.audit import AuditLog, audit_path
from zacoustic.run.clocks import NodeClocks
from zacoustic.run.hostclock import HostClock
from zacoustic.run.journal import Journal, JournalState, MemoryJournal, SqliteJournal
from zacoustic.run.journal.thread import recover, release
from zacoustic.run.permitlog import PermitLog, open_permit_log
from zacoustic.run.replacement.intact import Intact
from zacoustic.run.runner import LinkRunner
from zacoustic.run.sealing import NodeSeal, open_seal
from zacoustic.seal.spec import SecuritySpec

if TYPE_CHECKING:
    from zacoustic.run.recording.live import LiveRecording

OpenRecording: TypeAlias = Callable[[], Awaitable["LiveRecording"]]
"""Opens a recording."""

_logger = logging.getLogger(__name__)


class LinkNode(msgspec.Struct, frozen=True, kw_only=True):
    """One node on its links, not running yet."""

    address: int
    """Its acoustic address."""
    table: StreamTable
    """Its streams."""
    link: Link
    """Its first link, not open yet."""
    beside: Mapping[str, Link] = {}
    """Its other links, by name."""
    rules: TransmitRules = TransmitRules()
    """When and how much it may transmit."""
    ranges: Mapping[int, float] = {}
    """Periods of range measurements by node, s."""
    journal: Journal | None = None
    """Stores the engine's writes; None: nothing survives a restart."""
    permits: Path | None = None
    """File of the permit log, or None."""
    clock: Clock = time.monotonic_ns
    """Source of instants, the same as the link's."""
    host: HostClock = msgspec.field(default_factory=HostClock)
    """The clock of the computer."""
    security: SecuritySpec | None = None
    """How its frames are sealed; None: they are not."""

    async def prepare(self, record: OpenRecording | None = None) -> "PreparedNode":
        """Begin a boot epoch of the journal, and open recording and permit log.

        Args:
            record: Opens the recording, which makes the engines; None: no recording.

        Raises:
            ConfigError: One of them cannot be used; nothing stays open.
        """
        seal = None if self.security is None else open_seal(self.security, self.address)
        if seal is not None and self.journal is None and not seal.only_opens:
            raise ConfigError(
                f"{seal.source}: node {self.address} has no journal",
                hint='give "journal": a folder, where it keeps which frames it has opened; or '
                '"seal": "receive", and it opens frames and transmits none',
            )
        journal = self.journal
        if seal is not None and journal is not None:
            journal = seal.keep_lives(journal)
        async with AsyncExitStack() as failing:
            if journal is None:
                state = MemoryJournal().recover()
            else:
                failing.push_async_callback(release, journal)
                state = await recover(journal)
            recording = None if record is None else await record()
            if recording is not None:
                failing.push_async_callback(recording.close)
            permit_log = open_permit_log(self.permits)
            failing.pop_all()
        audit = self._open_audit()
        return PreparedNode(self, state, journal, permit_log, recording, seal, audit)

    def _open_audit(self) -> AuditLog | None:
        """Open the audit log beside a journal that is a file."""
        if not isinstance(self.journal, SqliteJournal):
            return None
        path = audit_path(self.journal.path)
        is_sealed = self.security is not None
        try:
            return AuditLog(path, self.address, self.table, self.host.utc_ns, sealed=is_sealed)
        except OSError as error:  # as with the journal, a full disk does not stop the node
            _logger.warning("audit log %s: %s; nothing is noted", path, error.strerror)
            return None


class PreparedNode:
    """A node whose journal has begun a boot epoch; make one runner of it, or close it.

    Args:
        parts: The parts of the node.
        state: The contents of the journal.
        journal: Stores the engine's writes, or None.
        permit_log: Takes each emission, or None.
        recording: Makes its engines, or None.
        seal: Seals its frames, or None.
        audit: Logs the requests to it, or None.
    """

    def __init__(
        self,
        parts: LinkNode,
        state: JournalState,
        journal: Journal | None,
        permit_log: PermitLog | None,
        recording: "LiveRecording | None",
        seal: NodeSeal | None = None,
        audit: AuditLog | None = None,
    ) -> None:
        self.parts = parts
        self.seal = seal
        """Seals its frames, or None."""
        self._state = state
        self._journal = journal
        self._permit_log = permit_log
        self._audit = audit
        self.recording = recording
        """Makes its engines, or None."""
        self._has_runner = False

    @property
    def is_restart(self) -> bool:
        """Whether it goes on from a journal that has begun a boot epoch before."""
        return self._state.is_restart

    def make_runner(
        self, trace: TraceSink | None = None, *, waits_for_link: bool = False
    ) -> LinkRunner:
        """Make the engine and its runner, which closes link, journal and permit log.

        Args:
            trace: Takes the trace of each engine, or None.
            waits_for_link: As for `LinkRunner`.
        """
        parts = self.parts
        renew = partial(self._renew, trace)
        epoch = self._state.boot_epoch
        if self.seal is not None:
            self.seal.begin(asyncio.get_running_loop())
        runner = LinkRunner(
            Intact(renew, epoch, self._state.entries),
            parts.link,
            beside=parts.beside,
            clocks=NodeClocks(parts.clock, parts.host, stated_error_s=parts.rules.clock_error_s),
            journal=self._journal,
            permit_log=self._permit_log,
            waits_for_link=waits_for_link,
        )
        self._has_runner = True
        return runner

    def start_ranging(self, runner: LinkRunner) -> None:
        """Start the periodic range measurements.

        Raises:
            RangeUnavailableError: The link cannot measure ranges.
        """
        for address, every_s in self.parts.ranges.items():
            runner.apply(partial(_repeat_range, address, every_s))

    async def close(self) -> None:
        """Finish the recording after the runner has closed; without a runner, close everything."""
        async with AsyncExitStack() as each:
            if self._audit is not None:
                each.push_async_callback(self._audit.close)
            recording, self.recording = self.recording, None
            if recording is not None:
                each.push_async_callback(recording.close)
            if self._has_runner:
                return
            if self._journal is not None:
                each.push_async_callback(release, self._journal)
            if self._permit_log is not None:
                each.push_async_callback(self._permit_log.close)

    def _renew(self, trace: TraceSink | None, epoch: int, stored: Mapping[str, bytes]) -> Engine:
        parts, seed = self.parts, random.SystemRandom().getrandbits(64)
        epoch = epoch if self.seal is None else self.seal.epoch(epoch)
        _logger.info("node %d: epoch %d, seed %d", parts.address, epoch, seed)
        make = Engine if self.recording is None else self.recording.make
        engine = make(
            address=parts.address,
            table=parts.table,
            epoch=epoch,
            rng=random.Random(seed),
            stored=parts.host.named(stored),
            rules=parts.rules,
            trace=trace,
            cipher=None if self.seal is None else self.seal.cipher,
        )
        if self._audit is not None:
            self._audit.watch(engine)
        return engine


def _repeat_range(address: int, every_s: float, engine: Engine, now: int) -> None:
    engine.ranging.repeat(address, every_s, now)
