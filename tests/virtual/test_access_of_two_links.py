"""Medium access of one link: slots and turns hold for that link, and for no other one."""

import random
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from tests.virtual.twolinks import (
    ARM,
    BESIDE,
    KEPT,
    LINKS,
    MOVE,
    PLAN,
    RADIO,
    SOUND,
    TwoLinks,
    rules,
)
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.profiles.rules import LinkRules
from zacoustic.core.schedule.access import PollingSpec, TdmaSpec

PHOTO = random.Random(7).randbytes(1500)
NODES = 3
LOST = {"noise", "unplugged"}
"""What may become of a frame where nobody transmits out of turn."""
SLOT_S = 6.0
SLOTS = TdmaSpec(slots=(1, 2, 3), slot_s=SLOT_S, guard_s=2.0, clock_error_s=0.0)
TURNS = PollingSpec(poller=1, nodes=(2, 3), idle_s=20.0)
RADIO_SLOTS = TdmaSpec(slots=(3, 2, 1), slot_s=1.0, guard_s=0.5, clock_error_s=0.0)


def arrived(seed: int, loss: tuple[float, float], **access: Any) -> TwoLinks:
    """Use everything on both links, let nodes come and go, and see it arrive."""
    rng = random.Random(seed)
    own = {link: LinkRules(name=link, access=access.get(link)) for link in LINKS}
    fleet = TwoLinks(NODES, loss=loss, seed=seed, rules=rules(own[SOUND], own[RADIO]))
    network = fleet.network
    tags = [b"%d" % number for number in range(3)]
    for tag in tags:
        network.at(rng.uniform(10, 400), partial(fleet.use_all, tag, PHOTO))
    link, away_s = rng.choice(LINKS), rng.uniform(10, 400)
    network.at(away_s, partial(network.set_link, 3, up=False, link=link))
    network.at(away_s + rng.uniform(10, 200), partial(network.set_link, 3, up=True, link=link))
    network.run(until_s=9000.0)
    for first in (0, BESIDE):
        for node in (1, 3):
            for stream_id, words in ((PLAN, (b"plan", PHOTO)), (KEPT, (b"kept",))):
                wanted = sorted(word + tag for word in words for tag in tags)
                assert sorted(fleet.got(node, first + stream_id)) == wanted, (seed, node)
        for stream_id, word in ((ARM, b"arm"), (MOVE, b"move")):
            assert [fleet.served[first + stream_id, word + tag] for tag in tags] == [1] * 3, seed
    return fleet


def outside_their_slots(fleet: TwoLinks, link: str, slots: TdmaSpec) -> list[float]:
    """Return the instants of frames that were not sent in a slot of their sender, s."""
    network = fleet.network
    ahead_ns = network.wall_ns(1) - network.now  # of UTC, by which slots go
    slot_ns = round(slots.slot_s * NS_PER_S)
    wrong = []
    for node, at, frame in fleet.sent(link):
        airtime_ns = network.capabilities(node, link).airtime_ns(len(frame))
        begins, ends = ((at + ahead_ns) // slot_ns, (at + airtime_ns + ahead_ns) // slot_ns)
        if {slots.slots[each % len(slots.slots)] for each in (begins, ends)} != {node}:
            wrong.append(at / NS_PER_S)
    return wrong


@pytest.mark.parametrize("loss", [(0.0, 0.0), (0.2, 0.3)])
def test_slots_hold_for_their_link(count: Callable[[int], int], loss: tuple[float, float]) -> None:
    for seed in range(count(100)):
        fleet = arrived(seed, loss, sound=SLOTS)
        assert not outside_their_slots(fleet, SOUND, SLOTS), seed
        assert set(fleet.network.losses) <= LOST, (seed, fleet.network.losses)
        assert outside_their_slots(fleet, RADIO, SLOTS), seed


@pytest.mark.parametrize("loss", [(0.0, 0.0), (0.2, 0.3)])
def test_turns_hold_for_their_link(count: Callable[[int], int], loss: tuple[float, float]) -> None:
    for seed in range(count(100)):
        fleet = arrived(seed, loss, sound=TURNS)
        assert set(fleet.network.losses) <= LOST, (seed, fleet.network.losses)


def test_each_link_has_slots_of_its_own(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        fleet = arrived(seed, (0.1, 0.1), sound=SLOTS, radio=RADIO_SLOTS)
        assert not outside_their_slots(fleet, SOUND, SLOTS), seed
        assert not outside_their_slots(fleet, RADIO, RADIO_SLOTS), seed


def test_turns_on_sound_and_slots_on_the_radio(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        fleet = arrived(seed, (0.1, 0.1), sound=TURNS, radio=RADIO_SLOTS)
        assert set(fleet.network.losses) <= LOST, (seed, fleet.network.losses)
        assert not outside_their_slots(fleet, RADIO, RADIO_SLOTS), seed
