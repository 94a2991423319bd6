"""The asyncio shell around one engine: its links, one timer, the journal's thread.

`LinkRunner` does what the contract in `zacoustic.core.engine.engine` asks of a driver and nothing
else. Every input and every command ends in `_service`: poll until dry, arm one timer. There is no
polling, and no other task except those that open further links (`zacoustic.run.linkside`); while
the engine is idle, the process sleeps.

The thread of the loop owns the engine. Two things come from elsewhere:

- Commands of other threads (Zenoh's callbacks), by `submit` (`zacoustic.run.inbox`).
- Commits of the journal, by a future of its one worker thread (`JournalThread`). Writes during a
  commit collect and are committed together; the engine learns of a failure, and the commit is
  repeated.

An unexpected exception in a link or in the journal is logged with its traceback, stops the runner
and comes out of `wait_failed`. An exception in the engine, or in the receiver of its events, does
not stop the runner, since anyone with a modem may have caused it: it is counted and logged with the
frame that caused it, and a new engine continues from the journal, without the entries that make it
raise as well (`zacoustic.run.replacement`).
"""

import asyncio
import contextlib
import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Final, TypeAlias, TypeVar

from zacoustic.core.base.journal import JournalWrite
from zacoustic.core.base.linktypes import (
    LinkState,
    Measurement,
    ReceivedFrame,
    Transmission,
    TransmitReport,
)
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event
from zacoustic.errors import (
    ConfigError,
    LinkClosedError,
    LinkOpenError,
    RangeUnavailableError,
    ZacousticError,
)
from zacoustic.link.alarm import Alarm
from zacoustic.link.contract import Link
from zacoustic.run.clocks import NodeClocks
from zacoustic.run.inbox import Inbox, WakeUp
from zacoustic.run.journal import Journal
from zacoustic.run.journal.thread import NO_WRITE, JournalThread
from zacoustic.run.linkside import LinkSide
from zacoustic.run.permitlog import PermitLog
from zacoustic.run.replacement.intact import Intact
from zacoustic.run.replacement.replacement import Replacement

# Rounds of polling before other callbacks of the loop get their turn: an application may answer
# each event with a command that causes the next one.
_ROUNDS_LIMIT: Final = 1000

_logger = logging.getLogger(__name__)

SUBMIT_LIMIT: Final = 1024
"""Most commands that wait for the loop."""

T = TypeVar("T")
LinkWatch: TypeAlias = Callable[[ReceivedFrame | Transmission | TransmitReport, int], None]
"""Observes what passes between engine and link, with the instant; on the loop, must not raise."""
Command: TypeAlias = Callable[[Engine, int], object]
"""A command for the engine, with the instant; runs on the loop and does not block."""


