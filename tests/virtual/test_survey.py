"""`zacoustic route probe` in virtual time: who is reached, what is measured, what is proposed."""

import random
from collections.abc import Callable

import pytest

from tests.virtual.lineoffive import NODES, LineOfFive, route
from zacoustic.app.tools.field.changing import PathChanged, change_path
from zacoustic.app.tools.field.probing import (
    Asker,
    Survey,
    Way,
    best_path,
    proposals,
    routes_text,
    survey,
)
from zacoustic.core.engine.events import CallFailed, Event, ResponseReceived
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.wire.calls import CallFailure
from zacoustic.core.wire.routing import RoutingAnswer, RoutingRequest
from zacoustic.errors import CallTimeoutError, ServiceError
from zacoustic.zenoh.requests.routing import RoutingReport

ADDRESSES = range(1, NODES + 1)


class VirtualAsker(Asker):
    """Asks from the first node of a line; time passes in the medium."""

    def __init__(self, loss: float | None, **more: object) -> None:
        self._ends: dict[int, ResponseReceived | CallFailed] = {}
        self.line = LineOfFive(loss, happened=self._take, **more)  # type: ignore[arg-type]
        self.line.network.run(until_s=5.0)

    async def own(self) -> int:
        return 1

    async def ask(self, node: int, request: RoutingRequest, timeout_s: float) -> RoutingReport:
        network, answers = self.line.network, []
        if node == 1:
            network.apply(
                1, lambda e, now: e.routing.execute(request, now, lambda a, at: answers.append(a))
            )
            answer: RoutingAnswer = answers[0]
        else:
            call_id = network.apply(
                1, lambda e, now: e.routing.send(node, request, now, timeout_s=timeout_s)
            )
            while call_id not in self._ends:
                await self.wait(1.0)
            end = self._ends.pop(call_id)
            if isinstance(end, CallFailed):
                kind = ServiceError if end.failure is CallFailure.HANDLER else CallTimeoutError
                raise kind(end.text)
            answer = RoutingAnswer.decode(request.kind, end.value)
        return RoutingReport(
            address=node,
            by=1,
            sent_s=network.engine(1).stats.airtime_ns / 1e9,
            over_s=answer.over_s,
            airtime_ms=answer.airtime_ms,
            heard=dict(answer.heard),
            revision=answer.revision,
            number=answer.number,
            path=answer.path,
        )

    async def wait(self, seconds: float) -> None:
        self.line.network.run(until_s=self.line.network.now / 1e9 + seconds)

    def _take(self, node: int, event: Event) -> None:
        if node == 1 and isinstance(event, ResponseReceived | CallFailed):
            self._ends[event.call_id] = event


def survey_of(asker: VirtualAsker, nodes: range = ADDRESSES, count: int = 8) -> Survey:
    """Run a survey to its end; nothing in it waits for anything but the medium."""
    run = survey(asker, nodes, count=count, timeout_s=60.0, rng=random.Random(1))
    with pytest.raises(StopIteration) as ended:
        run.send(None)
    found: Survey = ended.value.value
    return found


def test_the_whole_line_is_reached_and_its_route_proposed(count: Callable[[int], int]) -> None:
    """Only neighbours hear each other, and lose 20 %."""
    lost = []
    for seed in range(count(50)):
        found = survey_of(VirtualAsker(0.2, seed=seed))
        assert set(found.over) == set(ADDRESSES), f"seed {seed}: {found.missing}"
        assert found.over[NODES] == (2, 3, 4)
        heard = {(each.source, each.hearer) for each in found.ways if each.heard}
        assert heard <= {(a, b) for a in ADDRESSES for b in ADDRESSES if abs(a - b) == 1}
        lost += [each.loss for each in found.ways if abs(each.source - each.hearer) == 1]
        (proposed,) = [
            each for each in proposals(found, [(1, NODES)], routes=()) if each.path[-1] == NODES
        ]
        assert proposed.path == (1, 2, 3, 4, 5), f"seed {seed}"
        assert 4 <= proposed.transmissions < 20
        assert found.own_airtime_s > 0
        assert found.probes_airtime_s > 0
    assert 0.12 < sum(lost) / len(lost) < 0.28


def test_a_node_that_is_gone_is_named(count: Callable[[int], int]) -> None:
    for seed in range(count(20)):
        asker = VirtualAsker(0.1, seed=seed)
        asker.line.network.crash(4)
        found = survey_of(asker)
        assert set(found.over) == {1, 2, 3}
        assert set(found.missing) == {4, 5}
        assert best_path(found, 1, 5) == ()


