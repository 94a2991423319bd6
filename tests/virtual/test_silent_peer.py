"""Silence follows: a peer that does not answer costs little, whatever waits, and gets all at once.

`tests.virtual.silentpeer` has the runs; `tests/benchmarks/bench_silence.py` prints the table.
"""

import random
from collections.abc import Callable, Sequence
from functools import partial

import msgspec
import pytest

from tests.virtual.silentpeer import (
    GIVER,
    MOST_A_DAY,
    ONE_OF_EACH,
    Outcome,
    Silence,
    Trial,
    Waits,
    Way,
    rest_of,
)
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.linktypes import LinkState
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import DeliveryEnded, SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

_OBJECTS = (Waits.OBJECT, Waits.KEPT_OBJECT)
_FIRST_ROUNDS = 15
"""On routes and floods a large sample has been given once before the first answer is missing."""
_BONDED = 8
"""An emergency goes by each link of a bond in its first minute."""
_MOST_LATE = 95
"""On routes and floods one of everything, after its first ten minutes."""


def most(outcome: Outcome) -> int:
    """Return the most frames of a node in a day."""
    return max(max(each) for each in outcome.frames.values())


@pytest.mark.parametrize("way", Way)
def test_a_day_of_silence_costs_few_frames_whatever_waits(
    way: Way, count: Callable[[int], int]
) -> None:
    for seed in range(count(20)):
        for kind in rest_of(Waits, way):
            outcome = Trial(seed, way, (kind,)).run()
            is_inside = way in (Way.ROUTE, Way.FLOOD)
            allowed = MOST_A_DAY + _FIRST_ROUNDS * (is_inside and kind in _OBJECTS)
            allowed += _BONDED * (way is Way.BOND and kind is Waits.EMERGENCY)
            assert most(outcome) <= allowed, (seed, kind)
            assert outcome.ended == {}, (seed, kind)
            # It says that it is back.
            assert max(outcome.arrived_s.values(), default=0.0) < 900, (seed, kind)


@pytest.mark.parametrize("way", Way)
def test_a_day_of_silence_costs_as_little_if_all_kinds_wait(
    way: Way, count: Callable[[int], int]
) -> None:
    for seed in range(count(100)):
        outcome = Trial(seed, way, rest_of(ONE_OF_EACH, way)).run()
        if way in (Way.ROUTE, Way.FLOOD):
            assert max(outcome.late_frames.values()) <= _MOST_LATE, seed
        else:
            assert most(outcome) <= MOST_A_DAY, seed
        assert max(outcome.arrived_s.values()) < 3600, seed