class LinkRunner:
    """Runs one engine on its links.

    Call all methods except `submit` on the thread of the loop.

    Args:
        engine: The engine; no other caller may touch it from now on. An `Intact` one that raises is
            replaced by the next of its kind; any other stops the runner.
        link: Its first link, not open yet.
        beside: Its other links, by their names for the engine.
        clocks: Source of instants and UTC.
        journal: Stores writes, already recovered; None: writes count as committed at once. Closed
            with the runner.
        permit_log: Takes each emission, or None. Closed with the runner.
        waits_for_link: Whether to start, and to wait for the first link, if it cannot be opened.
    """

    def __init__(
        self,
        engine: Engine | Intact,
        link: Link,
        *,
        beside: Mapping[str, Link] = MappingProxyType({}),
        clocks: NodeClocks | None = None,
        journal: Journal | None = None,
        permit_log: PermitLog | None = None,
        waits_for_link: bool = False,
    ) -> None:
        self._first = engine if isinstance(engine, Intact) else None
        self.engine: Engine = engine.engine if isinstance(engine, Intact) else engine
        self._first_side = LinkSide(link, None, self)
        self.sides = (
            self._first_side, *(LinkSide(each, name, self) for name, each in beside.items()),
        )  # fmt: skip
        """The links, the first one first; read only."""
        self.failure: Exception | None = None
        self.watch: LinkWatch | None = None
        """Set it to observe what passes between engine and link."""
        self.before_frames: Command | None = None
        """Set it to give the engine what it should know before it makes a frame; must not raise."""
        self._clocks = clocks or NodeClocks()
        self._deliver: Callable[[Event], None] = _ignore
        self._settled: Callable[[], None] = _nothing
        self._replacement = None if self._first is None else Replacement(self._first)
        self._is_beginning = False
        self._has_started = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._alarm = Alarm(self._clocks.clock, self._expire)
        self._is_servicing = False
        self._is_closing = False
        self._is_deaf = False
        self._ended, self._closed = asyncio.Event(), asyncio.Event()
        self._inbox: Inbox[Command] | None = None
        self._permit_log = permit_log
        self._waits_for_link = waits_for_link
        self._journal: JournalThread | None = None
        if journal is not None:
            self._journal = JournalThread(
                journal,
                committed=self._committed,
                state_changed=self._journal_changed,
                fail=self.fail,
            )

    @property
    def link(self) -> Link:
        """The first link."""
        return self._first_side.link

    @property
    def link_state(self) -> LinkState:
        """Last reported state of the first link."""
        return self._first_side.state

    @property
    def link_detail(self) -> str:
        """What the first link waits for, by its last report."""
        return self._first_side.detail

    async def start(
        self,
        deliver: Callable[[Event], None] | None = None,
        settled: Callable[[], None] | None = None,
    ) -> None:
        """Open the links and run; returns when the first one is open.

        Another link that cannot be opened, or cannot do what the config asks of it, is reported as
        down until it can; so is the first one from then on.

        Args:
            deliver: Takes each event, on the loop; may call `apply`.
            settled: Called whenever all actions of an input are done.

        Raises:
            LinkOpenError: The first link cannot be opened; the runner is then closed. Not raised
                with `waits_for_link`.
            ConfigError: It cannot do what the config asks of it; the runner is then closed.
        """
        self._loop = asyncio.get_running_loop()
        self._deliver, self._settled = deliver or _ignore, settled or _nothing
        if self._replacement is not None:
            self._deliver = partial(self._replacement.hand_on, self._deliver, self._instant)
        self._inbox = Inbox(WakeUp(self._loop, self._take_submitted), limit=SUBMIT_LIMIT)
        if self._first is not None:
            self._keep_intact(self._first)
        self._guarded(self._tell_clock)
        if self._waits_for_link:
            self._guarded(self._service)  # its timers run while the link opens
        try:
            first, *beside = self.sides
            for side in beside:
                side.keep_opening()
            try:
                await first.link.open(first)
            except LinkOpenError:
                if not self._waits_for_link:
                    raise
                await first.link.close()
                first.keep_opening()
            self._guarded(self._service)
            if isinstance(self.failure, ZacousticError):
                raise self.failure
            self._has_started = True
        except BaseException:
            await self.close()
            raise

    async def close(self) -> None:
        """Close links, then journal; leaves no task, thread or descriptor.

        May be called again.
        """
        if self._is_closing:
            await self._closed.wait()
            return
        self._is_closing = True
        self._alarm.stop()
        try:
            try:
                if self._replacement is not None:
                    await self._replacement.stop()
                await asyncio.gather(*(side.close() for side in self.sides))
            finally:
                if self._journal is not None:
                    await self._journal.close()
                if self._permit_log is not None:
                    await self._permit_log.close()
        finally:
            self._closed.set()
            self._ended.set()

    def stop_hearing(self) -> None:
        """Drop received frames from now on, as if this were closed; it still transmits."""
        self._is_deaf = True

    def apply(self, command: Callable[[Engine, int], T]) -> T:
        """Run a command on the engine now, with all that follows from it.

        Args:
            command: Gets the engine and the instant.

        Returns:
            What the command returns.

        Raises:
            LinkClosedError: The runner is closed, has failed, or is replacing the engine.
        """
        self._check_running()
        try:
            return command(self.engine, self._instant())
        finally:
            self._guarded(self._service)

    def try_apply(self, command: Callable[[Engine, int], T]) -> T | None:
        """Do as `apply` if the engine runs; otherwise return None."""
        with contextlib.suppress(LinkClosedError):
            return self.apply(command)
        return None

    def keep(self, key: str, value: bytes | None) -> None:
        """Journal an entry besides the engine's; None deletes it."""
        if self._journal is not None:
            self._journal.put(JournalWrite(write_id=NO_WRITE, key=key, value=value))

    def submit(self, command: Command) -> bool:
        """Hand over a command from another thread; it runs on the loop soon.

        A `ZacousticError` that it raises is logged.

        Returns:
            False if `SUBMIT_LIMIT` commands wait already, or the runner does not run.
        """
        return self._inbox is not None and not self._is_closing and self._inbox.put(command)

    async def wait_failed(self) -> None:
        """Wait until the runner ends.

        Raises:
            Exception: The error that stopped it, if it was not closed.
        """
        await self._ended.wait()
        if self.failure is not None:
            raise self.failure

    # What the link calls

    def take_frame(self, side: LinkSide, frame: ReceivedFrame) -> None:
        """Give a frame to the engine."""
        if self.watch is not None:
            self.watch(frame, self._instant())
        now = self._instant()
        replacement = self._replacement
        if self._is_deaf:
            return
        if replacement is not None and replacement.faults.refuses(frame.frame_bytes, now):
            return
        self._guarded(
            lambda: self.engine.handle_frame(frame, now, *side.by), frame=frame.frame_bytes
        )
        self._guarded(self._service)

    def take_report(self, side: LinkSide, report: TransmitReport) -> None:
        """Give a report to the engine, and to the permit log."""
        if self.watch is not None:
            self.watch(report, self._instant())
        sent = side.on_air.pop(report.transmission_id, None)
        self._strictly(lambda: self._log_emission(sent, report))
        if report.transmission_id in side.foreign:  # a former engine's transmission
            side.foreign.discard(report.transmission_id)
            if not side.foreign:  # the modem is free now
                self._guarded(partial(self._connect_side, side), self._service)
            return
        self._guarded(
            lambda: self.engine.handle_transmit_report(report, self._instant(), *side.by),
            self._service,
        )

    def take_state(self, side: LinkSide, state: LinkState, detail: str) -> None:
        """Report a state to the engine, and log it."""
        is_first = state is LinkState.OPENING and not side.detail  # the detail follows
        is_known = is_first or (state, detail) == (side.state, side.detail)
        level = logging.INFO if state is LinkState.UP or is_known else logging.WARNING
        link = "link" if len(self.sides) == 1 else side.name or self.engine.links[0]
        _logger.log(level, "node %d: %s %s: %s", self.engine.address, link, state.value, detail)
        side.state, side.detail, side.is_busy = state, detail, False
        self._guarded(partial(self._connect_side, side), self._service)

    def take_carrier(self, side: LinkSide, busy: bool) -> None:
        """Tell the engine whether another node is audible."""
        side.is_busy = busy
        self._guarded(
            lambda: self.engine.handle_carrier(busy, self._instant(), *side.by), self._service
        )

    def take_measurement(self, side: LinkSide, measurement: Measurement) -> None:
        """Give a measurement to the engine."""
        self._guarded(
            lambda: self.engine.handle_measurement(measurement, self._instant(), *side.by),
            self._service,
        )

    # Driving the engine

    def _service(self) -> None:
        """Poll until dry, then arm the timer."""
        if self._is_servicing:
            return  # a command from within an event: the loop below continues
        self._is_servicing = True
        try:
            self._tell_clock()
            if self.before_frames is not None and not self._is_closing:
                self.before_frames(self.engine, self._clocks.now)
            for _ in range(_ROUNDS_LIMIT):
                if not self._poll():
                    self._alarm.set(None if self._is_closing else self.engine.poll_timeout())
                    self._settled()
                    return
        finally:
            self._is_servicing = False
        asyncio.get_running_loop().call_soon(self._guarded, self._service)

    def _poll(self) -> bool:
        """Take one of each output; return whether there was any."""
        write = self.engine.poll_journal()
        if write is not None:
            self._keep(write)
        transmission = None if self._is_closing else self.engine.poll_transmit(self._clocks.now)
        if transmission is not None:
            side = self.side(transmission.link)
            side.on_air[transmission.transmission_id] = transmission
            if self.watch is not None:
                self.watch(transmission, self._clocks.now)
            self._strictly(lambda: side.link.transmit(transmission))
        event = self.engine.poll_event()
        if event is not None:
            self._deliver(event)
        return not (write is None and transmission is None and event is None)

    def _tell_clock(self) -> None:
        self._clocks.tell(self.engine)

    def _log_emission(self, sent: Transmission | None, report: TransmitReport) -> None:
        offset_ns = self._clocks.utc_offset_ns()
        if self._permit_log is not None and sent is not None and offset_ns is not None:
            self._permit_log.note_report(self.engine, sent, report, offset_ns)

    def _expire(self, due_at: int) -> None:
        # The loop may be early by its resolution; the due instant counts.
        self._clocks.now = max(self._instant(), due_at)
        self._guarded(
            lambda: self.engine.handle_timeout(self._clocks.now),
            self._service,
            lambda: self._alarm.see_progress(self.engine.poll_timeout(), self._clocks.now),
        )

    def _instant(self) -> int:
        return self._clocks.instant()

    def _take_submitted(self) -> None:
        if self._is_replacing:
            return  # the next engine takes them
        if self._inbox is None or self._is_closing:
            return
        commands = self._inbox.take()
        # Served once for all commands: they may share a frame.
        self._guarded(*(lambda command=command: self._execute(command) for command in commands))
        self._guarded(self._service)

    def _execute(self, command: Command) -> None:
        try:
            command(self.engine, self._instant())
        except ZacousticError as error:
            _logger.warning("node %d: %s", self.engine.address, error)

    def _keep(self, write: JournalWrite) -> None:
        """Pass a write to the journal."""
        if self._journal is None:
            self._note_journalled(write)
            self.engine.handle_journal_committed(write.write_id, self._clocks.now)
        else:
            self._journal.put(write)

    def _committed(self, group: Sequence[JournalWrite]) -> None:
        now = self._instant()
        for each in group:
            self._note_journalled(each)
            self._guarded(partial(self.engine.handle_journal_committed, each.write_id, now))
        self._guarded(self._service)

    def _journal_changed(self, failure: str) -> None:
        if failure:
            _logger.error("node %d: what is reliable waits: %s", self.engine.address, failure)
        else:
            _logger.info("node %d: the journal can be written again", self.engine.address)
        self._guarded(
            lambda: self.engine.handle_journal_state(failure, self._instant()), self._service
        )

    def _note_journalled(self, write: JournalWrite) -> None:
        if self._replacement is not None:
            self._replacement.committed(write)

    # Handling exceptions

    def _guarded(self, *steps: Callable[[], None], frame: bytes | None = None) -> None:
        """Run steps of the engine at the top of a callback; replace an engine that raises."""
        if self.failure is not None or self._is_replacing:
            return
        try:
            for step in steps:
                step()
        except (ConfigError, RangeUnavailableError) as error:
            self.fail(error)  # the first link cannot do what the config asks of it
        except Exception as error:  # of the engine or of the receiver of its events: a bug
            if self._replacement is None:
                self.fail(error)
            elif self.failure is None:
                self._lose_engine(self._replacement, error, frame)

    def _strictly(self, step: Callable[[], None]) -> None:
        """Run a step outside of the engine; an exception stops the runner."""
        try:
            step()
        except Exception as error:  # of the link or a file: a bug
            self.fail(error)

    def _lose_engine(self, next_one: Replacement, error: Exception, frame: bytes | None) -> None:
        """Give the engine up and start making the next one."""
        self._alarm.stop()
        for side in self.sides:
            side.foreign = set(side.on_air)
        pause_s = next_one.faults.note(error, self._instant(), frame=frame)
        trial = self._try if self._is_beginning else None

        def tell(engine: Engine) -> None:
            for event in next_one.news(engine, error, self._instant()):
                self._deliver(event)
            if self._journal is not None and self._journal.failure:
                engine.handle_journal_state(self._journal.failure, self._instant())

        def begin(made: Intact) -> None:
            self.engine = made.engine
            self._keep_intact(made)
            self._is_beginning = True
            steps = partial(tell, made.engine), self._tell_clock, self._connect, self._service
            self._guarded(*steps)
            self._is_beginning = False
            self._take_submitted()

        next_one.begin(self.engine, pause_s, self._journal, trial, self._instant, begin)

    def _try(self, engine: Engine) -> None:
        """Do the first step with a disposable engine, since another one has raised in it.

        Raises:
            Exception: This one raises as well.
        """
        now = self._instant()
        for side in self.sides:
            told = side.link.capabilities if side.state is LinkState.UP else None
            engine.handle_link_state(side.state, now, told, *side.by)
        while engine.poll_event() is not None:
            pass
        engine.poll_transmit(now)
        engine.poll_timeout()

    def _keep_intact(self, made: Intact) -> None:
        """Delete the entries from the journal that make engines raise."""
        for write in made.writes:
            self.keep(write.key, write.value)

    def _connect(self) -> None:
        """Give the states of the links to the engine."""
        for side in self.sides:
            self._connect_side(side)

    def _connect_side(self, side: LinkSide) -> None:
        """Give the state of a link to the engine, unless it transmits a frame of a former engine.

        Raises:
            ConfigError: At the start: the first link cannot do what the config asks of it.
        """
        if side.foreign and side.state is LinkState.UP:
            return
        capabilities = side.link.capabilities if side.state is LinkState.UP else None
        try:
            self.engine.handle_link_state(side.state, self._instant(), capabilities, *side.by)
        except ConfigError as error:
            if side is self._first_side and not self._has_started:
                raise
            self.take_state(side, LinkState.DOWN, str(error))
            return
        if side.is_busy:
            self.engine.handle_carrier(True, self._instant(), *side.by)

    def side(self, link: str) -> LinkSide:
        """Return a link by name."""
        return next((each for each in self.sides if each.name == link), self._first_side)

    @property
    def _is_replacing(self) -> bool:
        return self._replacement is not None and self._replacement.is_under_way

    def fail(self, error: Exception) -> None:
        """Stop running; the error comes out of `wait_failed`."""
        if not isinstance(error, ZacousticError):  # those explain themselves
            _logger.error("node %d: stopped by a fault", self.engine.address, exc_info=error)
        self.failure = error
        self._alarm.stop()
        self._ended.set()

    def _check_running(self) -> None:
        if self.failure is not None:
            raise LinkClosedError(f"the runner has failed: {self.failure}") from self.failure
        if self._is_closing or self._loop is None:
            raise LinkClosedError("the runner is not running")
        if self._is_replacing:
            raise LinkClosedError("the engine restarts after an internal error; try again")


def _ignore(event: Event) -> None:
    """Discard an event."""


def _nothing() -> None:
    """Do nothing."""
