"""Goals across the water: each runs at most once, and its client is told one end of it."""

import itertools
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from tests.virtual.fleet import line
from tests.virtual.goalscenario import GoalScenario
from zacoustic.core.base.qos import Qos
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, GoalFailure, GoalKey, GoalStatus
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.peers.peer import Peer
from zacoustic.core.peers.states import Change
from zacoustic.core.streams.specs import ActionSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.events import (
    ActionEvent,
    CancelAnswered,
    CancelRequested,
    FeedbackReceived,
    GoalAnswered,
    GoalFailed,
    GoalReceived,
    GoalRecovered,
    ResultReceived,
)
from zacoustic.core.wire.agreement import ASSURED, CONFIRM_CODE, HELLO_CODE, Confirm
from zacoustic.errors import QueueFullError
from zacoustic.testing.virtual import Disturb, VirtualNetwork

NEVER_S = 1e9
SUCCEEDED, CANCELED = GoalStatus.SUCCEEDED, GoalStatus.CANCELED


def fleet(nodes: int = 2, **settings: Any) -> StreamTable:
    return StreamTable(
        [
            ActionSpec(stream_id=30, name="goto", server=1, **settings),
            TopicSpec(stream_id=1, name="a", qos=Qos(depth=2000)),
        ],
        nodes={address: f"n{address}" for address in range(1, nodes + 1)},
    )


class Bench:
    """A network whose node 1 accepts every goal, and what its nodes were told."""

    def __init__(
        self,
        nodes: int = 2,
        *,
        seed: int = 1,
        tables: dict[int, StreamTable] | None = None,
        disturb: Disturb | None = None,
        accepts: bool = True,
        trace: bool = False,
        faults: dict[str, Any] | None = None,
        **settings: Any,
    ) -> None:
        self.told: list[tuple[int, float, ActionEvent]] = []
        """``(node, instant in s, event)``."""
        self._accepts = accepts
        positions = (400.0 * number for number in range(nodes))
        medium = line(*positions, channel="none", seed=seed, faults=faults or {})
        self.frames: list[tuple[int, bytes]] = []
        """``(node, frame)``: what was transmitted, where it is traced."""
        self.instants: list[float] = []
        """Of those frames, s."""
        self.medium = VirtualNetwork(
            medium,
            tables or fleet(nodes, **settings),
            deliver=self._take,
            disturb=disturb,
            trace=self._note if trace else None,
        )

    @property
    def now_s(self) -> float:
        return self.medium.now / NS_PER_S

    def send(self, node: int = 2, value: bytes = b"there", **settings: Any) -> GoalKey:
        """Send a goal from a node."""
        return self.medium.apply(
            node, lambda engine, now: engine.actions.send_goal(30, value, now, **settings)
        )

    def serve(self, command: Callable[[Engine, int], Any]) -> Any:
        """Give a command to the server's engine."""
        return self.medium.apply(1, command)

    def finish(
        self, goal: GoalKey, status: GoalStatus = SUCCEEDED, value: bytes | None = b"done"
    ) -> bool:
        """End a goal at the server."""
        return bool(self.serve(lambda engine, now: engine.actions.finish(goal, status, value, now)))

    def feed(self, goal: GoalKey, value: bytes) -> bool:
        """Send feedback."""
        return bool(
            self.serve(lambda engine, now: engine.actions.publish_feedback(goal, value, now))
        )

    def cancel(self, goal: GoalKey) -> bool:
        """Cancel a goal at its client."""
        return self.medium.apply(
            goal.client, lambda engine, now: engine.actions.cancel_goal(goal, now)
        )

    def answer_cancel(self, goal: GoalKey, *, accepted: bool, text: str = "") -> None:
        """Answer a cancel at the server."""
        self.serve(
            lambda engine, now: engine.actions.answer_cancel(
                goal, now, accepted=accepted, text=text
            )
        )

    def of(self, kind: type[Any], node: int | None = None) -> list[Any]:
        """Return the events of one kind."""
        return [
            event for at, _, event in self.told if isinstance(event, kind) and node in (None, at)
        ]

    def when(self, kind: type[Any]) -> float:
        """Return when the only event of a kind came, s."""
        (instant_s,) = (at for _, at, event in self.told if isinstance(event, kind))
        return instant_s

    def run(self, until_s: float) -> None:
        self.medium.run(until_s=until_s)

    def _note(self, record: TraceRecord) -> None:
        if record.what == "transmit":
            self.frames.append((record.node, bytes.fromhex(record.frame)))
            self.instants.append(record.at / NS_PER_S)

    def _take(self, node: int, event: Event) -> None:
        if not isinstance(event, ActionEvent):
            return
        self.told.append((node, self.now_s, event))
        if isinstance(event, GoalReceived) and self._accepts:
            assert self.serve(lambda engine, now: engine.actions.accept(event.goal, now))