def test_an_emergency_among_all_that_costs_some_more(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        waits = (*rest_of(ONE_OF_EACH, Way.PLAIN), Waits.EMERGENCY)
        assert most(Trial(seed, Way.PLAIN, waits).run()) <= MOST_A_DAY + 40, seed


@pytest.mark.parametrize(
    "way",
    [
        Way.PLAIN,
        *(pytest.param(each, marks=pytest.mark.soak) for each in Way if each is not Way.PLAIN),
    ],
)
def test_each_further_day_costs_less_than_a_third(way: Way, count: Callable[[int], int]) -> None:
    for seed in range(count(20)):
        waits = (*rest_of(ONE_OF_EACH, way), Waits.EMERGENCY)
        outcome = Trial(seed, way, waits).run(days=4, returns=False)
        for days in outcome.frames.values():
            assert max(days[1:]) < MOST_A_DAY / 3, (seed, days)


@pytest.mark.parametrize(
    "way",
    [
        Way.PLAIN,
        *(pytest.param(each, marks=pytest.mark.soak) for each in Way if each is not Way.PLAIN),
    ],
)
def test_a_peer_that_is_heard_and_does_not_hear_costs_no_more(
    way: Way, sized: Callable[..., int]
) -> None:
    kinds = rest_of(Waits, way)[:: sized(1, share=4)]
    together = [each for each in rest_of(ONE_OF_EACH, way) if each is not Waits.TABLE]
    for seed in range(sized(5, share=1)):
        # On a route its frames are acknowledged, in a flood they are passed on.
        talk = Trial(seed, way, (), silence=Silence.DEAF).run(returns=False)
        for waits in (*((kind,) for kind in kinds), together):
            outcome = Trial(seed, way, waits, silence=Silence.DEAF).run(returns=False)
            for node, days in outcome.frames.items():
                more = max(a - b for a, b in zip(days, talk.frames[node], strict=True))
                assert more <= _most_deaf(way, waits), (seed, node, waits)


def _most_deaf(way: Way, waits: Sequence[Waits]) -> int:
    """Return how many frames a peer costs that is heard and hears nothing."""
    if way in (Way.ROUTE, Way.FLOOD):  # each frame of it makes those that wait go again
        return MOST_A_DAY + (60 if len(waits) == 1 else 200)
    # What it says with another table is asked for and answered.
    return MOST_A_DAY + (20 if waits == (Waits.TABLE,) else 15)


def test_a_large_sample_that_a_heard_peer_never_takes_ends_with_a_reason(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(20)):
        ended = {
            kind: Trial(seed, Way.PLAIN, (kind,), silence=Silence.DEAF).run(returns=False).ended
            for kind in _OBJECTS
        }
        assert ended[Waits.KEPT_OBJECT] == {}, "what is journalled waits"
        assert "no progress in" in ended[Waits.OBJECT][Waits.OBJECT]
        assert "though heard: node 3" in ended[Waits.OBJECT][Waits.OBJECT]


def test_a_carried_sample_that_nobody_takes_costs_as_little(count: Callable[[int], int]) -> None:
    for seed in range(count(20)):
        outcome = Trial(seed, Way.PLAIN, (Waits.CARRIED,), is_alone=True).run(returns=False)
        assert outcome.frames[GIVER][0] <= 2 * MOST_A_DAY, "two peers are silent"


class Stuck:
    """A receiver that is heard, answers, and acknowledges no sample of one journalled topic."""

    def __init__(self, seed: int) -> None:
        reliable = Qos(reliability=Reliability.RELIABLE, depth=4)
        table = StreamTable(
            [
                TopicSpec(stream_id=1, name="{node}/talk", qos=reliable),
                TopicSpec(
                    stream_id=2, name="log", publishers=(1,), subscribers=(2,), qos=reliable,
                    journal=True,
                ),
            ],
            nodes={1: "a", 2: "b"},
        )  # fmt: skip
        self.frames: list[int] = []
        self.got: list[int] = []
        full = {"node": 2, "from_s": 100, "to_s": 86_500}
        nodes = [{"address": each, "position": [500 * each, 0, 10]} for each in (1, 2)]
        self.network = VirtualNetwork(
            scenario_from_mapping(
                {
                    "seed": seed, "channel": "none", "nodes": nodes,
                    "faults": {"journal": {"fails": [full]}},
                },
                source="a test",
            ),
            table,
            digest=False,
            trace=lambda each: (
                self.frames.append(each.at) if each.what == "transmit" and each.node == 1 else None
            ),
            deliver=self._take,
        )  # fmt: skip
        self.network.every(300.0, partial(self.network.publish, 1, 1, b"?"), first_s=10)

    def _take(self, address: int, event: object) -> None:
        if isinstance(event, SampleReceived) and event.stream_id == 2:
            self.got.append(self.network.now)


def test_what_only_its_journal_keeps_a_heard_peer_from_taking_costs_little(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(20)):
        without, stuck = Stuck(seed), Stuck(seed)
        stuck.network.at(200.0, partial(stuck.network.publish, 1, 2, b"entry"))
        for each in (without, stuck):
            each.network.run(until_s=86_490)
        assert len(stuck.frames) - len(without.frames) <= MOST_A_DAY
        assert not stuck.got
        stuck.network.run(until_s=86_500 + 3 * 3600)
        assert len(stuck.got) == 1


@pytest.mark.parametrize(
    ("modem", "sizes"),
    [
        (Modem(addressed=False, checked=False, framed=False, mtu_bytes=57), (57, 24, 32, 41)),
        (Modem(mtu_bytes=64), (64, 16, 24, 48)),
    ],
)
def test_ends_with_frames_of_different_sizes_get_all(
    modem: Modem, sizes: tuple[int, ...], count: Callable[[int], int]
) -> None:
    largest, *others = sizes
    for seed in range(count(20)):
        for other in others:
            for pair in ((largest, other), (other, largest)):
                _mismatch(modem, pair, seed)


def _mismatch(modem: Modem, mtus: tuple[int, int], seed: int) -> None:
    """Let node 1 send samples of several frames to node 2, which has shorter or longer ones."""
    rng = random.Random(seed)
    qos = Qos(reliability=Reliability.RELIABLE, depth=100)
    table = StreamTable(
        [
            TopicSpec(stream_id=1, name="{node}/talk"),
            TopicSpec(stream_id=2, name="log", publishers=(1,), subscribers=(2,), qos=qos),
        ],
        nodes={1: "a", 2: "b"},
    )
    frames: list[int] = []
    ended: list[str] = []
    network = VirtualNetwork(
        scenario_from_mapping(
            {
                "seed": seed, "channel": "none",
                "nodes": [{"address": each, "position": [700 * each, 0, 10]} for each in (1, 2)],
            },
            source="a test",
        ),
        table,
        modem=modem,
        digest=False,
        disturb=lambda source, node, now: () if rng.random() < 0.2 else (0.0,),
        deliver=lambda address, event: (
            ended.append(event.outcome.value) if isinstance(event, DeliveryEnded) else None
        ),
        trace=lambda each: frames.append(each.at) if each.what == "transmit" else None,
    )  # fmt: skip

    def resize(mtu_bytes: int, engine: Engine, now: int) -> None:
        told = msgspec.structs.replace(network.capabilities(engine.address), mtu_bytes=mtu_bytes)
        engine.handle_link_state(LinkState.UP, now, told)

    for node, mtu_bytes in zip((1, 2), mtus, strict=True):
        network.apply(node, partial(resize, mtu_bytes))
        network.at(node, partial(network.publish, node, 1, b"hi"))
    for number in range(4):
        network.at(60 + 20 * number, partial(network.publish, 1, 2, bytes((number,)) * 120))
    network.at(60, partial(network.publish, 1, 2, bytes(20)))
    network.run(until_s=4 * 3600)
    assert ended == ["delivered"] * 5, (mtus, seed)
    assert max(frames) < 3600 * NS_PER_S, "silence follows"
