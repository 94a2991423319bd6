"""An engine that raises is replaced; nothing that was asked of it ends without a word."""

import asyncio
import itertools
import logging
import random
import time
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, Self, TypeVar

import pytest

from tests.runtime.loop_checks import run, until
from zacoustic.core.base.journal import JournalWrite
from zacoustic.core.base.qos import Forward, Qos, Reliability
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    CallFailure,
    DeliveryEnded,
    DeliveryOutcome,
    DeliveryStored,
    EngineRestarted,
    Event,
    JournalDoubted,
)
from zacoustic.core.linktypes import (
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.peers.ranging import RangeFailed
from zacoustic.core.streams.commands import COMMANDS_STREAM_ID, RemoteCommand
from zacoustic.core.streams.routing import ROUTING_STREAM_ID
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.status import STATUS_STREAM_ID
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.events import GoalAnswered, GoalFailed, GoalRecovered
from zacoustic.core.wire.routing import RoutingKind, RoutingRequest
from zacoustic.link import Link, LinkConfig, LinkReceiver
from zacoustic.run.journal import MemoryJournal
from zacoustic.run.replacement.faults import FREE, REPORT
from zacoustic.run.replacement.intact import Intact
from zacoustic.run.runner import LinkRunner

E = TypeVar("E")

RELIABLE = Qos(reliability=Reliability.RELIABLE, depth=8)
SPECS = (
    TopicSpec(stream_id=10, name="depth"),
    TopicSpec(stream_id=11, name="kept", qos=RELIABLE, journal=True),
    TopicSpec(stream_id=12, name="light", qos=RELIABLE, journal=False),
    TopicSpec(stream_id=13, name="asked", qos=Qos(forward=Forward.ON_DEMAND)),
    ServiceSpec(stream_id=20, name="arm", server=2),
    ActionSpec(stream_id=30, name="goto", server=2),
)
POISON = b"\xbf\xff"


class BrittleEngine(Engine):
    """Has a bug: it raises at certain frames."""

    def handle_frame(self, frame: ReceivedFrame, now: int, link: str | None = None) -> None:
        super().handle_frame(frame, now, link)
        if frame.frame_bytes.startswith(POISON):
            raise KeyError("a bug")


class QuietLink(Link):
    """Is up at once; a transmission ends when the test says so."""

    def __init__(self) -> None:
        self.sent: list[Transmission] = []
        self.changed = asyncio.Event()
        self.under_way: list[Transmission] = []
        self.receiver: LinkReceiver | None = None
        self.finishes = True

    @classmethod
    def from_locator(cls, address: str, config: LinkConfig, *, node_address: int) -> Self:
        return cls()

    async def open(self, receiver: LinkReceiver) -> None:
        self.receiver = receiver
        self.capabilities = LinkCapabilities(
            mtu_bytes=64,
            bit_rate_bps=1e6,
            propagation_s=0.0,
            acknowledges=True,
            measures=frozenset({"range_m"}),
            measures_range=True,
        )
        receiver.state_changed(LinkState.UP, "quiet")

    async def close(self) -> None:
        pass

    def transmit(self, transmission: Transmission) -> None:
        assert not self.under_way, "two frames at once"
        self.sent.append(transmission)
        self.changed.set()
        self.under_way.append(transmission)
        if self.finishes:
            asyncio.get_running_loop().call_soon(self.finish)

    def finish(self) -> None:
        assert self.receiver is not None
        now = time.monotonic_ns()
        sent = self.under_way.pop()
        self.receiver.transmit_finished(
            TransmitReport(
                transmission_id=sent.transmission_id,
                outcome=TransmitOutcome.SENT,
                started_at=now,
                finished_at=now,
            )
        )

    def hear(self, frame_bytes: bytes) -> None:
        assert self.receiver is not None
        self.receiver.frame_received(
            ReceivedFrame(frame_bytes=frame_bytes, received_at=time.monotonic_ns(), source=2)
        )


class Bench:
    """A runner with such an engine and link, and what it has told."""

    def __init__(self, engine_type: type[Engine], journal: MemoryJournal | None) -> None:
        self.events: list[Event] = []
        self.changed = asyncio.Event()
        self.link = QuietLink()
        self.fails = False
        self.made_in_vain = 0
        """So many engines cannot be made, whatever the journal has."""
        self.journal = journal or MemoryJournal()
        table = StreamTable(SPECS, nodes={1: "a", 2: "b"})

        def renew(epoch: int, stored: Mapping[str, bytes]) -> Engine:
            if self.made_in_vain:
                self.made_in_vain -= 1
                raise MemoryError("for a while")
            rng = random.Random(epoch)
            return engine_type(address=1, table=table, epoch=epoch, rng=rng, stored=stored)

        state = self.journal.recover()
        first = Intact(renew, state.boot_epoch, state.entries)
        self.runner = LinkRunner(first, self.link, journal=self.journal)

    def take(self, event: Event) -> None:
        self.events.append(event)
        self.changed.set()
        if self.fails:
            raise ValueError("a bug of the receiver")

    def got(self, *kinds: type[E]) -> list[E]:
        return [event for event in self.events if isinstance(event, kinds)]

    async def restarted(self, times: int = 1) -> None:
        await until(lambda: len(self.got(EngineRestarted)) >= times, self.changed)


def on_a_bench(
    main: Callable[[Bench], Awaitable[None]],
    engine_type: type[Engine] = BrittleEngine,
    journal: MemoryJournal | None = None,
) -> None:
    async def whole() -> None:
        bench = Bench(engine_type, journal)
        await bench.runner.start(bench.take)
        await main(bench)
        assert bench.runner.failure is None
        await bench.runner.close()

    run(whole())


def test_frame_that_raises_is_logged_in_hex_and_the_engine_goes_on(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main(bench: Bench) -> None:
        before = bench.runner.engine.epoch
        bench.link.hear(POISON + b"\x01\x02")
        await bench.restarted()
        engine = bench.runner.engine
        assert engine.epoch == (before + 1) % 65536
        assert engine.stats.dropped["internal_error"] == 1
        bench.runner.apply(lambda engine, now: engine.publish(10, b"\x2a", now))
        await until(lambda: bench.link.sent, bench.link.changed)

    caplog.set_level(logging.ERROR)
    on_a_bench(main)
    assert (POISON + b"\x01\x02").hex() in caplog.text
    assert REPORT in caplog.text
    assert "KeyError" in caplog.text


def test_all_that_was_under_way_goes_on_or_is_told() -> None:
    async def main(bench: Bench) -> None:
        runner = bench.runner
        ids: dict[str, int] = {}

        def begin(engine: Engine, now: int) -> None:
            ids["kept"] = engine.publish(11, b"kept", now)
            ids["light"] = engine.publish(12, b"light", now)
            ids["call"] = engine.call(20, b"?", now)
            ids["range"] = engine.ranging.request(2, now, timeout_s=100)
            engine.actions.send_goal(30, b"!", now, timeout_s=100, tag=b"mine")

        runner.apply(begin)
        await until(lambda: bench.got(DeliveryStored), bench.changed)
        ids["late"] = runner.apply(lambda engine, now: engine.publish(12, b"late", now))
        bench.link.hear(POISON)
        await bench.restarted()
        assert runner.engine.delivering(11) == 1
        assert not bench.got(GoalRecovered, GoalFailed, GoalAnswered)  # it goes on, unremarked
        (failed,) = bench.got(CallFailed)
        assert isinstance(failed, CallFailed)
        assert (failed.call_id, failed.failure) == (ids["call"], CallFailure.UNKNOWN)
        (no_range,) = bench.got(RangeFailed)
        assert isinstance(no_range, RangeFailed)
        assert no_range.range_id == ids["range"]
        ended = [event for event in bench.events if isinstance(event, DeliveryEnded)]
        assert {event.delivery_id for event in ended} == {ids["light"], ids["late"]}
        assert {event.outcome for event in ended} == {DeliveryOutcome.CANCELLED}
        assert all(event.missing == (2,) and "unknown" in event.detail for event in ended)
        # A second time nothing is told again, and what ends now is told once.
        bench.link.hear(POISON + b"again")
        await bench.restarted(2)
        runner.apply(lambda engine, now: engine.cancel_delivery(ids["kept"], now))
        bench.link.hear(POISON + b"once more")
        await bench.restarted(3)
        # The end of a journalled sample is told once the journal has it.
        await until(lambda: len(bench.got(DeliveryEnded)) >= 3, bench.changed)
        ended = [event for event in bench.events if isinstance(event, DeliveryEnded)]
        assert sorted(event.delivery_id for event in ended) == sorted(
            (ids["light"], ids["late"], ids["kept"])
        )
        assert len(bench.got(CallFailed)) == 1

    on_a_bench(main)


def test_every_question_to_another_node_is_answered() -> None:
    async def main(bench: Bench) -> None:
        asked: dict[int, int] = {}

        def ask(engine: Engine, now: int) -> None:
            asked[engine.call(20, b"?", now)] = 20
            asked[engine.commands.send(2, RemoteCommand(), now)] = COMMANDS_STREAM_ID
            asked[engine.status.ask(2, now, timeout_s=60.0)] = STATUS_STREAM_ID
            heard = RoutingRequest(kind=RoutingKind.HEARD, run=1)
            asked[engine.routing.send(2, heard, now)] = ROUTING_STREAM_ID

        bench.runner.apply(ask)
        bench.link.hear(POISON)
        await bench.restarted()
        assert {each.call_id: each.stream_id for each in bench.got(CallFailed)} == asked

    on_a_bench(main)


def test_what_was_not_written_down_is_told() -> None:
    async def main(bench: Bench) -> None:
        sent: list[object] = []

        def lose(engine: Engine, now: int) -> None:
            sent.append(engine.actions.send_goal(30, b"!", now, timeout_s=100))
            sent.append(engine.publish(11, b"kept", now))
            raise KeyError("a bug, before anything could be written")

        bench.runner.submit(lose)
        await bench.restarted()
        (answered,) = bench.got(GoalAnswered, GoalFailed, GoalRecovered)
        assert isinstance(answered, GoalAnswered)
        assert (answered.goal, answered.accepted) == (sent[0], False)
        (ended,) = bench.got(DeliveryEnded)
        assert isinstance(ended, DeliveryEnded)
        assert ended.delivery_id == sent[1]

    on_a_bench(main)


def test_what_is_wanted_is_asked_for_anew() -> None:
    async def main(bench: Bench) -> None:
        bench.runner.apply(lambda engine, now: engine.subscriptions.want(13, now, {2}))
        bench.link.hear(POISON)
        await bench.restarted()
        assert bench.runner.engine.subscriptions.wanted(13) == {2}

    on_a_bench(main)


def test_nothing_is_sent_before_the_modem_has_ended_the_former_engines_frame() -> None:
    async def main(bench: Bench) -> None:
        bench.link.finishes = False
        bench.runner.apply(lambda engine, now: engine.publish(10, b"one", now))
        await until(lambda: bench.link.sent, bench.link.changed)
        bench.link.hear(POISON)
        await bench.restarted()
        bench.runner.apply(lambda engine, now: engine.publish(10, b"two", now))
        await asyncio.sleep(0)
        assert len(bench.link.sent) == 1
        bench.link.finishes = True
        bench.link.finish()
        await until(lambda: len(bench.link.sent) >= 2, bench.link.changed)
        assert "stray_report" not in bench.runner.engine.stats.dropped

    on_a_bench(main)


def test_frames_that_raise_cause_no_storm_of_engines() -> None:
    async def main(bench: Bench) -> None:
        for _ in range(50):
            bench.link.hear(POISON)
            await bench.restarted()
        assert len(bench.got(EngineRestarted)) == 1  # the same frame
        numbers = itertools.count()  # each another one
        while len(bench.got(EngineRestarted)) <= FREE:
            bench.link.hear(POISON + next(numbers).to_bytes(4, "big"))
            await asyncio.sleep(0)
        for number in itertools.islice(numbers, 100):
            bench.link.hear(POISON + number.to_bytes(4, "big"))
            await asyncio.sleep(0)
        assert len(bench.got(EngineRestarted)) == FREE + 1  # and now it is deaf for a while
        bench.runner.apply(lambda engine, now: engine.publish(10, b"still speaks", now))
        await until(
            lambda: any(b"still speaks" in each.frame_bytes for each in bench.link.sent),
            bench.link.changed,
        )

    on_a_bench(main)


def test_receiver_of_events_that_raises_is_counted_and_hears_the_next_ones() -> None:
    async def main(bench: Bench) -> None:
        bench.fails = True
        bench.runner.apply(lambda engine, now: engine.publish(11, b"a", now))
        await until(lambda: bench.got(DeliveryStored), bench.changed)
        bench.runner.apply(lambda engine, now: engine.publish(11, b"b", now))
        await until(lambda: len(bench.got(DeliveryStored)) == 2, bench.changed)
        assert not bench.got(EngineRestarted)

    on_a_bench(main)


class ReadingEngine(BrittleEngine):
    """Has a bug: some entries of its journal make it raise."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)
        self.has_late = "late/1" in self.stored
        if any(key.startswith("early/") for key in self.stored):
            raise KeyError("a bug: an entry cannot be read")

    def handle_link_state(
        self,
        state: LinkState,
        now: int,
        capabilities: LinkCapabilities | None = None,
        link: str | None = None,
    ) -> None:
        super().handle_link_state(state, now, capabilities, link)
        if self.has_late:
            raise KeyError("a bug: an entry cannot be used")


def doubts(bench: Bench) -> list[str]:
    return [event.reason for event in bench.events if isinstance(event, JournalDoubted)]


async def stored(bench: Bench, value: bytes) -> int:
    """Publish a sample that is kept, and wait until the journal has it, and all before it."""
    delivery_id = bench.runner.apply(lambda engine, now: engine.publish(11, value, now))
    await until(
        lambda: any(each.delivery_id == delivery_id for each in bench.got(DeliveryStored)),
        bench.changed,
    )
    return delivery_id


async def speaks(bench: Bench) -> None:
    bench.runner.submit(lambda engine, now: engine.publish(10, b"still speaks", now))
    await until(
        lambda: any(b"still speaks" in each.frame_bytes for each in bench.link.sent),
        bench.link.changed,
    )


def test_engine_that_raises_while_it_is_made_begins_with_what_is_intact(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main(bench: Bench) -> None:
        runner = bench.runner
        for key in ("early/1", "order of a stranger", "early/2", "late/1"):
            runner.keep(key, b"no engine reads this")
        kept = await stored(bench, b"kept")
        bench.link.hear(POISON)
        await bench.restarted()
        await speaks(bench)
        assert runner.engine.is_delivering(kept)
        assert "entries of the journal cannot be used" in runner.engine.doubt.reason
        assert doubts(bench)
        await stored(bench, b"another one")
        left = bench.journal.recover().entries
        assert "order of a stranger" in left
        assert not {"early/1", "early/2", "late/1"} & left.keys()

    caplog.set_level(logging.ERROR)
    on_a_bench(main, ReadingEngine)
    assert f"early/2, which is left out and deleted: {b'no engine reads this'.hex()}" in caplog.text


def test_node_starts_whatever_of_its_journal_cannot_be_read() -> None:
    """As when another version has written it, or there is a bug."""
    keys = (
        "call/2/7/20/3", "call/x", "goal/taken/2/7/30/3", "goal/sent/30/1", "order/2/0", "tune/10",
        "out/11", "out/11/1", "in/2/11", "object/out/7", "object/in/2/7/0", "object/done/2/7",
        "silence", "clock", "early/1", "late/1",
    )  # fmt: skip
    for engine_type in (BrittleEngine, ReadingEngine):
        for key in keys:
            for value in (b"", b"\xc1", b"\x93\x01\xa1x\xc0", bytes(20)):
                journal = MemoryJournal()
                journal.commit([JournalWrite(write_id=0, key=key, value=value)])
                on_a_bench(speaks, engine_type, journal)


def test_engine_that_cannot_be_made_for_a_while_is_made_then(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("zacoustic.run.replacement.replacement.FIRST_PAUSE_S", 0.0)

    async def main(bench: Bench) -> None:
        kept = await stored(bench, b"kept")
        bench.made_in_vain = 5
        bench.link.hear(POISON)
        await bench.restarted()
        await speaks(bench)
        assert bench.runner.engine.is_delivering(kept)
        assert not doubts(bench)

    on_a_bench(main)