@pytest.mark.parametrize("seed", [446, 1669])
def test_confirm_that_waits_is_not_for_a_goal_of_the_next_epoch(seed: int) -> None:
    assert GoalScenario(seed).run() == []


@pytest.mark.parametrize("half", range(2))
def test_no_goal_runs_twice_and_each_ends_once_whatever_goes_wrong(
    half: int, count: Callable[[int], int]
) -> None:
    for number in range(count(1000)):
        drawn = GoalScenario(2 * number + half)
        assert drawn.run() == []


def test_scenario_finds_it_when_a_provisional_confirm_holds_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def believe(self: Handshake, peer: Peer, now: int) -> None:
        peer.take(Change.CONFIRM)

    monkeypatch.setattr(Handshake, "_heard_provisional_confirm", believe)
    assert any(GoalScenario(seed).run() for seed in (92,))


def test_goal_is_accepted_fed_and_ended() -> None:
    bench = Bench()
    goal = bench.send()
    bench.run(10)
    assert bench.of(GoalAnswered) == [GoalAnswered(goal=goal, accepted=True)]
    assert [event.value for event in bench.of(GoalReceived, 1)] == [b"there"]
    assert bench.feed(goal, b"half way")
    bench.run(20)
    assert [event.value for event in bench.of(FeedbackReceived, 2)] == [b"half way"]
    assert bench.finish(goal)
    assert not bench.finish(goal)
    assert not bench.feed(goal, b"late")
    bench.run(60)
    assert bench.of(ResultReceived) == [ResultReceived(goal=goal, status=SUCCEEDED, value=b"done")]
    bench.run(10_000)
    assert bench.medium.is_quiet
    for address, other in ((1, 2), (2, 1)):
        assert bench.medium.journal(address).entries.keys() == {"epoch", "life", f"lives/{other}"}


def test_rejected_goal_says_why() -> None:
    bench = Bench(accepts=False)
    goal = bench.send()
    bench.run(5)
    bench.serve(lambda engine, now: engine.actions.reject(goal, now, text="battery low"))
    bench.run(30)
    assert bench.of(GoalAnswered) == [
        GoalAnswered(goal=goal, accepted=False, failure=GoalFailure.REJECTED, text="battery low")
    ]
    assert not bench.serve(lambda engine, now: engine.actions.accept(goal, now))


def test_cancel_overtakes_a_thousand_samples() -> None:
    bench = Bench()
    goal = bench.send()
    bench.run(30)
    for number in range(1000):
        bench.medium.publish(2, 1, b"%60d" % number)
    bench.run(33.3)
    assert bench.medium.engine(2).pending(1) > 900
    bench.cancel(goal)
    bench.run(36)
    # The frame that is on the air, the next one, and the way: 400 m.
    assert bench.when(CancelRequested) < 33.3 + 1.0 + 1.0 + 0.3
    assert bench.medium.engine(2).pending(1) > 900


def test_cancel_is_answered_and_the_goal_ends_canceled() -> None:
    bench = Bench()
    goal = bench.send()
    bench.run(20)
    assert bench.cancel(goal)
    bench.run(25)
    assert len(bench.of(CancelRequested, 1)) == 1
    bench.answer_cancel(goal, accepted=True)
    bench.run(30)
    assert bench.of(CancelAnswered) == [CancelAnswered(goal=goal, accepted=True)]
    bench.finish(goal, CANCELED, None)
    bench.run(60)
    assert bench.of(ResultReceived) == [ResultReceived(goal=goal, status=CANCELED, value=None)]
    assert not bench.cancel(goal)


def test_refused_cancel_may_be_asked_for_again() -> None:
    bench = Bench()
    goal = bench.send()
    for at_s in (20, 60):
        bench.run(at_s)
        bench.cancel(goal)
        bench.run(at_s + 5)
        bench.answer_cancel(goal, accepted=False, text="too deep")
        bench.run(at_s + 15)
    refused = CancelAnswered(goal=goal, accepted=False, text="too deep")
    assert bench.of(CancelAnswered) == [refused, refused]
    assert len(bench.of(CancelRequested)) == 2


