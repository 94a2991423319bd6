"""The asyncio shell around one engine: its link, one timer, the journal's thread.

`LinkRunner` does what the contract at the top of `core/engine.py` asks of a driver and nothing
else. Every input and every command ends in `_service`: poll until dry, arm one timer. There is no
other task and no polling; an idle engine leaves the process asleep.

One thread owns the engine, that of the loop. Two things come from elsewhere:

- Commands of foreign threads (Zenoh's callbacks), by `submit`: a bounded list, and one wake-up of
  the loop if none is pending. A wake-up for each would be an unbounded queue inside the loop.
- Commits of the journal, by a future of its one worker thread (`JournalThread`). While one is under
  way, further writes collect and are committed together; one that fails is told to the engine and
  tried again.

An exception that nobody expects, in the engine, in the link's callbacks, in the receiver of events
or in the journal, is logged with its traceback, stops the runner and comes out of `wait_failed`.
"""

import asyncio
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias, TypeVar

from zacoustic.core.clock import NS_PER_S, Clock, ns_to_seconds, seconds_to_ns
from zacoustic.core.engine import Engine
from zacoustic.core.events import Event
from zacoustic.core.journal import JournalWrite
from zacoustic.core.linktypes import (
    LinkState,
    Measurement,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.errors import LinkClosedError, ZacousticError
from zacoustic.journal import Journal
from zacoustic.journal.thread import JournalThread
from zacoustic.link import Link
from zacoustic.permitlog import PermitLog, emission

SUBMIT_LIMIT: Final = 1024
"""Commands that other threads may have handed over and the loop not yet taken."""

# Rounds of polling before other callbacks of the loop get their turn: an application may answer
# each event with a command that makes the next one.
_ROUNDS_LIMIT: Final = 1000
_NO_WRITE: Final = 0
"""Write id that no engine waits for."""
# Expiries in a row after which the timer is due again at once. A sound engine has none.
_STUCK_LIMIT: Final = 1000

# The engine hears of UTC at least this often while it is driven, and when it was moved by more than
# reading two clocks one after the other may differ.
_TELL_CLOCK_NS: Final = 10 * NS_PER_S
_CLOCK_JITTER_NS: Final = NS_PER_S // 1000

_logger = logging.getLogger(__name__)

T = TypeVar("T")
LinkWatch: TypeAlias = Callable[[ReceivedFrame | Transmission | TransmitReport, int], None]
"""Sees what crosses between engine and link, with the instant; on the loop, and must not raise."""
Command: TypeAlias = Callable[[Engine, int], object]
"""Something to do with the engine, given the instant; runs on the loop and does not block."""


class LinkRunner:
    """Runs one engine on one link.

    All methods but `submit` are for the thread of the loop.

    Args:
        engine: The engine; nobody else may touch it from now on.
        link: Its link, not open yet.
        deliver: Takes each event, on the loop; may call `apply`. What it raises stops the runner.
        clock: Where instants come from; the same as the link's.
        journal: Where writes go, recovered; None: they count as committed at once. Closed with the
            runner.
        wall_clock: Tells UTC, ns since 1970; None: the engine never hears of it.
        clock_error_s: How wrong that may be, s.
        permit_log: Takes each emission, or None. Closed with the runner.
    """

    def __init__(
        self,
        engine: Engine,
        link: Link,
        deliver: Callable[[Event], None],
        *,
        clock: Clock = time.monotonic_ns,
        journal: Journal | None = None,
        wall_clock: Clock | None = None,
        clock_error_s: float = 0.0,
        permit_log: PermitLog | None = None,
    ) -> None:
        self.engine = engine
        self.link = link
        self.link_state = LinkState.OPENING
        self.link_detail = ""
        self.failure: Exception | None = None
        self.watch: LinkWatch | None = None
        """Whoever sets this sees what crosses between engine and link."""
        self.settled: Callable[[], None] | None = None
        """Whoever sets this is told each time when all has been done that an input called for."""
        self._deliver = deliver
        self._clock = clock
        self._now = 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._timer: asyncio.Handle | None = None
        self._due_at = 0
        self._stuck = 0
        self._is_servicing = False
        self._is_closing = False
        self._ended = asyncio.Event()
        self._closed = asyncio.Event()
        self._inbox: deque[Command] = deque()
        self._inbox_guard = threading.Lock()
        self._wake_pending = False
        self._wall_clock = wall_clock
        self._clock_error_ns = seconds_to_ns(clock_error_s)
        self._offset_ns = 0
        self._clock_told_at: int | None = None
        self._permit_log = permit_log
        self._on_air: Transmission | None = None
        self._journal: JournalThread | None = None
        if journal is not None:
            self._journal = JournalThread(
                journal,
                committed=self._committed,
                state_changed=self._journal_changed,
                fail=self._fail,
            )

    async def start(self) -> None:
        """Open the link and run.

        Raises:
            LinkOpenError: The link cannot be opened; the runner is closed then.
            ConfigError: The link cannot do what the config asks of it; the same.
        """
        self._loop = asyncio.get_running_loop()
        self._guarded(self._tell_clock)
        try:
            await self.link.open(self)
            self._guarded(self._service)
            if isinstance(self.failure, ZacousticError):
                raise self.failure
        except BaseException:
            await self.close()
            raise

    async def close(self) -> None:
        """Stop the link, then the journal; leaves no task, thread or descriptor.

        May be called again.
        """
        if self._is_closing:
            await self._closed.wait()
            return
        self._is_closing = True
        self._stop_timer()
        try:
            try:
                await self.link.close()
            finally:
                if self._journal is not None:
                    await self._journal.close()
                if self._permit_log is not None:
                    await self._permit_log.close()
        finally:
            self._closed.set()
            self._ended.set()

    def apply(self, command: Callable[[Engine, int], T]) -> T:
        """Run a command on the engine now, and what follows from it.

        Args:
            command: Gets the engine and the instant.

        Returns:
            What the command returns.

        Raises:
            LinkClosedError: The runner is closed or has failed.
        """
        self._check_running()
        try:
            return command(self.engine, self._instant())
        finally:
            self._guarded(self._service)

    def keep(self, key: str, value: bytes | None) -> None:
        """Write something down beside what the engine does, for the next life; None deletes it."""
        if self._journal is not None:
            self._journal.put(JournalWrite(write_id=_NO_WRITE, key=key, value=value))

    def submit(self, command: Command) -> bool:
        """Hand a command over from another thread; it runs on the loop soon.

        A `ZacousticError` that it raises is logged; any other exception stops the runner.

        Returns:
            False when `SUBMIT_LIMIT` commands wait already, or the runner does not run.
        """
        with self._inbox_guard:
            if self._is_closing or self._loop is None or len(self._inbox) >= SUBMIT_LIMIT:
                return False
            self._inbox.append(command)
            wake = not self._wake_pending
            self._wake_pending = True
        if wake:
            try:
                self._loop.call_soon_threadsafe(self._take_submitted)
            except RuntimeError:  # the loop was closed before the runner
                return False
        return True

    async def wait_failed(self) -> None:
        """Wait until the runner ends.

        Raises:
            Exception: What has stopped it, if it was not closed.
        """
        await self._ended.wait()
        if self.failure is not None:
            raise self.failure

    # What the link calls

    def frame_received(self, frame: ReceivedFrame) -> None:
        """Give a frame to the engine."""
        if self.watch is not None:
            self.watch(frame, self._instant())
        self._guarded(lambda: self.engine.handle_frame(frame, self._instant()), self._service)

    def transmit_finished(self, report: TransmitReport) -> None:
        """Give a report to the engine, and to the permit log."""
        if self.watch is not None:
            self.watch(report, self._instant())
        self._guarded(
            lambda: self._log_emission(report),
            lambda: self.engine.handle_transmit_report(report, self._instant()),
            self._service,
        )

    def state_changed(self, state: LinkState, detail: str = "") -> None:
        """Tell the engine, and people."""
        level = logging.WARNING if state is LinkState.DOWN else logging.INFO
        _logger.log(level, "node %d: link %s: %s", self.engine.address, state.value, detail)
        self.link_state, self.link_detail = state, detail
        capabilities = self.link.capabilities if state is LinkState.UP else None
        self._guarded(
            lambda: self.engine.handle_link_state(state, self._instant(), capabilities),
            self._service,
        )

    def carrier_changed(self, busy: bool) -> None:
        """Tell the engine whether somebody else is audible."""
        self._guarded(lambda: self.engine.handle_carrier(busy, self._instant()), self._service)

    def measured(self, measurement: Measurement) -> None:
        """Give a measurement to the engine."""
        self._guarded(
            lambda: self.engine.handle_measurement(measurement, self._instant()), self._service
        )

    # The driver of the engine

    def _service(self) -> None:
        """Poll until dry, then arm the timer."""
        if self._is_servicing:
            return  # an application's command from within an event: the loop below goes on
        self._is_servicing = True
        try:
            self._tell_clock()
            for _ in range(_ROUNDS_LIMIT):
                if not self._poll():
                    self._arm()
                    if self.settled is not None:
                        self.settled()
                    return
        finally:
            self._is_servicing = False
        assert self._loop is not None
        self._loop.call_soon(self._guarded, self._service)

    def _poll(self) -> bool:
        """Take one of each output; returns whether there was any."""
        write = self.engine.poll_journal()
        if write is not None:
            self._keep(write)
        transmission = None if self._is_closing else self.engine.poll_transmit(self._now)
        if transmission is not None:
            self._on_air = transmission
            if self.watch is not None:
                self.watch(transmission, self._now)
            self.link.transmit(transmission)
        event = self.engine.poll_event()
        if event is not None:
            self._deliver(event)
        return not (write is None and transmission is None and event is None)

    def _tell_clock(self) -> None:
        """Tell the engine what UTC is, when it has been moved or was not told for long."""
        if self._wall_clock is None:
            return
        now = self._instant()
        self._offset_ns, before = self._wall_clock() - self._clock(), self._offset_ns
        told_at = self._clock_told_at
        is_old = told_at is None or now - told_at >= _TELL_CLOCK_NS
        if is_old or abs(self._offset_ns - before) > _CLOCK_JITTER_NS:
            self._clock_told_at = now
            self.engine.handle_clock(self._offset_ns, self._clock_error_ns, now)
        else:
            self._offset_ns = before

    def _log_emission(self, report: TransmitReport) -> None:
        sent, self._on_air = self._on_air, None
        if self._permit_log is None or sent is None or self._wall_clock is None:
            return
        if report.outcome is TransmitOutcome.REJECTED:
            return
        modem = self.engine.measurements.modem
        self._permit_log.note(
            emission(
                node=self.engine.address,
                begun_utc_ns=report.started_at + self._wall_clock() - self._clock(),
                duration_ns=report.finished_at - report.started_at,
                source_level_db=None if modem is None else modem.source_level_db,
                frame_bytes=len(sent.frame_bytes),
                destination=sent.destination,
                outcome=report.outcome.value,
            )
        )

    def _arm(self) -> None:
        """Set the one timer to what the engine waits for."""
        due_at = self.engine.poll_timeout()
        if self._timer is not None and due_at == self._due_at:
            return
        self._stop_timer()
        if due_at is None or self._is_closing or self._loop is None:
            return
        self._due_at = due_at
        # Only differences are given to the loop: its clock need not be ours.
        delay_ns = due_at - self._clock()
        if delay_ns > 0:
            self._timer = self._loop.call_later(ns_to_seconds(delay_ns), self._expire)
        else:
            self._timer = self._loop.call_soon(self._expire)

    def _expire(self) -> None:
        self._timer = None
        # The loop may be early by its resolution: then it is the due instant that counts.
        self._now = max(self._instant(), self._due_at)
        self._guarded(
            lambda: self.engine.handle_timeout(self._now), self._service, self._see_progress
        )

    def _see_progress(self) -> None:
        """Stop an engine whose timer would spin for ever."""
        due_at = self.engine.poll_timeout()
        self._stuck = self._stuck + 1 if due_at is not None and due_at <= self._now else 0
        if self._stuck > _STUCK_LIMIT:
            raise RuntimeError(f"the engine asks for the instant {due_at} again and again")

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _instant(self) -> int:
        """Return the present instant; never decreases."""
        self._now = max(self._now, self._clock())
        return self._now

    def _take_submitted(self) -> None:
        with self._inbox_guard:
            commands = tuple(self._inbox)
            self._inbox.clear()
            self._wake_pending = False
        if self._is_closing:
            return
        # Served once for all of them: they may share a frame.
        self._guarded(*(lambda command=command: self._obey(command) for command in commands))
        self._guarded(self._service)

    def _obey(self, command: Command) -> None:
        try:
            command(self.engine, self._instant())
        except ZacousticError as error:
            _logger.warning("node %d: %s", self.engine.address, error)

    def _keep(self, write: JournalWrite) -> None:
        """Bring a write to the journal."""
        if self._journal is None:
            self.engine.handle_journal_committed(write.write_id, self._now)
        else:
            self._journal.put(write)

    def _committed(self, group: Sequence[JournalWrite]) -> None:
        now = self._instant()
        for write in group:
            self.engine.handle_journal_committed(write.write_id, now)
        self._service()

    def _journal_changed(self, failure: str) -> None:
        if failure:
            _logger.error("node %d: what is reliable waits: %s", self.engine.address, failure)
        else:
            _logger.info("node %d: the journal can be written again", self.engine.address)
        self.engine.handle_journal_state(failure, self._instant())
        self._service()

    def _guarded(self, *steps: Callable[[], None]) -> None:
        """Run steps at the top of a callback: an unexpected exception stops the runner."""
        if self.failure is not None:
            return
        try:
            for step in steps:
                step()
        except Exception as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        if not isinstance(error, ZacousticError):  # those say by themselves what is wrong
            _logger.error("node %d: stopped by a fault", self.engine.address, exc_info=error)
        self.failure = error
        self._stop_timer()
        self._ended.set()

    def _check_running(self) -> None:
        if self.failure is not None:
            raise LinkClosedError(f"the runner has failed: {self.failure}") from self.failure
        if self._is_closing or self._loop is None:
            raise LinkClosedError("the runner is not running")
