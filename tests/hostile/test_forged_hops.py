"""Frames over other nodes, and an enemy without a key: it makes nobody transmit, and ends nothing.

Whatever goes over relays, is flooded, or goes by a bond has bytes that a node acts on before the
end of the way has opened what is inside: numbers, acknowledgements, trains, questions.
"""

import random
from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

import pytest

from tests.hostile.hops import ABORT, BOND, ENEMIES, NODES, ROUTE, STOP, Hops, Trial
from tests.virtual.test_members import MemberFleet
from tests.virtual.twolinks import RADIO, SOUND
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.wire.bond import Bonded
from zacoustic.core.wire.flood import Flooded
from zacoustic.core.wire.relay import HopAcks, Number, Relayed

INSIDE: Final = bytes(range(200, 240))
"""It looks like a sealed frame with a long head."""
SHORT: Final = bytes(range(40))
"""The same with a short one."""
FLEETS: Final = {"one key": None, "a key each": MemberFleet}


def _forged() -> Iterator[tuple[str, int, int, str, bytes, int]]:
    """Yield what, to whom, under whose address, by which link, the frame, its destination."""
    for name, inside in (("long", INSIDE), ("short", SHORT)):
        for to in NODES:
            for source in (to - 1, to + 1):
                if source not in NODES:
                    continue
                for is_back in (False, True):
                    number = Number(ROUTE.route_id, is_back, 77)
                    for more in (False, True):
                        frame = Relayed(number, inside, more=more).encode()
                        yield f"relayed {name}", to, source, SOUND, frame, BROADCAST
                    yield "hop ack", to, source, SOUND, HopAcks((number,)).encode(), BROADCAST
                for origin in (source, 4 if to < 3 else 1):
                    frame = Flooded(origin, BROADCAST, 77, 2, inside).encode()
                    yield f"flooded {name}", to, source, SOUND, frame, BROADCAST
                for link in (SOUND, RADIO):
                    for destination in (to, BROADCAST):
                        for content in (inside, b""):
                            frame = Bonded(BOND.number, 9, content, True).encode()
                            yield f"bonded {name}", to, source, link, frame, destination


@pytest.mark.parametrize("fleet", FLEETS)
@pytest.mark.parametrize("knows", [False, True], ids=["before", "after traffic"])
def test_no_forged_frame_makes_a_node_transmit(fleet: str, *, knows: bool) -> None:
    make = FLEETS[fleet]
    hops = Hops(build=None if make is None else make())
    if knows:
        hops.acquaint()
    hops.network.run(until_s=1200.0)
    before, told = len(hops.sent), len(hops.told)
    forged = list(_forged())
    assert len(forged) > 100
    for number, (_, to, source, link, frame, destination) in enumerate(forged):
        hops.network.at(
            1300.0 + 40.0 * number,
            partial(hops.inject, to, source, frame, link, destination),
        )
    hops.network.run(until_s=1300.0 + 40.0 * len(forged) + 600.0)
    caused = {forged[int((each[0] - 1300.0) // 40.0)][0] for each in hops.sent[before:]}
    assert not caused
    assert hops.told[told:] == []


@pytest.mark.parametrize("fleet", FLEETS)
def test_no_frame_that_is_played_back_makes_a_node_transmit(
    fleet: str, count: Callable[[int], int]
) -> None:
    """Whoever has recorded everything plays it to each node that has heard it, an hour later.

    To other nodes as well, under other addresses: a frame that never came is only late.
    """
    make = FLEETS[fleet]
    hops = Hops(build=None if make is None else make())
    hops.acquaint()
    hops.network.run(until_s=5000.0)
    recorded = [each for each in hops.sent if each[3]]
    rng = random.Random("played back")
    # What a node could not open when it came is new to it, once.
    first = [(each, to) for each in recorded for to in NODES if each[3] in hops.heard[to, each[2]]]
    for number, ((_, node, link, frame), to) in enumerate(first):
        records, destination = (frame[2:], frame[0]) if link == RADIO else (frame, BROADCAST)
        play = partial(hops.inject, to, node, records, link, destination)
        hops.network.at(5000.0 + 2.0 * number, play)
    begins_s = 9000.0 + 2.0 * len(first)
    hops.network.run(until_s=begins_s)
    before, told = len(hops.sent), len(hops.told)
    times = count(20_000)
    for number in range(times):
        _, node, link, frame = rng.choice(recorded)
        to = rng.choice([each for each in NODES if each != node])
        others = [each for each in NODES if each not in (to, node)]
        source = node if frame in hops.heard[to, link] else rng.choice(others)
        records = frame[2:] if link == RADIO else frame
        destination = frame[0] if link == RADIO else rng.choice((BROADCAST, to))
        hops.network.at(
            begins_s + 2.0 * number,
            partial(hops.inject, to, source, records, link, destination),
        )
    hops.network.run(until_s=begins_s + 2.0 * times + 3600.0)
    assert hops.sent[before:] == []
    assert hops.told[told:] == []


@pytest.mark.parametrize("kind", ENEMIES[1:])
@pytest.mark.parametrize("stream_id", [STOP, ABORT])
def test_an_enemy_ends_no_custody(kind: str, stream_id: int, sized: Callable[..., int]) -> None:
    """At 40 % loss on each hop an urgent sample arrives as often as without the enemy."""
    seeds, arrived = range(sized(20, share=2)), dict.fromkeys(("none", kind), 0)
    for each in arrived:
        for seed in seeds:
            trial = Trial(seed, each, stream_id, loss=0.4, stops=20)
            assert bool(trial.enemy.forged) == (each != "none")
            arrived[each] += len(trial.delays_s)
    assert arrived[kind] >= arrived["none"] - 2 * len(seeds), arrived  # of 20 each