@pytest.mark.parametrize("restarts", [False, True])
def test_copies_that_come_an_hour_late_neither_ask_again_nor_answer_another_cancel(
    restarts: bool,
) -> None:
    # Each frame comes at once, and again after any time-out is over.
    bench = Bench(
        trace=True,
        result_timeout_s=20_000,
        disturb=lambda source, node, now: (0.0, 600.0, 3600.0),
    )
    goal = bench.send()
    for number in range(6):
        at_s = 20 + 570 * number
        bench.run(at_s)
        if restarts and number == 3:
            bench.medium.restart(2)
        assert bench.cancel(goal)
        bench.run(at_s + 60)
        assert len(bench.of(CancelAnswered)) == number  # nobody has answered this one
        bench.answer_cancel(goal, accepted=number == 5, text="" if number == 5 else str(number))
        bench.run(at_s + 120)
    answers = [(event.accepted, event.text) for event in bench.of(CancelAnswered)]
    assert answers == [(False, str(number)) for number in range(5)] + [(True, "")]
    bench.run(9000)
    assert len(bench.of(CancelRequested)) == 6
    assert len(bench.of(CancelAnswered)) == 6
    # That it will end is final: whoever asks again is told at once.
    before = len(bench.frames)
    assert bench.cancel(goal)
    assert len(bench.of(CancelAnswered)) == 7
    bench.run(9100)
    said = {frame for node, frame in bench.frames[before:] if node == 2}
    assert said <= {Confirm(ASSURED, 1).encode()}  # which answers a copy


def test_cancel_of_a_client_that_dies_is_not_answered_to_its_next_life() -> None:
    bench = Bench()
    goal = bench.send()
    bench.run(20)
    bench.cancel(goal)
    bench.run(25)
    bench.medium.crash(2)
    bench.answer_cancel(goal, accepted=False)
    bench.run(40)
    bench.medium.start(2)
    bench.run(41)
    bench.cancel(goal)
    bench.run(60)
    assert len(bench.of(CancelRequested)) == 2
    assert bench.of(CancelAnswered) == []
    bench.answer_cancel(goal, accepted=True)
    bench.run(80)
    assert bench.of(CancelAnswered) == [CancelAnswered(goal=goal, accepted=True)]


def test_attempts_go_round_after_two_hundred_and_fifty_six() -> None:
    bench = Bench(result_timeout_s=20_000)
    goal = bench.send()
    bench.run(20)
    for number in range(300):
        bench.cancel(goal)
        bench.run(30 + 20 * number)
        bench.answer_cancel(goal, accepted=False, text=str(number))
        bench.run(40 + 20 * number)
    assert [event.text for event in bench.of(CancelAnswered)] == [str(each) for each in range(300)]
    assert len(bench.of(CancelRequested)) == 300


def test_goal_runs_where_hello_of_the_server_was_heard_after_its_confirmation() -> None:
    # A first HELLO is that of a new life, as far as the client knows: it is not confirmed any more.
    # The server took it for confirmed, and said in short what was dropped.
    bench: Bench | None = None

    def disturb(source: int, node: int, now: int) -> tuple[float, ...]:
        assert bench is not None
        confirms = bench.frames[-1][1][0] == CONFIRM_CODE
        return () if source == 1 and confirms and now > 60 * NS_PER_S else (0.0,)

    bench = Bench(disturb=disturb, trace=True, timeout_s=60)
    for number in range(5):
        bench.medium.at(10 * number, partial(bench.medium.publish, 2, 1, b"x"))
    bench.run(60)
    # The server has said nothing but its confirmation.
    assert [frame for node, frame in bench.frames if node == 1] == [b"\xb5\2\0\1"]
    goal = bench.send()
    bench.run(80)
    assert bench.of(GoalAnswered) == [GoalAnswered(goal=goal, accepted=True)]
    bench.finish(goal)
    bench.run(300)
    assert [event.goal for event in bench.of(ResultReceived)] == [goal]
    assert len(bench.of(GoalReceived)) == 1
    frames = bench.medium.engine(1).stats.frames_transmitted
    bench.run(3000)
    assert bench.medium.engine(1).stats.frames_transmitted == frames


