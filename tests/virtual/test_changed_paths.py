"""Routes whose paths change while they are used: nothing is lost, nothing runs twice.

The sea lets frames over two hops through at 60 %, so paths with and without each relay work.
"""

import contextlib
import random
from collections import Counter
from collections.abc import Callable
from functools import partial

import pytest

from tests.virtual.lineoffive import ARM, KEPT, MOVE, NODES, LineOfFive, route
from tests.virtual.sealed import SealedFleet
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailed, Event, ResponseReceived
from zacoustic.core.linktypes import ReceivedFrame
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.wire.relay import Number, Relayed
from zacoustic.core.wire.relay import decode as decode_relayed
from zacoustic.core.wire.routing import RoutingAnswer, RoutingKind, RoutingRequest
from zacoustic.errors import LocalError

HOUR_S = 3600.0
SETTLED_S = 8 * HOUR_S
"""A CONFIRM is said again after 256 units at the latest; a unit of this route is a minute."""
WHOLE = (1, 2, 3, 4, 5)
PATHS = (WHOLE, (1, 3, 5), (1, 2, 4, 5), (1, 3, 4, 5), (1, 3, 2, 4, 5), (1, 4, 2, 5))
RELAYS = (2, 3, 4)


def change(line: LineOfFive, node: int, request: RoutingRequest) -> RoutingAnswer | None:
    """Let a node execute a request, if it runs; returns its answer once that is journalled."""
    answers: list[RoutingAnswer] = []
    if line.network.is_running(node):
        line.network.apply(
            node, lambda e, now: e.routing.execute(request, now, lambda a, at: answers.append(a))
        )
    return answers[0] if answers else None


def set_path(revision: int, number: int, path: tuple[int, ...]) -> RoutingRequest:
    return RoutingRequest(
        kind=RoutingKind.SET, route_id=1, revision=revision, number=number, path=path
    )


def reset(revision: int) -> RoutingRequest:
    return RoutingRequest(kind=RoutingKind.RESET, route_id=1, revision=revision)


class Changes:
    """Random changes of the path while a line is used; some nodes get them late, some never."""

    def __init__(self, line: LineOfFive, rng: random.Random) -> None:
        self._line = line
        self._rng = rng
        self.revision = 0

    def begin(self) -> None:
        """Change the path: relays first, or in any order."""
        rng, network = self._rng, self._line.network
        self.revision += 1
        request = reset(self.revision)
        path = rng.choice(PATHS)
        if rng.random() < 0.8:
            request = set_path(self.revision, 31 - self.revision % 25, path)
        nodes = [*RELAYS, NODES, 1]
        if rng.random() < 0.3:
            rng.shuffle(nodes)
        at_s = network.now / 1e9
        for node in nodes:
            at_s += rng.choice((0.0, 1.0, 20.0))
            if rng.random() < 0.9:
                network.at(at_s, partial(self._tell, node, request))

    def end(self) -> None:
        """Undo all changes at all nodes."""
        self.revision += 1
        for node in WHOLE:
            self._tell(node, reset(self.revision))

    def _tell(self, node: int, request: RoutingRequest) -> None:
        with contextlib.suppress(LocalError):  # it comes late, or its number is still in use
            change(self._line, node, request)


@pytest.mark.parametrize("sealed", [False, True])
def test_reliable_samples_and_calls_survive_changes_of_the_path(
    sealed: bool, count: Callable[[int], int]
) -> None:
    for seed in range(count(100)):
        rng = random.Random(seed)
        build = SealedFleet() if sealed else Engine
        line = LineOfFive(None, seed=seed, build=build, disturb=_repeats_late(rng))
        changes = Changes(line, rng)
        called: Counter[tuple[int, object]] = Counter()

        def act(number: int) -> None:
            if number % 3 == 0:
                called[ARM, line.call(b"call %d" % number)] += 1  # noqa: B023
            elif number % 3 == 1:
                called[MOVE, line.send_goal(b"goal %d" % number)] += 1  # noqa: B023
            else:
                line.publish(KEPT, b"%d" % number)  # noqa: B023

        times = line.every(60.0, HOUR_S, rng, act)
        line.every(300.0, HOUR_S, rng, lambda number: changes.begin())  # noqa: B023
        for _ in range(3):
            at_s = rng.uniform(60.0, HOUR_S)
            line.network.at(at_s, partial(line.network.crash, node := rng.choice(RELAYS)))
            line.network.at(at_s + rng.choice((0.1, 5, 60)), partial(line.network.start, node))
        line.network.at(HOUR_S + 60.0, changes.end)
        line.network.run(until_s=SETTLED_S)
        published = [b"%d" % number for number in range(times) if number % 3 == 2]
        assert line.values(KEPT) == published, f"seed {seed}"
        assert not [each for each, times in line.served.items() if times > 1], f"seed {seed}: twice"
        assert line.ended == called, f"seed {seed}"
        assert all(line.network.engine(each).is_idle for each in WHOLE)


