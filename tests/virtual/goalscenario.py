"""Random scenarios of goals: several clients, one server, and everything goes wrong for a while.

Each goal carries a ticket of its own; feedback and results carry the ticket of their goal, so that
one of another goal shows.
"""

import random
from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec

from tests.virtual.judged import NEWS, JudgedScenario
from tests.virtual.weather import LONGEST_OUTAGE_S, weather
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, GoalFailure, GoalKey, GoalStatus
from zacoustic.core.streams.specs import ActionSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.events import (
    CancelAnswered,
    CancelRequested,
    FeedbackReceived,
    GoalAnswered,
    GoalFailed,
    GoalReceived,
    GoalRecovered,
    ResultReceived,
)
from zacoustic.errors import JournalUnavailableError, QueueFullError
from zacoustic.testing.virtual import Modem, VirtualNetwork

SERVER: Final = 1
GOTO: Final = 30
MOST_ENTRIES: Final = 64
"""Goals of one client in the journal of its server at most: two lives of 32 numbers."""
_CALM_GOALS: Final = 3

End = GoalAnswered | ResultReceived | GoalFailed


class Goal(msgspec.Struct):
    """A goal that a client has sent."""

    key: GoalKey
    life: int
    ticket: bytes
    at: int
    written: int
    is_calm: bool
    cancelled_at: int | None = None
    cancels: int = 0
    """Cancels that are to be answered each by itself."""
    is_cancelling: bool = False
    last_cancel_at: int = 0
    """Instant of the cancel that is under way."""
    accepted: bool = False
    fed: int = 0
    ends: list[tuple[int, End]] = []
    """With the instants at which they came."""