def test_confirm_of_the_client_ends_what_the_server_says_of_itself() -> None:
    bench = Bench(trace=True)
    goal = bench.send()
    for number in range(4):
        bench.run(30 * number + 3)
        bench.feed(goal, b"%d" % number)
    bench.run(200)
    said = [frame.hex() for node, frame in bench.frames if node == 1 and frame[-1:].isdigit()]
    # Behind a provisional confirm for the client's epoch, 1, as long as that does not know it to be
    # known.
    assert said == ["b10001b5ff00011ea030", "1ea031", "1ea032", "1ea033"]
    # Confirms, and not a record of the client: it has said nothing but its goal.
    assert {frame[-2:] for node, frame in bench.frames if node == 2} == {b"re", b"\0\1"}


def named_by_its_epoch(*, heard_until_s: float = NEVER_S) -> tuple[Bench, GoalKey]:
    """Return a goal whose server does not know that its client knows itself confirmed.

    Args:
        heard_until_s: The server hears the client until then.
    """

    def disturb(source: int, _: int, now: int) -> tuple[float, ...]:
        at_s = now / NS_PER_S
        return () if (5 < at_s < 305 if source == 1 else at_s > heard_until_s) else (0.0,)

    bench = Bench(trace=True, disturb=disturb)
    bench.medium.publish(1, 1, b"x")
    for number in range(6):  # in vain
        bench.medium.at(10 + 20 * number, partial(bench.medium.publish, 2, 1, b"x"))
    bench.run(300)
    return bench, bench.send()


def test_client_that_is_named_by_its_epoch_confirms_the_server_at_once() -> None:
    bench, goal = named_by_its_epoch()
    for number in range(4):
        bench.run(320 + 20 * number)
        bench.feed(goal, b"%d" % number)
    bench.run(400)
    said = [frame.hex() for node, frame in bench.frames if node == 1 and frame[-1:].isdigit()]
    former, present = "1ee00001a0", "1ea0"
    assert said == [former + "30", *(present + digit for digit in ("31", "32", "33"))]


def test_client_whose_confirms_do_not_arrive_sends_ever_fewer() -> None:
    bench, goal = named_by_its_epoch(heard_until_s=312)
    confirms = []
    for number in range(400):
        bench.run(314 + 3 * number)
        bench.feed(goal, b"fed")
        sent = Confirm(ASSURED, 1).encode()
        confirms.append(sum(frame == sent for node, frame in bench.frames if node == 2))
    assert len(bench.of(FeedbackReceived)) > 390
    assert confirms[100] <= 25
    assert confirms[399] - confirms[200] <= 20  # of 199


def test_only_a_node_that_is_silent_for_long_is_told_again_who_this_one_is() -> None:
    bench = Bench(trace=True, disturb=lambda source, _, now: () if now > 100e9 else (0.0,))
    goal = bench.send()
    for number in range(4):
        bench.run(20 * number + 3)
        bench.feed(goal, b"%d" % number)
    bench.run(101)
    before = len(bench.frames)
    bench.instants.clear()
    bench.send()
    bench.run(160)
    frames = [frame for _, frame in bench.frames[before:]]
    first = [frame[0] == HELLO_CODE for frame in frames].index(True)
    pauses = [after - at for at, after in itertools.pairwise(bench.instants)]
    assert all(frame[0] == HELLO_CODE for frame in frames[first:])
    assert first == 1 + pauses.index(next(pause for pause in pauses if pause > 2 * pauses[0]))


def test_result_that_did_not_get_through_twice_is_asked_for() -> None:
    lost = [0]
    result = b"a result of some length"

    def disturb(source: int, node: int, now: int) -> tuple[float, ...]:
        lost[0] -= source == 1
        return () if source == 1 and lost[0] >= 0 else (0.0,)

    bench = Bench(disturb=disturb, trace=True)
    goal = bench.send()
    bench.run(60)
    lost[0] = 2
    bench.finish(goal, value=result)
    bench.run(120)
    assert [event.value for event in bench.of(ResultReceived)] == [result]
    whole = [frame for node, frame in bench.frames if node == 1 and frame.endswith(result)]
    assert len(whole) == 3
    claims = [frame for node, frame in bench.frames if node == 2 and frame[1:] == b"\x20"]
    assert len(claims) == 1