def _repeats_late(rng: random.Random) -> Callable[[int, int, int], tuple[float, ...]]:
    lifetime_s = route(*WHOLE).longest_s

    def disturb(source: int, node: int, now: int) -> tuple[float, ...]:
        return (0.0, rng.uniform(0.0, lifetime_s)) if rng.random() < 0.1 else (0.0,)

    return disturb


def test_frames_take_the_new_path_and_only_that() -> None:
    numbers: Counter[tuple[int, int]] = Counter()

    def note(record: TraceRecord) -> None:
        frame = decode_relayed(bytes.fromhex(record.frame or ""))
        if record.what == "transmit" and record.link == "link" and isinstance(frame, Relayed):
            numbers[record.node, frame.number.route] += 1

    line = LineOfFive(None, seed=3, trace=note)
    line.network.run(until_s=5.0)
    for node in (3, NODES, 1):
        change(line, node, set_path(1, 31, (1, 3, 5)))
    for number in range(10):
        line.network.at(60.0 * number + 10.0, partial(line.publish, KEPT, b"%d" % number))
    line.network.run(until_s=2 * HOUR_S)
    assert line.values(KEPT) == [b"%d" % number for number in range(10)]
    assert {number for _, number in numbers} == {31}
    assert {node for node, _ in numbers} == {1, 3, NODES}
    assert {name: each.path for name, each in line.network.engine(1).changed_paths.items()} == {
        "far": (1, 3, 5)
    }


def test_a_path_survives_a_restart_where_there_is_a_journal_and_reset_undoes_it() -> None:
    line = LineOfFive(None, seed=4)
    line.network.run(until_s=5.0)
    for node in WHOLE:
        change(line, node, set_path(7, 30, (1, 3, 5)))
    line.network.run(until_s=10.0)
    for node in WHOLE:
        line.network.restart(node)
    line.network.run(until_s=15.0)
    asked = RoutingRequest(kind=RoutingKind.ASK, route_id=1)
    for node in WHOLE:
        assert change(line, node, asked) == RoutingAnswer(revision=7, number=30, path=(1, 3, 5))
        line.network.apply(
            node, lambda e, now: e.routing.execute(reset(8), now, lambda a, at: None)
        )
    line.network.run(until_s=20.0)
    line.network.restart(1)
    line.network.run(until_s=25.0)
    assert change(line, 1, asked) == RoutingAnswer(revision=8, number=1, path=WHOLE)
    with pytest.raises(LocalError, match="overtaken: revision 8 is known"):
        change(line, 1, set_path(7, 30, (1, 3, 5)))


@pytest.mark.parametrize(
    ("command", "why"),
    [
        (set_path(1, 31, (1, 3, 4)), "a path from 1 to 5 is allowed"),
        (set_path(1, 31, (5, 3, 1)), "a path from 1 to 5 is allowed"),
        (set_path(1, 1, (1, 3, 5)), "number 1 is in use"),
        (set_path(1, 2, (1, 3, 5)), "number 2 is in use"),
        (set_path(1, 31, (1, *range(10, 24), 5)), "15 hops take too long for it"),
        (RoutingRequest(kind=RoutingKind.ASK, route_id=9), "no route 9"),
        (RoutingRequest(kind=RoutingKind.RESET, route_id=9, revision=1), "no route 9 in the file"),
    ],
)
def test_what_a_node_refuses(command: RoutingRequest, why: str) -> None:
    routes = (route(*WHOLE, lifetime_s=60.0), route(2, 3, 4, route_id=2, name="middle"))
    line = LineOfFive(0.1, routes=routes)
    line.network.run(until_s=5.0)
    with pytest.raises(LocalError, match=why):
        change(line, 3, command)


