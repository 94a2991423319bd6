"""Old copies of the journals of servers, put back: no call, goal or command is executed twice.

As `test_restored`, of which this is the other half: who is asked, and not who tells.
"""

import random
from collections.abc import Callable
from typing import Final

from tests.virtual.fleet import line
from zacoustic.core.base.qos import Forward, Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    CallFailure,
    GoalStatus,
    JournalDoubted,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.events import (
    GoalAnswered,
    GoalFailed,
    GoalReceived,
    ResultReceived,
)
from zacoustic.testing.virtual import VirtualNetwork

LOG, ASKED, ARM, GOTO = 10, 11, 20, 30
TIMEOUT_S: Final = 600.0
RELIABLE: Final = Qos(reliability=Reliability.RELIABLE, depth=20)


def table() -> StreamTable:
    return StreamTable(
        [
            TopicSpec(
                stream_id=LOG, name="log", publishers=(2,), subscribers=(1,), qos=RELIABLE,
                journal=True,
            ),
            TopicSpec(
                stream_id=ASKED, name="asked", publishers=(2,), qos=Qos(forward=Forward.ON_DEMAND)
            ),
            ServiceSpec(stream_id=ARM, name="arm", server=2, timeout_s=TIMEOUT_S),
            ActionSpec(
                stream_id=GOTO, name="goto", server=2, timeout_s=TIMEOUT_S,
                result_timeout_s=TIMEOUT_S,
            ),
        ],
        nodes={1: "shore", 2: "auv"},
    )  # fmt: skip


class Run:
    """A shore and a vehicle that serves; what is executed twice is a complaint."""

    def __init__(self, seed: int, loss: float = 0.3) -> None:
        self.rng = random.Random(seed)
        self.seed = seed
        scenario = line(
            0, 300, seed=seed, channel="none", loss={"frame": loss},
            faults={"journal": {"commit_s": 0.02}},
        )  # fmt: skip
        self.medium = VirtualNetwork(scenario, table(), deliver=self._take)
        self.executed: list[object] = []
        self.twice: list[object] = []
        self.doubts: list[str] = []
        self.ended: list[object] = []
        self.heard: list[object] = []
        self.backup: dict[str, bytes] = {}
        self.count = 0

    def _take(self, node: int, event: object) -> None:
        match event:
            case RequestReceived():
                self._execute(event.value)
                self._at(2, lambda engine, now: engine.reply(event.call, b"did", now))
            case GoalReceived():
                self._execute(event.value)
                self._at(2, lambda engine, now: engine.actions.accept(event.goal, now))
                done = GoalStatus.SUCCEEDED
                self._at(
                    2, lambda engine, now: engine.actions.finish(event.goal, done, b"did", now)
                )
            case JournalDoubted() if node == 2:
                self.doubts.append(event.reason)
            case SampleReceived():
                self.heard.append(event.value)
            case (
                ResponseReceived() | CallFailed() | ResultReceived() | GoalFailed() | GoalAnswered()
            ):
                self.ended.append(event)

    def _at(self, node: int, command: Callable[[Engine, int], object]) -> None:
        self.medium.apply(node, command)

    def _execute(self, value: object) -> None:
        (self.twice if value in self.executed else self.executed).append(value)

    def _next(self) -> bytes:
        self.count += 1
        return f"{self.count}".encode()

    def call(self) -> int:
        request = self._next()
        return self.medium.apply(1, lambda engine, now: engine.call(ARM, request, now))

    def send(self) -> None:
        goal = self._next()
        self._at(
            1, lambda engine, now: engine.actions.send_goal(GOTO, goal, now, timeout_s=TIMEOUT_S)
        )

    def log(self) -> None:
        self.medium.publish(2, LOG, self._next())

    def wait(self, for_s: float) -> None:
        self.medium.run(until_s=self.medium.now / NS_PER_S + for_s)

    def copy(self) -> None:
        self.backup = dict(self.medium.journal(2).entries)

    def put_back(self, doubt: str) -> None:
        self.medium.crash(2)
        self.medium.journal(2).put_back(self.backup, doubt)
        self.medium.start(2)

    def work(self, for_s: float, *does: Callable[[], object]) -> None:
        until = self.medium.now + int(for_s * NS_PER_S)
        while self.medium.now < until:
            self.rng.choice(does)()
            self.wait(self.rng.uniform(0.1, 20))


