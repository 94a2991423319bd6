import asyncio
import random
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Self, cast

import pytest

from tests.runtime.loop_checks import run, until
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.base.journal import EPOCH_KEY, LIFE_KEY, VOLATILE_KEY, JournalWrite
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, LinkStateChanged, SampleReceived
from zacoustic.core.linktypes import (
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import LinkClosedError, LinkOpenError, LocalError
from zacoustic.link import Link, LinkConfig, LinkReceiver
from zacoustic.run.clocks import NodeClocks
from zacoustic.run.journal import EPOCHS, JournalState, MemoryJournal
from zacoustic.run.runner import SUBMIT_LIMIT, LinkRunner
from zacoustic_sim.medium import SimMedium

CAPABILITIES = LinkCapabilities(mtu_bytes=64, bit_rate_bps=1e6)


class ScriptedLink(Link):
    """Comes up at once; each transmission is finished by the next turn of the loop."""

    def __init__(self, *, opens: bool = True) -> None:
        self.sent: list[Transmission] = []
        self.receiver: LinkReceiver | None = None
        self.opens = opens
        self.closed = 0

    @classmethod
    def from_locator(cls, address: str, config: LinkConfig, *, node_address: int) -> Self:
        return cls()

    async def open(self, receiver: LinkReceiver) -> None:
        if not self.opens:
            raise LinkOpenError("the port is in use")
        self.receiver = receiver
        self.capabilities = CAPABILITIES
        receiver.state_changed(LinkState.UP, "scripted")

    async def close(self) -> None:
        self.closed += 1

    def transmit(self, transmission: Transmission) -> None:
        self.sent.append(transmission)
        asyncio.get_running_loop().call_soon(self._finish, transmission.transmission_id)

    def _finish(self, transmission_id: int) -> None:
        assert self.receiver is not None
        now = time.monotonic_ns()
        self.receiver.transmit_finished(
            TransmitReport(
                transmission_id=transmission_id,
                outcome=TransmitOutcome.SENT,
                started_at=now,
                finished_at=now,
            )
        )


class ScriptedEngine:
    """Does what a test tells it, and keeps what it hears."""

    address = 1

    def __init__(self) -> None:
        self.heard: list[tuple[Any, ...]] = []
        self.instants: list[int] = []
        self.transmissions: deque[Transmission] = deque()
        self.writes: deque[JournalWrite] = deque()
        self.events: deque[Any] = deque()
        self.due_at: int | None = None
        self.on_timeout: Callable[[int], None] = lambda now: None
        self.changed = asyncio.Event()

    def _hear(self, now: int, *what: Any) -> None:
        self.heard.append(what)
        self.instants.append(now)
        self.changed.set()

    def handle_frame(self, frame: ReceivedFrame, now: int) -> None:
        self._hear(now, "frame", frame.frame_bytes)

    def handle_transmit_report(self, report: TransmitReport, now: int) -> None:
        self._hear(now, "report", report.transmission_id)

    def handle_link_state(
        self, state: LinkState, now: int, capabilities: LinkCapabilities | None = None
    ) -> None:
        self._hear(now, "state", state, capabilities)

    def handle_carrier(self, busy: bool, now: int) -> None:
        self._hear(now, "carrier", busy)

    def handle_timeout(self, now: int) -> None:
        self.due_at = None
        self._hear(now, "timeout")
        self.on_timeout(now)

    def handle_journal_committed(self, write_id: int, now: int) -> None:
        self._hear(now, "committed", write_id)

    def handle_journal_state(self, failure: str, now: int) -> None:
        self._hear(now, "journal", failure)

    def poll_transmit(self, now: int) -> Transmission | None:
        self.instants.append(now)
        return self.transmissions.popleft() if self.transmissions else None

    def poll_journal(self) -> JournalWrite | None:
        return self.writes.popleft() if self.writes else None

    def poll_event(self) -> Any:
        return self.events.popleft() if self.events else None

    def poll_timeout(self) -> int | None:
        return self.due_at


def scripted(engine: ScriptedEngine, link: Link, **more: Any) -> LinkRunner:
    return LinkRunner(cast(Engine, engine), link, **more)


def act(change: Callable[[ScriptedEngine], Any]) -> Callable[[Engine, int], Any]:
    """Make a command for the scripted engine."""
    return lambda engine, now: change(cast(ScriptedEngine, engine))


def test_all_that_the_link_says_reaches_the_engine_in_order() -> None:
    async def main() -> None:
        engine, link = ScriptedEngine(), ScriptedLink()
        runner = scripted(engine, link)
        await runner.start()
        runner.sides[0].frame_received(ReceivedFrame(frame_bytes=b"f", received_at=0))
        runner.sides[0].carrier_changed(True)
        runner.sides[0].state_changed(LinkState.DOWN, "pulled out")
        assert (runner.link_state, runner.link_detail) == (LinkState.DOWN, "pulled out")
        await runner.close()
        await runner.close()
        assert engine.heard == [
            ("state", LinkState.UP, CAPABILITIES),
            ("frame", b"f"),
            ("carrier", True),
            ("state", LinkState.DOWN, None),
        ]
        assert engine.instants == sorted(engine.instants)

    run(main())


def test_outputs_are_polled_until_dry_after_each_command() -> None:
    async def main() -> None:
        engine, link = ScriptedEngine(), ScriptedLink()
        delivered: list[object] = []
        runner = scripted(engine, link)
        await runner.start(delivered.append)
        engine.transmissions.extend(
            Transmission(transmission_id=at, frame_bytes=b"x") for at in range(3)
        )
        engine.events.extend(["one", "two"])
        assert runner.apply(act(lambda engine: "result")) == "result"
        assert [each.transmission_id for each in link.sent] == [0, 1, 2]
        assert delivered == ["one", "two"]
        await until(lambda: ("report", 2) in engine.heard, engine.changed)
        await runner.close()

    run(main())


def test_event_may_be_answered_by_a_command_at_once() -> None:
    async def main() -> None:
        engine = ScriptedEngine()
        delivered: list[int] = []

        def deliver(event: Any) -> None:
            delivered.append(event)
            if event < 5000:  # more than one turn of the loop takes
                runner.apply(act(lambda engine: engine.events.append(event + 1)))
            else:
                finished.set()

        runner, finished = scripted(engine, ScriptedLink()), asyncio.Event()
        await runner.start(deliver)
        runner.apply(act(lambda engine: engine.events.append(0)))
        await finished.wait()
        await runner.close()
        assert delivered == list(range(5001))

    run(main())


def test_timer_that_fires_early_passes_the_due_instant() -> None:
    async def main() -> None:
        standing = time.monotonic_ns()
        engine = ScriptedEngine()
        runner = scripted(engine, ScriptedLink(), clocks=NodeClocks(lambda: standing))
        await runner.start()
        due_at = standing + 2_000_000  # the clock stands: for it the timer is early
        runner.apply(act(lambda engine: setattr(engine, "due_at", due_at)))
        await until(lambda: ("timeout",) in engine.heard, engine.changed)
        at = engine.heard.index(("timeout",))
        assert due_at in engine.instants[at:]
        runner.sides[0].carrier_changed(True)
        assert engine.instants[-1] >= due_at, "now has decreased"
        await runner.close()

    run(main())


def test_timer_is_rearmed_when_the_engine_wants_an_earlier_or_no_instant() -> None:
    async def main() -> None:
        engine = ScriptedEngine()
        runner = scripted(engine, ScriptedLink())
        await runner.start()
        now = time.monotonic_ns()
        runner.apply(act(lambda engine: setattr(engine, "due_at", now + 1_000_000)))
        runner.apply(act(lambda engine: setattr(engine, "due_at", None)))
        runner.apply(act(lambda engine: setattr(engine, "due_at", now + 10**12)))
        due_at = now + 5_000_000  # a timer that was not stopped would fire before
        runner.apply(act(lambda engine: setattr(engine, "due_at", due_at)))
        await until(lambda: ("timeout",) in engine.heard, engine.changed)
        assert engine.heard.count(("timeout",)) == 1
        assert engine.instants[-1] >= due_at
        await runner.close()

    run(main())


def test_engine_that_asks_for_the_same_instant_for_ever_is_stopped() -> None:
    async def main() -> None:
        engine = ScriptedEngine()
        runner = scripted(engine, ScriptedLink())
        engine.on_timeout = lambda now: setattr(engine, "due_at", now)
        await runner.start()
        runner.apply(act(lambda engine: setattr(engine, "due_at", 1)))
        with pytest.raises(RuntimeError, match="again and again"):
            await runner.wait_failed()
        await runner.close()

    run(main())


def test_commands_of_other_threads_run_on_the_loop_with_one_wake_up() -> None:
    async def main() -> None:
        engine = ScriptedEngine()
        runner = scripted(engine, ScriptedLink())
        assert not runner.submit(act(lambda engine: None)), "not started"
        await runner.start()
        loop, wakes = asyncio.get_running_loop(), 0
        wake = loop.call_soon_threadsafe

        def counted(*arguments: Any, **more: Any) -> Any:
            nonlocal wakes
            wakes += 1
            return wake(*arguments, **more)

        loop.call_soon_threadsafe = counted  # type: ignore[assignment,method-assign]
        seen: list[tuple[int, int]] = []
        done, taken = threading.Event(), asyncio.Event()

        def note(number: int) -> Callable[[ScriptedEngine], None]:
            def change(_: ScriptedEngine) -> None:
                seen.append((number, threading.get_ident()))
                taken.set()

            return change

        accepted: list[bool] = []

        def submit_all() -> None:
            accepted.extend(runner.submit(act(note(at))) for at in range(SUBMIT_LIMIT + 5))
            done.set()

        thread = threading.Thread(target=submit_all)
        thread.start()
        done.wait(10.0)  # the loop stands meanwhile
        thread.join()
        assert wakes == 1
        assert accepted == [True] * SUBMIT_LIMIT + [False] * 5
        await until(lambda: len(seen) == SUBMIT_LIMIT, taken)
        assert seen == [(at, threading.get_ident()) for at in range(SUBMIT_LIMIT)]
        await runner.close()
        assert not runner.submit(act(lambda engine: None)), "closed"

    run(main())


def test_misuse_in_a_submitted_command_is_logged_and_stops_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        engine, done = ScriptedEngine(), asyncio.Event()
        runner = scripted(engine, ScriptedLink())
        await runner.start()

        def misuse(_: ScriptedEngine) -> None:
            raise LocalError("a payload of 99 bytes; allowed: 64")

        runner.submit(act(misuse))
        runner.submit(act(lambda engine: done.set()))
        await done.wait()
        assert runner.failure is None
        await runner.close()

    run(main())
    assert "node 1: a payload of 99 bytes; allowed: 64" in caplog.text


@pytest.mark.parametrize("place", ["frame", "deliver", "submit", "commit"])
def test_unexpected_exception_is_logged_with_traceback_and_surfaces(
    place: str, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(*arguments: Any) -> None:
        raise KeyError("a bug")

    async def main() -> None:
        engine, journal = ScriptedEngine(), RecordingJournal()
        runner = scripted(engine, ScriptedLink(), journal=journal)
        await runner.start(fail)
        if place == "frame":
            engine.handle_frame = fail  # type: ignore[assignment,method-assign]
            runner.sides[0].frame_received(ReceivedFrame(frame_bytes=b"f", received_at=0))
        elif place == "deliver":
            runner.apply(act(lambda engine: engine.events.append("event")))
        elif place == "submit":
            runner.submit(act(fail))
        else:
            journal.commit = fail  # type: ignore[assignment,method-assign]
            write = JournalWrite(write_id=1, key="k", value=b"")
            runner.apply(act(lambda engine: engine.writes.append(write)))
        with pytest.raises(KeyError, match="a bug"):
            await runner.wait_failed()
        with pytest.raises(LinkClosedError, match="has failed"):
            runner.apply(act(lambda engine: None))
        await runner.close()

    run(main())
    assert "stopped by a fault" in caplog.text
    assert "Traceback" in caplog.text


def test_link_that_cannot_be_opened_leaves_nothing_behind() -> None:
    async def main() -> None:
        link = ScriptedLink(opens=False)
        runner = scripted(ScriptedEngine(), link, journal=RecordingJournal())
        with pytest.raises(LinkOpenError, match="in use"):
            await runner.start()
        assert link.closed == 1
        with pytest.raises(LinkClosedError, match="not running"):
            runner.apply(act(lambda engine: None))
        await runner.wait_failed()

    run(main())


class RecordingJournal:
    """Commits when the test allows it."""

    def __init__(self) -> None:
        self.groups: list[tuple[str, ...]] = []
        self.threads: set[int] = set()
        self.allowed = threading.Event()
        self.allowed.set()
        self.begun = threading.Event()
        self.closed = 0

    def recover(self) -> JournalState:
        return JournalState(boot_epoch=7)

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        self.begun.set()
        assert self.allowed.wait(10.0)
        self.threads.add(threading.get_ident())
        self.groups.append(tuple(write.key for write in writes))

    def close(self) -> None:
        self.threads.add(threading.get_ident())
        self.closed += 1


def test_journal_commits_in_one_thread_and_groups_what_waits() -> None:
    async def main() -> None:
        engine, journal = ScriptedEngine(), RecordingJournal()
        runner = scripted(engine, ScriptedLink(), journal=journal)
        await runner.start()
        journal.allowed.clear()
        for at in range(4):
            write = JournalWrite(write_id=at, key=f"k{at}", value=b"")
            runner.apply(act(lambda engine, write=write: engine.writes.append(write)))  # type: ignore[misc]
            await asyncio.to_thread(journal.begun.wait, 10.0)
        assert not [what for what in engine.heard if what[0] == "committed"]
        journal.allowed.set()
        await until(lambda: ("committed", 3) in engine.heard, engine.changed)
        committed = [what[1] for what in engine.heard if what[0] == "committed"]
        assert committed == [0, 1, 2, 3]
        assert journal.groups == [("k0",), ("k1", "k2", "k3")]
        await runner.close()
        assert journal.closed == 1
        assert len(journal.threads) == 1
        assert threading.get_ident() not in journal.threads

    run(main())


def test_close_waits_for_the_commit_that_is_under_way() -> None:
    async def main() -> None:
        engine, journal = ScriptedEngine(), RecordingJournal()
        runner = scripted(engine, ScriptedLink(), journal=journal)
        await runner.start()
        journal.allowed.clear()
        write = JournalWrite(write_id=1, key="k", value=b"")
        runner.apply(act(lambda engine: engine.writes.append(write)))
        closing = asyncio.ensure_future(runner.close())
        await asyncio.to_thread(journal.begun.wait, 10.0)
        assert not closing.done()
        journal.allowed.set()
        await closing
        assert journal.groups == [("k",)]

    run(main())


def test_commit_that_fails_is_told_to_the_engine_and_tried_again(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zacoustic.run.journal.thread.FIRST_RETRY_S", 0.001)

    async def main() -> None:
        engine, journal = ScriptedEngine(), RecordingJournal()
        runner = scripted(engine, ScriptedLink(), journal=journal)
        await runner.start()
        commit, failures = journal.commit, [OSError("the disk is full")] * 3

        def fail(writes: Sequence[JournalWrite]) -> None:
            if failures:
                raise failures.pop()
            commit(writes)

        journal.commit = fail  # type: ignore[method-assign]
        write = JournalWrite(write_id=1, key="k", value=b"")
        runner.apply(act(lambda engine: engine.writes.append(write)))
        await until(lambda: ("committed", 1) in engine.heard, engine.changed)
        assert engine.heard[1:] == [
            ("journal", "the disk is full"),
            ("journal", ""),
            ("committed", 1),
        ]
        assert runner.failure is None
        await runner.close()

    run(main())
    assert "node 1: what is reliable waits: the disk is full" in caplog.text


def test_memory_journal_draws_an_epoch_and_keeps_writes_for_its_life() -> None:
    epochs = {MemoryJournal().recover().boot_epoch for _ in range(50)}
    assert len(epochs) > 1
    assert all(0 <= epoch < EPOCHS for epoch in epochs)
    journal = MemoryJournal()
    first = journal.recover().boot_epoch
    journal.commit([JournalWrite(write_id=at, key="k", value=bytes([at])) for at in range(2)])
    second = journal.recover()
    assert second.boot_epoch % 64 == (first + 1) % 64
    assert second.entries == {
        "k": b"\x01",
        EPOCH_KEY: second.boot_epoch.to_bytes(2, "big"),
        LIFE_KEY: (2).to_bytes(8, "big"),
        VOLATILE_KEY: b"",
    }
    for _ in range(2):  # what is not there may be deleted, too
        journal.commit([JournalWrite(write_id=3, key="k", value=None)])
    assert set(journal.recover().entries) == {EPOCH_KEY, LIFE_KEY, VOLATILE_KEY}
    journal.close()


def test_sample_goes_from_engine_to_engine_through_simulated_channel() -> None:
    async def main() -> None:
        channel = Scenario(
            channel="none",
            nodes=(
                NodeSpec(address=1, position=(0.0, 0.0, 10.0)),
                NodeSpec(address=2, position=(300.0, 0.0, 10.0)),
            ),
        )
        medium = SimMedium(channel, time_scale=100.0)
        spec = TopicSpec(stream_id=10, name="auv1/depth")
        arrived, events = asyncio.Event(), []

        def deliver(event: Event) -> None:
            events.append(event)
            arrived.set()

        runners = []
        for address in (1, 2):
            journal = MemoryJournal()
            engine = Engine(
                address=address,
                table=StreamTable([spec]),
                epoch=journal.recover().boot_epoch,
                rng=random.Random(address),
            )
            runner = LinkRunner(engine, medium.link(address), journal=journal)
            await runner.start(deliver)
            runners.append(runner)
        runners[0].apply(lambda engine, now: engine.publish(10, b"\x2a", now))

        def samples() -> list[SampleReceived]:
            return [event for event in events if isinstance(event, SampleReceived)]

        await until(samples, arrived)
        assert [(each.source, each.value) for each in samples()] == [(1, b"\x2a")]
        assert any(isinstance(event, LinkStateChanged) for event in events)
        for runner in runners:
            await runner.close()
        medium.close()

    run(main())
