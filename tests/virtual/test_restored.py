"""Old copies of journals, put back: nothing is acted on twice, and nothing is said to be delivered
that was not handed on; and it ends.

A node is stopped, an old copy of what its journal had is put in the place of the present one, and
it starts again. Its store has found that out, as the one in a file does of a backup; or it has not,
as of an image of the whole disk.
"""

import random
from collections.abc import Callable, Sequence
from typing import Any, Final

import pytest

from tests.virtual.fleet import line
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    DeliveryEnded,
    DeliveryOutcome,
    JournalDoubted,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.core.linktypes import ReceivedFrame
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

LOG, NOTE, PHOTO, ARM = 10, 11, 12, 20
TOPICS: Final = (LOG, NOTE, PHOTO)
NODES: Final = {1: "shore", 2: "auv1", 3: "auv2"}
HOUR_S: Final = 3600.0


def table() -> StreamTable:
    reliable = Qos(reliability=Reliability.RELIABLE, depth=20)
    return StreamTable(
        [
            TopicSpec(stream_id=LOG, name="log", publishers=(1,), qos=reliable, journal=True),
            TopicSpec(stream_id=NOTE, name="note", publishers=(1,), qos=reliable),
            TopicSpec(
                stream_id=PHOTO,
                name="photo",
                publishers=(1,),
                subscribers=(2,),
                journal=True,
                max_bytes=4000,
                qos=Qos(reliability=Reliability.RELIABLE, depth=4, priority=Priority.BACKGROUND),
            ),
            ServiceSpec(stream_id=ARM, name="arm", server=2, timeout_s=300),
        ],
        nodes=NODES,
    )


class Run:
    """A network whose events are judged as they come.

    Args:
        seed: Of the channel and the scenario.
        loss: Share of frames that are lost.
        epochs: What node 1 draws at its starts; it remembers nothing then. Empty: as its journal
            says.
    """

    def __init__(self, seed: int, loss: float = 0.2, *, epochs: Sequence[int] = ()) -> None:
        self.rng = random.Random(seed)
        scenario = line(
            0,
            300,
            500,
            seed=seed,
            channel="none",
            loss={"frame": loss},
            faults={"journal": {"commit_s": 0.02}},
        )
        drawn = iter(epochs)

        def build(**settings: Any) -> Engine:
            if epochs and settings["address"] == 1:
                settings |= {"epoch": next(drawn), "stored": {}}
            return Engine(**settings)

        self.medium = VirtualNetwork(scenario, table(), deliver=self._take, build=build)
        self.violations: list[str] = []
        self.doubts: list[tuple[int, str]] = []
        self.values: dict[tuple[int, int, int], bytes] = {}
        """Node, stream and delivery id, in the life that counts: what was published."""
        self.handed_on: dict[bytes, list[int]] = {}
        self.unmarked: set[tuple[bytes, int]] = set()
        self.delivered: list[bytes] = []
        self.ran: list[object] = []
        self.answered: list[tuple[int, object]] = []
        self.calls: dict[int, bytes] = {}
        self.backup: dict[int, dict[str, bytes]] = {}
        self.count = 0

    def _take(self, node: int, event: object) -> None:
        match event:
            case SampleReceived():
                got = self.handed_on.setdefault(event.value, [])
                if node in got and not event.again:
                    self.violations.append(f"{event.value!r} comes to node {node} twice")
                got.append(node)
            case DeliveryEnded(outcome=DeliveryOutcome.DELIVERED):
                value = self.values[node, event.stream_id, event.delivery_id]
                owed = {2} if event.stream_id == PHOTO else {2, 3}
                if not owed <= set(self.handed_on.get(value, [])):
                    self.violations.append(f"{value!r} is said to be delivered")
                self.delivered.append(value)
            case JournalDoubted():
                self.doubts.append((node, event.reason))
            case RequestReceived():
                if event.value in self.ran:
                    self.violations.append(f"{event.value!r} runs twice")
                self.ran.append(event.value)
                self.medium.apply(
                    2, lambda engine, now: engine.reply(event.call, b"did " + event.value, now)
                )
            case ResponseReceived():
                if event.value != b"did " + self.calls[event.call_id]:
                    self.violations.append(f"{event.value!r} answers another call")
                self.answered.append((event.call_id, event.value))

    def publish(self, stream_id: int) -> bytes:
        self.count += 1
        size = self.rng.randint(200, 900) if stream_id == PHOTO else 12
        value = f"{stream_id} {self.count} ".encode().ljust(size, b".")
        delivery_id = self.medium.apply(
            1, lambda engine, now: engine.publish(stream_id, value, now)
        )
        key = (1, stream_id, delivery_id)
        if key in self.values:
            self.violations.append(f"the id of {self.values[key]!r} comes again")
        self.values[key] = value
        return value

    def call(self) -> None:
        self.count += 1
        request = f"call {self.count}".encode()
        call_id = self.medium.apply(1, lambda engine, now: engine.call(ARM, request, now))
        self.calls[call_id] = request

    def talk(self, for_s: float, *, calls: bool = False) -> None:
        """Publish this and that."""
        until = self.medium.now + int(for_s * NS_PER_S)
        while self.medium.now < until:
            self.publish(self.rng.choice((LOG, LOG, NOTE, PHOTO)))
            if calls:
                self.call()
            self.wait(self.rng.uniform(1, 60))

    def wait(self, for_s: float) -> None:
        self.medium.run(until_s=self.medium.now / NS_PER_S + for_s)

    def copy(self, node: int) -> None:
        self.backup[node] = dict(self.medium.journal(node).entries)

    def put_back(self, node: int, doubt: str) -> None:
        self.medium.crash(node)
        self.medium.journal(node).put_back(self.backup[node], doubt)
        self.medium.start(node)

    def hear(self, node: int, records: str, *, source: int) -> None:
        """A frame arrives that nobody has sent."""
        frame = ReceivedFrame(
            frame_bytes=bytes.fromhex(records),
            source=source,
            destination=node,
            received_at=self.medium.local_ns(node),
        )
        self.medium.apply(node, lambda engine, now: engine.handle_frame(frame, now))

    def frames(self) -> int:
        return sum(self.medium.engine(each).stats.frames_transmitted for each in NODES)

    def ends(self) -> None:
        """Everything has come to its end, and nothing is said any more."""
        self.wait(3 * HOUR_S)
        before = self.frames()
        self.wait(HOUR_S)
        assert self.violations == []
        assert self.frames() == before, "it does not end"
        for stream_id in TOPICS:
            assert self.medium.engine(1).delivering(stream_id) == 0