class GoalScenario(JudgedScenario):
    """One random scenario.

    Args:
        seed: Everything follows from it.
    """

    def __init__(self, seed: int) -> None:
        self._rng = rng = random.Random(f"goals/{seed}")
        super().__init__(seed)
        self.goals: list[Goal] = []
        self.by_key: dict[GoalKey, Goal] = {}
        """Of each name the last goal."""
        self.shown: dict[bytes, int] = {}
        """How often the server's application was shown a goal, by ticket."""
        self.asked: dict[bytes, int] = {}
        """How often it was asked to end one."""
        self.begun: set[bytes] = set()
        self.rejected: set[bytes] = set()
        self.finished: dict[bytes, tuple[GoalStatus, bytes]] = {}
        self.crashes: list[tuple[int, int]] = []
        """``(instant, node)``."""
        self._tickets = 0
        self._addresses = range(1, 2 + rng.choice((1, 1, 2, 3)))
        self._timeout_s = rng.choice((60.0, 300.0, 2400.0))
        self._result_timeout_s = rng.choice((600.0, 3600.0, 7200.0))
        self._busy_s = rng.choice((300.0, 900.0, 2700.0))
        self._run_s = rng.choice((0.0, 5.0, 60.0, 900.0))
        # A node that is listed and not there: nobody ever omits the introduction in a broadcast.
        absent = {99: "absent"} if rng.random() < 0.3 else {}
        table = StreamTable(
            [
                ActionSpec(
                    stream_id=GOTO,
                    name="goto",
                    server=SERVER,
                    timeout_s=self._timeout_s,
                    result_timeout_s=self._result_timeout_s,
                    feedback_interval_s=rng.choice((0.0, 5.0, 30.0)),
                ),
                NEWS,
            ],
            nodes={address: f"n{address}" for address in self._addresses} | absent,
        )
        modem = Modem(acknowledges=rng.random() < 0.2)
        drawn = weather(rng, seed, self._addresses, self._busy_s, modem, _outage_s)
        self._is_in_order = not (drawn.faults.duplicate or drawn.faults.jitter_s)
        self.network = VirtualNetwork(
            drawn, table, modem=modem, deliver=self._take, lives=self._live, digest=False
        )

    def run(self) -> list[str]:
        """Run it; returns what must not have happened."""
        rng, network = self._rng, self.network
        period_s = rng.choice((5.0, 30.0, 200.0))
        calm_s = self._busy_s + self._timeout_s + 2 * self._result_timeout_s + self._run_s + 120
        for client in self._addresses[1:]:
            at_s = rng.uniform(0, 20)
            while at_s < self._busy_s:
                for _ in range(rng.choice((1, 1, 1, 1, 4, 15))):
                    network.at(at_s, partial(self._send, client))
                at_s += rng.expovariate(1 / period_s)
            for number in range(_CALM_GOALS):
                at_s = calm_s + 60 * number + 10 * client
                # Whoever was silent for long is tried again rarely: the first may come too late.
                is_last = number == _CALM_GOALS - 1
                network.at(at_s, partial(self._send, client, is_calm=is_last))
        self._plan_news(rng, self._addresses, self._busy_s)
        end_s = calm_s + self._timeout_s + 2 * self._result_timeout_s + self._run_s + 2000
        for second in range(0, int(self._busy_s), 30):
            network.at(second, self._look_at_journal)
        network.run(until_s=end_s)
        self._judge()
        return self.violations

    # What the clients do

    def _send(self, client: int, *, is_calm: bool = False) -> None:
        if not self.network.is_running(client):
            return
        self._tickets += 1
        ticket = b"%d" % self._tickets
        draw = self._rng.random()
        timeout_s = None if is_calm or draw < 0.7 else self._rng.uniform(5, 600)

        def begin(engine: Engine, now: int) -> Goal:
            key = engine.actions.send_goal(GOTO, ticket, now, timeout_s=timeout_s, tag=ticket)
            former = self.by_key.get(key)
            if former is not None and not former.ends and self._is_kept(former):
                self._complain(f"{former} has not ended, and its name is used again")
            goal = self.by_key[key] = Goal(
                key=key,
                life=self.network.life(client),
                ticket=ticket,
                at=self.network.now,
                written=self.network.journal(client).handed_out + 1,
                is_calm=is_calm,
                ends=[],
            )
            self.goals.append(goal)
            return goal

        try:
            goal = self.network.apply(client, begin)
        except (QueueFullError, JournalUnavailableError):
            self._count("refused")
            return
        if not is_calm and draw > 0.7:
            after_s = self.network.now / NS_PER_S + self._rng.uniform(0, 1.5 * self._run_s + 5)
            self.network.at(after_s, lambda: self._cancel(goal))

    def _cancel(self, goal: Goal) -> None:
        key = goal.key
        if not self.network.is_running(key.client) or self.by_key[key] is not goal:
            return

        def cancel(engine: Engine, now: int) -> None:
            if goal.cancelled_at is None:
                goal.cancelled_at = self.network.now
            if not goal.is_cancelling:
                goal.is_cancelling, goal.last_cancel_at = True, self.network.now
                goal.cancels += 1
            engine.actions.cancel_goal(key, now)

        self.network.apply(key.client, cancel)

    # What the server does

    def _later(self, after_s: float, command: Callable[[Engine, int], object]) -> None:
        """Give the server a command later, if it lives on."""
        life = self.network.life(SERVER)

        def act() -> None:
            if self.network.is_running(SERVER) and self.network.life(SERVER) == life:
                self.network.apply(SERVER, command)

        self.network.at(self.network.now / NS_PER_S + after_s, act)

    def _serve(self, event: GoalReceived) -> None:
        ticket = bytes(event.value)
        self.shown[ticket] = self.shown.get(ticket, 0) + 1
        if self.shown[ticket] > 1:
            self._complain(f"{ticket!r} is shown again")
        draw = self._rng.random()
        if draw < 0.03:
            return  # an application that does not answer
        after_s = self._rng.choice((0.0, 0.0, 0.0, 3.0, 20.0))
        if draw < 0.15:
            self._later(after_s, lambda engine, now: self._reject(engine, event.goal, ticket, now))
        else:
            self._later(after_s, lambda engine, now: self._begin(engine, event.goal, ticket, now))

    def _reject(self, engine: Engine, key: GoalKey, ticket: bytes, now: int) -> None:
        self.rejected.add(ticket)
        engine.actions.reject(key, now, text=ticket.decode())

    def _begin(self, engine: Engine, key: GoalKey, ticket: bytes, now: int) -> None:
        if not engine.actions.accept(key, now):
            return
        self.begun.add(ticket)
        run_s = self._rng.uniform(0, self._run_s)
        for number in range(1, 10):
            value = b"%s:%d" % (ticket, number)
            at_s = run_s * number / 10

            def feed(engine: Engine, now: int, value: bytes = value) -> None:
                engine.actions.publish_feedback(key, value, now)

            self._later(at_s, feed)
        status = self._rng.choice((GoalStatus.SUCCEEDED, GoalStatus.ABORTED))
        self._later(run_s, lambda engine, now: self._finish(engine, key, ticket, status, now))

    def _finish(
        self, engine: Engine, key: GoalKey, ticket: bytes, status: GoalStatus, now: int
    ) -> None:
        value = b"re " + ticket
        if ticket in self.finished:
            if engine.actions.finish(key, status, value, now):
                self._complain(f"{ticket!r} is finished twice")
            return
        # Noted before the engine acts, since the client may hear of it at once.
        self.finished[ticket] = (status, value)
        if not engine.actions.finish(key, status, value, now):
            del self.finished[ticket]

    def _be_asked(self, event: CancelRequested) -> None:
        goal = self.by_key.get(event.goal)
        if goal is None or goal.cancelled_at is None or goal.ticket not in self.begun:
            self._complain(f"{event} of {goal}")
            return
        self.asked[goal.ticket] = self.asked.get(goal.ticket, 0) + 1
        if self.asked[goal.ticket] > goal.cancels:
            self._complain(f"{goal}: the application is asked {self.asked[goal.ticket]} times")
        agrees = self._rng.random() < 0.5
        ticket = goal.ticket

        def answer(engine: Engine, now: int) -> None:
            engine.actions.answer_cancel(
                event.goal, now, accepted=agrees, text=str(self.network.now)
            )
            if agrees:
                after_s = self._rng.choice((0.0, 10.0))
                canceled = GoalStatus.CANCELED
                self._later(
                    after_s, lambda e, at: self._finish(e, event.goal, ticket, canceled, at)
                )

        self._later(self._rng.choice((0.0, 0.0, 5.0)), answer)

    # What the engines say

    def _take(self, node: int, event: Event) -> None:
        if isinstance(event, GoalReceived):
            self._serve(event)
        elif isinstance(event, CancelRequested):
            self._be_asked(event)
        elif isinstance(
            event,
            GoalAnswered
            | ResultReceived
            | GoalFailed
            | FeedbackReceived
            | CancelAnswered
            | GoalRecovered,
        ):
            goal = self.by_key.get(event.goal)
            if goal is None or goal.key.client != node:
                self._complain(f"{event} at node {node} is about no goal of it")
            elif goal.ends and not self._comes_again(goal, event):
                self._complain(f"{event} after {goal.ends}")
            else:
                self._hear(goal, event)

    def _hear(
        self,
        goal: Goal,
        event: End | FeedbackReceived | CancelAnswered | GoalRecovered,
    ) -> None:
        now = self.network.now
        match event:
            case GoalRecovered():
                if event.tag != goal.ticket or self.network.life(goal.key.client) == goal.life:
                    self._complain(f"{event} of {goal}")
                goal.accepted = False  # this life has to be told
                goal.is_cancelling = False
            case GoalAnswered(accepted=True):
                if goal.accepted or goal.ticket not in self.begun:
                    self._complain(f"{event} of {goal}")
                goal.accepted = True
            case FeedbackReceived():
                ticket, _, number = event.value.partition(b":")
                if ticket != goal.ticket or not goal.accepted:
                    self._complain(f"{event} of {goal}")
                if self._is_in_order and int(number) <= goal.fed:
                    self._complain(f"{event} after {goal.fed}")
                goal.fed = int(number)
                self._count("feedback")
            case CancelAnswered():
                if goal.cancelled_at is None or not goal.accepted:
                    self._complain(f"{event} of {goal}")
                if not event.accepted and int(event.text) < goal.last_cancel_at:
                    self._complain(f"{event} answers an earlier cancel of {goal}")
                goal.is_cancelling = False
                self._count(f"cancel {'accepted' if event.accepted else 'refused'}")
                if not event.accepted and self._rng.random() < 0.7:
                    after_s = now / NS_PER_S + self._rng.choice((0.0, 0.0, 3.0, 60.0))
                    self.network.at(after_s, lambda: self._cancel(goal))
            case _:
                goal.ends.append((now, event))

    def _comes_again(self, goal: Goal, event: Event) -> bool:
        """Forget an end that the client's former life did not live to write down."""
        commit_ns = self.network.journal(goal.key.client).commit_ns
        ended_at = goal.ends[0][0]
        died = any(
            who == goal.key.client and ended_at <= instant <= ended_at + 2 * commit_ns
            for instant, who in self.crashes
        )
        if isinstance(event, GoalRecovered) and died:
            goal.ends.clear()
            self._count("told again")
            return True
        return False

    def _live(self, address: int, is_alive: bool) -> None:
        if not is_alive:
            self.crashes.append((self.network.now, address))

    def _look_at_journal(self) -> None:
        entries = self._journalled(SERVER)
        if len(entries) > MOST_ENTRIES * (len(self._addresses) - 1):
            self._complain(f"{len(entries)} goals in the journal")

    def _journalled(self, address: int) -> list[str]:
        entries = self.network.journal(address).entries
        return [name for name in entries if name.startswith("goal/")]

    # What must hold

    def _judge(self) -> None:
        for goal in self.goals:
            if len(goal.ends) > 1 or (not goal.ends and self._is_kept(goal)):
                self._complain(f"{goal} has {len(goal.ends)} ends")
            for at, event in goal.ends:
                self._judge_end(goal, at, event)
        for address in self._addresses:
            if self._journalled(address):
                self._complain(f"left in the journal: {self._journalled(address)}")
        self._expect_rest(self._addresses)

    def _is_kept(self, goal: Goal) -> bool:
        """Tell whether a goal was written down by its client; what was not, was not sent."""
        return self.network.journal(goal.key.client).is_journalled(goal.written)

    def _judge_end(self, goal: Goal, at: int, event: End) -> None:
        ticket = goal.ticket
        if isinstance(event, ResultReceived):
            self._count(event.status.name)
            if (event.status, event.value) != self.finished.get(ticket) or not goal.accepted:
                self._complain(f"{goal}: finished: {self.finished.get(ticket)}")
            return
        assert event.failure is not None
        self._count(event.failure.name)
        nodes = (SERVER, goal.key.client)
        crashed = any(goal.at <= instant <= at and who in nodes for instant, who in self.crashes)
        if event.failure is GoalFailure.REJECTED:
            if ticket not in self.rejected or event.text != ticket.decode():
                self._complain(f"{goal} is rejected")
        elif event.failure is GoalFailure.CANCELLED:
            if goal.cancelled_at is None or ticket in self.begun:
                self._complain(f"{goal} was cancelled")
        elif event.failure is GoalFailure.UNKNOWN:
            if not crashed:
                self._complain(f"{goal} is unknown without a crash")
        elif event.failure is not GoalFailure.TIMED_OUT:
            self._complain(f"{goal} fails")
        elif goal.accepted and self._result_timeout_s > self._busy_s:
            self._complain(f"{goal} was accepted, and is given up")
        elif goal.is_calm and ticket not in self.shown:
            self._complain(f"{goal} never arrived although all is calm")


def _outage_s(rng: random.Random) -> float:
    return rng.choice((10.0, 300.0, LONGEST_OUTAGE_S))