def test_nodes_that_take_no_commands_are_named_with_their_reason() -> None:
    rules = TransmitRules(commands_from=frozenset({9}))
    found = survey_of(VirtualAsker(0.1, rules=rules), range(1, 3))
    assert found.missing == {2: "node 2 takes no commands from 1"}
    assert set(found.over) == {1}


def survey_with(count: int = 8, **heard: int) -> Survey:
    """Return what was measured; `w12` is how much node 2 has heard of node 1."""
    ways = tuple(
        Way(source=int(name[1]), hearer=int(name[2]), heard=number, sent=count)
        for name, number in heard.items()
    )
    nodes = {each.source for each in ways}
    over: dict[int, tuple[int, ...]] = dict.fromkeys(nodes, ())
    return Survey(own=1, count=count, ways=ways, over=over, missing={})


def test_a_route_is_proposed_where_it_takes_fewer_transmissions_than_the_direct_way() -> None:
    poor = survey_with(w13=2, w31=4, w12=8, w21=8, w23=8, w32=8)
    assert best_path(poor, 1, 3) == (1, 2, 3)
    assert poor.cost(1, 3) == 8.0
    good = survey_with(w13=7, w31=7, w12=8, w21=8, w23=8, w32=8)
    assert best_path(good, 1, 3) == (1, 3)
    assert proposals(good, [(1, 3)]) == []


def test_a_way_in_one_direction_is_none() -> None:
    found = survey_with(w12=8, w21=0)
    assert found.cost(1, 2) is None
    assert best_path(found, 1, 2) == ()


def test_of_equal_paths_the_shorter_and_lower_one_is_taken() -> None:
    full = {f"w{a}{b}": 8 for a in range(1, 5) for b in range(1, 5) if a != b}
    full |= {"w14": 4, "w41": 8}  # the direct way costs as much as two hops
    assert best_path(survey_with(**full), 1, 4) == (1, 4)
    full |= {"w14": 0}
    assert best_path(survey_with(**full), 1, 4) == (1, 2, 4)


def test_a_proposal_keeps_number_and_name_of_the_route_of_the_file() -> None:
    found = survey_with(w13=1, w31=1, w12=8, w21=8, w23=8, w32=4)
    (known,) = proposals(found, [(1, 3)], routes=[route(3, 1, route_id=7)])
    assert (known.id, known.name, known.path) == (7, "far", (3, 2, 1))
    assert (known.present, known.present_transmissions) == ((3, 1), 64.0)
    (other,) = proposals(found, [(1, 3)], names={3: "auv1"}, taken=[1])
    assert (other.id, other.name, other.transmissions) == (2, "to_auv1", 3.0)
    assert routes_text([other]) == ('routes: [\n  { id: 2, name: "to_auv1", path: [1, 2, 3] },\n],')
    assert routes_text([]) == "routes: [],"


def change_of(asker: VirtualAsker, path: tuple[int, ...], *, undo: bool = False) -> PathChanged:
    """Change route 1, and give the command again where a node does not answer in time."""
    for _ in range(8):
        run = change_path(asker, 1, path, undo=undo, taken=[1], timeout_s=60.0)
        try:
            run.send(None)
        except StopIteration as ended:
            changed: PathChanged = ended.value
            if not changed.failed:
                return changed
        except (CallTimeoutError, ServiceError):  # nothing has changed
            continue
    raise AssertionError("no node answers")


def test_a_path_is_changed_and_reset_over_lossy_hops(count: Callable[[int], int]) -> None:
    whole, other = (1, 2, 3, 4, 5), (1, 3, 4, 5)
    for seed in range(count(50)):
        asker = VirtualAsker(None, seed=seed)
        changed = change_of(asker, other)
        assert changed.done[-2:] == (5, 1), f"seed {seed}"
        assert 1 <= changed.revision == 32 - changed.number
        again = change_of(asker, (1, 2, 4, 5))
        assert again.revision > changed.revision
        assert again.number < changed.number
        change_of(asker, whole, undo=True)
        for node in whole:
            assert not asker.line.network.engine(node).changed_paths, f"seed {seed}"


def test_where_a_node_does_not_answer_nothing_changes() -> None:
    asker = VirtualAsker(None)
    asker.line.network.crash(3)
    run = change_path(asker, 1, (1, 3, 5), taken=[1], timeout_s=60.0)
    with pytest.raises(CallTimeoutError, match="node 3 has not answered"):
        run.send(None)
    assert not any(asker.line.network.engine(each).changed_paths for each in (1, 5))