@pytest.mark.parametrize("doubt", ["it was put back from a backup", ""])
def test_publisher_on_an_old_copy_is_told_and_goes_on(
    count: Callable[[int], int], doubt: str
) -> None:
    told = 0
    for seed in range(count(600)):
        run = Run(seed)
        run.talk(run.rng.uniform(1, 200))
        run.publish(LOG)
        run.wait(0.5)  # it is in the journal, and not delivered yet
        run.copy(1)
        run.talk(run.rng.uniform(0, 400))
        for _ in range(run.rng.randrange(3)):
            run.medium.restart(1)
            run.talk(run.rng.uniform(0, 200))
        run.put_back(1, doubt)
        new = [run.publish(LOG), run.publish(NOTE), run.publish(PHOTO)]
        run.ends()
        for value in new:
            assert value in run.delivered, f"seed {seed}: {value!r}"
        told += bool(run.doubts)
    assert told == count(600) if doubt else told


@pytest.mark.parametrize(
    "epochs", [(999, 1000, 999), (999, 1000, 997), (999, 1000, 984), (0, 65535), (999, 1000, 983)]
)
def test_publisher_that_remembers_nothing_goes_on_in_any_epoch(
    count: Callable[[int], int], epochs: tuple[int, ...]
) -> None:
    """Also in one that is over, to its receivers: at most its first large sample is refused."""
    for seed in range(count(100)):
        run = Run(seed, epochs=epochs)
        for _ in epochs[1:]:
            for stream_id in TOPICS:
                run.publish(stream_id)
            run.talk(run.rng.uniform(100, 300))
            run.wait(600)
            run.medium.restart(1)
            run.values.clear()  # ids begin anew
        run.publish(PHOTO)
        run.wait(600)
        new = [run.publish(LOG), run.publish(NOTE), run.publish(PHOTO)]
        run.ends()
        for value in new:
            assert value in run.delivered, f"seed {seed}: {value!r}"


def test_receiver_on_an_old_copy_gets_nothing_twice_but_what_is_marked(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(600)):
        run = Run(seed)
        run.talk(run.rng.uniform(1, 200))
        node = run.rng.choice((2, 3))
        run.copy(node)
        run.talk(run.rng.uniform(0, 400))
        run.put_back(node, "an old copy")
        new = [run.publish(LOG), run.publish(NOTE), run.publish(PHOTO)]
        run.ends()
        for value in new:
            assert value in run.delivered, f"seed {seed}: {value!r}"


def test_server_on_an_old_copy_runs_nothing_twice_and_caller_takes_no_other_answer(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(600)):
        run = Run(seed)
        run.talk(run.rng.uniform(1, 100), calls=True)
        run.copy(1)
        run.copy(2)
        run.talk(run.rng.uniform(0, 100), calls=True)
        run.put_back(2, "an old copy")
        if run.rng.random() < 0.5:
            run.put_back(1, run.rng.choice(("an old copy", "")))
            run.calls.clear()
        run.wait(run.rng.uniform(0, 60))
        run.call()
        run.wait(700)
        run.call()
        run.ends()
        last = max(run.calls)
        assert last in dict(run.answered), f"seed {seed}: it serves again"


def test_forged_acknowledgements_make_nobody_begin_anew_for_ever(
    sized: Callable[..., int],
) -> None:
    """ACKs with a lineage that nobody knows, one a minute for six hours; for a day in a soak."""
    minutes = sized(24 * 60, share=6 * 60)
    run = Run(1, loss=0.0)
    for _ in range(minutes):
        run.publish(LOG)
        run.wait(30)
        run.hear(1, "b8beef000100b90a01", source=2)
        run.wait(30)
    assert len(run.doubts) <= 12
    run.ends()
    assert len(run.delivered) == minutes


def test_one_forged_frame_of_another_lineage_is_overcome() -> None:
    run = Run(2, loss=0.0)
    run.talk(100)
    run.hear(2, "b8beef0001000a00" + b"forged".hex(), source=1)
    new = [run.publish(LOG) for _ in range(3)]
    run.wait(HOUR_S)
    run.violations.clear()  # nobody knows what the forged count has been taken for
    run.ends()
    for value in new:
        assert value in run.delivered