def test_a_number_has_one_path_for_as_long_as_frames_may_be_on_their_way() -> None:
    line = LineOfFive(None)
    line.network.run(until_s=5.0)
    change(line, 1, set_path(1, 31, (1, 3, 5)))
    change(line, 1, set_path(2, 30, (1, 2, 4, 5)))
    with pytest.raises(LocalError, match="number 31 is in use for another path"):
        change(line, 1, set_path(3, 31, (1, 2, 3, 5)))
    line.network.run(until_s=5.0 + 2 * route(*WHOLE).longest_s + 1.0)
    change(line, 1, set_path(3, 31, (1, 2, 3, 5)))
    assert line.network.engine(1).changed_paths["far"].path == (1, 2, 3, 5)


class Command:
    """A line whose first node commands the second, and whose frames are kept."""

    def __init__(self, *, sealed: bool, rules: TransmitRules) -> None:
        self.frames: list[bytes] = []
        self.ends: list[Event] = []
        build = SealedFleet() if sealed else Engine
        self.line = LineOfFive(
            0.0001, rules=rules, build=build, trace=self._note, happened=self._end
        )
        self.line.network.run(until_s=5.0)

    def give(self, request: RoutingRequest) -> None:
        network = self.line.network
        network.apply(1, lambda e, now: e.routing.send(2, request, now, timeout_s=100.0))
        network.run(until_s=network.now / 1e9 + 120.0)

    def replay(self) -> None:
        """Let node 2 hear all frames of node 1 again."""
        network = self.line.network
        for frame_bytes in list(self.frames):
            frame = ReceivedFrame(
                frame_bytes=frame_bytes,
                received_at=network.local_ns(2),
                source=1,
                destination=2,
            )
            network.apply(2, lambda e, now: e.handle_frame(frame, now))  # noqa: B023
            network.run(until_s=network.now / 1e9 + 5.0)

    @property
    def path(self) -> tuple[int, ...]:
        """The path at node 2."""
        asked = RoutingRequest(kind=RoutingKind.ASK, route_id=1)
        answer = change(self.line, 2, asked)
        assert answer is not None
        return answer.path

    def _note(self, record: TraceRecord) -> None:
        if record.what == "transmit" and record.node == 1 and record.frame:
            self.frames.append(bytes.fromhex(record.frame))

    def _end(self, node: int, event: Event) -> None:
        if isinstance(event, ResponseReceived | CallFailed):
            self.ends.append(event)


@pytest.mark.parametrize("restarted", [False, True])
@pytest.mark.parametrize("sealed", [False, True])
def test_a_replayed_command_changes_nothing(sealed: bool, restarted: bool) -> None:
    command = Command(sealed=sealed, rules=TransmitRules())
    command.give(set_path(1, 31, (1, 3, 2, 5)))
    changed: tuple[int, ...] = (1, 3, 2, 5)
    assert command.path == changed
    command.give(reset(2))
    command.line.network.run(until_s=HOUR_S)
    if restarted:
        command.line.network.restart(2)
        command.line.network.run(until_s=HOUR_S + 60.0)
    command.replay()
    command.line.network.run(until_s=2 * HOUR_S)
    assert command.path == WHOLE


@pytest.mark.parametrize("sealed", [False, True])
def test_who_may_not_command_changes_no_path(sealed: bool) -> None:
    command = Command(sealed=sealed, rules=TransmitRules(commands_from=frozenset({9})))
    command.give(set_path(1, 31, (1, 3, 2, 5)))
    assert command.path == WHOLE
    (end,) = command.ends
    assert isinstance(end, CallFailed)
    assert end.text == "node 2 takes no commands from 1"


def test_frames_of_a_number_that_a_node_does_not_know_go_nowhere() -> None:
    line = LineOfFive(0.1, seed=5)
    line.network.run(until_s=5.0)
    relayed = Relayed(Number(31, False, 9), b"\x01what").encode()
    frame = ReceivedFrame(
        frame_bytes=relayed, received_at=line.network.local_ns(2), source=1, destination=255
    )
    line.network.apply(2, lambda e, now: e.handle_frame(frame, now))
    line.network.run(until_s=HOUR_S)
    assert line.frames == 0
    assert line.dropped("relay_route") == 1