def test_calls_and_goals_of_before_are_not_executed_by_a_server_that_has_forgotten_them(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(600)):
        run = Run(seed)
        run.work(run.rng.uniform(1, 100), run.call, run.send)
        run.copy()
        run.work(run.rng.uniform(1, 100), run.call, run.send)
        run.put_back("it was put back from a backup")
        run.work(run.rng.uniform(1, 100), run.call, run.send)
        if run.rng.random() < 0.5:
            run.medium.restart(2)  # the doubt outlives that
        run.wait(2 * TIMEOUT_S)
        assert not run.twice, f"seed {seed}"
        before = len(run.executed)
        run.call()
        run.send()
        run.wait(TIMEOUT_S)
        assert len(run.executed) == before + 2, f"seed {seed}: it serves again"


def test_server_on_an_old_copy_that_a_subscriber_tells_of_refuses_what_may_be_of_before(
    count: Callable[[int], int],
) -> None:
    """An image of the whole disk: the store has noticed nothing."""
    told = 0
    for seed in range(count(1000)):
        run = Run(seed, loss=0.1)
        run.log()
        run.wait(run.rng.uniform(0.1, 0.5))  # it is in the journal, and not delivered yet
        run.copy()
        for _ in range(5):
            run.log()
            run.wait(10)
            if run.rng.random() < 0.3:
                run.medium.restart(2)
        run.put_back("")
        for _ in range(8):
            run.log()
            run.wait(15)
        if not run.doubts:
            continue
        told += 1
        if run.rng.random() < 0.5:
            run.medium.restart(2)
        calls = {run.call() for _ in range(2)}
        run.send()
        run.wait(60)
        assert not run.executed, f"seed {seed}"
        failed = [each for each in run.ended if isinstance(each, CallFailed)]
        assert {each.call_id for each in failed} == calls, f"seed {seed}"
        assert {each.failure for each in failed} == {CallFailure.UNKNOWN}
        run.wait(2 * TIMEOUT_S)
        run.call()
        run.send()
        run.wait(TIMEOUT_S)
        assert len(run.executed) == 2, f"seed {seed}: it serves again"
    assert told


def test_of_commands_the_last_one_holds_at_a_node_on_an_old_copy(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(600)):
        run = Run(seed)
        states = [True]

        def command(run: Run = run, states: list[bool] = states) -> None:
            states.append(run.rng.random() < 0.5)
            command = RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=LOG, on=states[-1])
            run.medium.apply(1, lambda engine, now: engine.commands.send(2, command, now))
            run.wait(run.rng.uniform(5, 60))

        run.work(run.rng.uniform(1, 100), command)
        run.copy()
        run.work(run.rng.uniform(1, 100), command)
        run.put_back(run.rng.choice(("", "it was put back from a backup")))
        run.wait(run.rng.uniform(0, 60))
        command()
        run.wait(TIMEOUT_S)
        state = run.medium.apply(
            2, lambda engine, now: engine.commands.state(RemoteCommand(stream_id=LOG), now)
        )
        assert state.on is states[-1], f"seed {seed}"


def test_subscriptions_are_there_again_at_a_publisher_on_an_old_copy(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(600)):
        run = Run(seed)
        run.copy()  # nobody has subscribed yet
        run.medium.apply(1, lambda engine, now: engine.subscriptions.want(ASKED, now, {2}))
        run.wait(120)
        run.put_back(run.rng.choice(("", "it was put back from a backup")))
        for _ in range(3):
            run.log()  # they hear of its new life
            run.wait(120)
        for _ in range(20):
            run.medium.publish(2, ASKED, b"wanted")
            run.wait(10)
        assert b"wanted" in run.heard, f"seed {seed}"