def test_goal_that_was_not_sent_yet_is_cancelled_without_a_frame() -> None:
    bench = Bench()
    bench.medium.set_link(2, up=False)
    goal = bench.send()
    assert bench.cancel(goal)
    bench.medium.set_link(2, up=True)
    bench.run(60)
    (answered,) = bench.of(GoalAnswered)
    assert answered.failure is GoalFailure.CANCELLED
    assert bench.of(GoalReceived) == []
    assert bench.medium.engine(2).stats.frames_transmitted == 0


def test_cancel_that_overtakes_its_goal_prevents_it() -> None:
    lost: list[bool] = [True]
    bench = Bench(disturb=lambda source, node, now: () if lost[0] else (0.0,))
    goal = bench.send()
    bench.run(3)
    assert bench.medium.engine(2).stats.transmitted == {30: 1}
    lost[0] = False
    bench.cancel(goal)
    bench.run(60)
    (answered,) = bench.of(GoalAnswered)
    assert (answered.accepted, answered.failure) == (False, GoalFailure.CANCELLED)
    assert bench.of(GoalReceived) == []


def test_of_feedback_only_the_newest_goes_and_not_more_often_than_allowed() -> None:
    bench = Bench(feedback_interval_s=5.0)
    goal = bench.send()
    bench.run(20)
    for number in range(300):
        bench.medium.at(20 + 0.1 * number, partial(bench.feed, goal, b"%d" % number))
    bench.run(60)
    got = [
        (at, int(event.value)) for _, at, event in bench.told if isinstance(event, FeedbackReceived)
    ]
    assert 6 <= len(got) <= 8
    assert [number for _, number in got] == sorted({number for _, number in got})
    for (before_s, _), (after_s, number) in itertools.pairwise(got):
        assert after_s - before_s >= 4.5
        # From a publication to the other end: a frame, the way, a period of publishing.
        assert after_s - (20 + 0.1 * number) < 1.0
    assert got[-1][1] == 299


def test_result_is_claimed_after_half_an_hour_of_silence() -> None:
    outage = {"blackouts": [{"node": 1, "from_s": 20, "to_s": 1820}]}
    bench = Bench(faults=outage)
    goal = bench.send()
    bench.medium.at(100, partial(bench.finish, goal))
    bench.run(1820)
    assert bench.of(ResultReceived) == []
    bench.run(2200)
    assert [event.value for event in bench.of(ResultReceived)] == [b"done"]


def test_goal_survives_its_client_and_its_server_is_asked() -> None:
    bench = Bench()
    goal = bench.send(tag=b"mission 7")
    bench.run(20)
    bench.medium.crash(2)
    bench.run(40)
    bench.finish(goal)
    bench.run(60)
    bench.medium.start(2)
    bench.run(100)
    assert bench.of(GoalRecovered) == [GoalRecovered(goal=goal, tag=b"mission 7")]
    assert [event.goal for event in bench.of(ResultReceived)] == [goal]
    assert len(bench.of(GoalReceived)) == 1
    other = bench.send()
    bench.run(120)
    assert bench.of(GoalAnswered)[-1] == GoalAnswered(goal=other, accepted=True)
    assert other.epoch == goal.epoch + 1


def test_goal_of_a_former_life_can_be_cancelled() -> None:
    bench = Bench()
    goal = bench.send()
    bench.run(20)
    bench.medium.restart(2)
    bench.run(21)
    bench.cancel(goal)
    bench.run(40)
    assert [event.goal for event in bench.of(CancelRequested)] == [goal]


def test_goal_that_ran_when_its_server_died_is_unknown_and_does_not_run_again() -> None:
    bench = Bench()
    goal = bench.send()
    bench.run(20)
    bench.medium.restart(1)
    bench.run(60)
    (failed,) = bench.of(GoalFailed)
    assert (failed.goal, failed.failure) == (goal, GoalFailure.UNKNOWN)
    assert len(bench.of(GoalReceived)) == 1
    assert not bench.finish(goal)


def test_server_without_a_journal_says_that_it_does_not_know_a_goal() -> None:
    bench = Bench(journal=False)
    bench.send()
    bench.run(20)
    bench.medium.restart(1)
    bench.medium.publish(1, 1, b"I am back")
    bench.run(60)
    (failed,) = bench.of(GoalFailed)
    assert failed.failure is GoalFailure.UNKNOWN
    assert failed.text == "the server does not know it any more"


def test_goal_of_which_nothing_is_heard_is_asked_after_and_then_given_up() -> None:
    bench = Bench(result_timeout_s=600)
    bench.send()
    bench.run(650)
    assert bench.of(GoalFailed) == []  # asked after 300 s, and answered
    bench.medium.crash(1)
    bench.run(2000)
    (failed,) = bench.of(GoalFailed)
    assert failed.failure is GoalFailure.TIMED_OUT
    assert 900 < bench.when(GoalFailed) < 1300
    assert bench.medium.is_quiet


def test_goal_is_not_taken_when_its_client_has_given_it_up() -> None:
    bench = Bench(accepts=False, timeout_s=20)
    goal = bench.send()
    bench.run(25)
    (failed,) = bench.of(GoalFailed)
    assert failed.failure is GoalFailure.TIMED_OUT
    assert not bench.serve(lambda engine, now: engine.actions.accept(goal, now))


def test_a_goal_that_runs_on_does_not_hold_up_a_hundred_others() -> None:
    bench = Bench(timeout_s=60)
    long = bench.send()
    bench.run(20)
    for number in range(100):
        goal = bench.send(value=b"%d" % number)
        bench.run(20 + 30 * number + 10)
        assert bench.finish(goal, value=b"%d" % number)
        bench.run(20 + 30 * number + 30)
    assert [event.value for event in bench.of(ResultReceived)] == [b"%d" % n for n in range(100)]
    assert bench.feed(long, b"still here")
    bench.finish(long)
    bench.run(3100)
    assert bench.of(FeedbackReceived)[-1].goal == long
    assert bench.of(ResultReceived)[-1].goal == long
    assert len(bench.of(GoalReceived)) == 101


def test_more_than_twelve_goals_at_once_are_refused() -> None:
    bench = Bench(timeout_s=1000)
    for _ in range(12):
        bench.send()
    with pytest.raises(QueueFullError, match="12 goals for node 1 are under way"):
        bench.send()
    bench.run(100)
    assert len(bench.of(GoalReceived)) == 12


def test_goal_survives_a_new_epoch_of_its_client() -> None:
    bench = Bench(tables={1: fleet(), 2: fleet()})
    goal = bench.send()
    bench.run(20)
    extra = TopicSpec(stream_id=2, name="b")
    for node in (1, 2):
        bench.medium.apply(node, lambda engine, now: engine.declare(extra, now))
    bench.feed(goal, b"nobody has told the server of the new epoch")
    bench.run(60)
    bench.finish(goal)
    bench.run(120)
    assert bench.medium.engine(2).epoch > goal.epoch
    assert bench.of(GoalRecovered) == []
    assert [event.goal for event in bench.of(ResultReceived)] == [goal]


def test_stream_that_differs_fails_the_goal() -> None:
    tables = {1: fleet(), 2: fleet(result_timeout_s=10.0)}
    bench = Bench(tables=tables)
    bench.send()
    bench.run(20)
    (failed,) = bench.of(GoalFailed)
    assert failed.failure is GoalFailure.TABLE_MISMATCH
    assert failed.text == "node 1 defines stream 30 in another way"
    bench.send()
    assert len(bench.of(GoalFailed)) == 2


def test_action_works_between_nodes_that_differ_in_another_stream() -> None:
    other = fleet()
    other.declare(TopicSpec(stream_id=9, name="only here"))
    bench = Bench(tables={1: fleet(), 2: other})
    goal = bench.send()
    bench.run(60)
    bench.finish(goal)
    bench.run(120)
    assert [event.value for event in bench.of(ResultReceived)] == [b"done"]


def test_several_clients_have_goals_of_the_same_number() -> None:
    bench = Bench(4)
    goals: dict[GoalKey, bytes] = {}
    for node in (2, 3, 4):
        for number in range(3):
            value = b"%d.%d" % (node, number)

            def send(node: int = node, value: bytes = value) -> None:
                goals[bench.send(node, value)] = value

            bench.medium.at(10.0 * node + number, send)
    bench.run(200)
    assert {event.goal: event.value for event in bench.of(GoalReceived)} == goals
    for goal, value in goals.items():
        bench.finish(goal, value=b"re " + value)
    bench.run(400)
    results = {event.goal: event.value for event in bench.of(ResultReceived)}
    assert results == {goal: b"re " + value for goal, value in goals.items()}
    assert {goal.number for goal in goals} == {0, 1, 2}
