"""Carried samples: each arrives once and in order, by whatever way, and its publisher learns it."""

import random
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from tests.virtual.mule import (
    MOORING,
    MULE,
    PERIOD_S,
    PHOTO,
    SHIP,
    Voyage,
    table,
)
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import DeliveryOutcome
from zacoustic.core.profiles.rules import TransmitRules


def quickly(source: int, node: int, now: int) -> bool:
    """Return whether two nodes hear each other on a voyage with a pass every five minutes."""
    at_s = now / NS_PER_S % 300
    ends = {source, node}
    if ends == {MOORING, MULE}:
        return at_s < 60
    return ends == {MULE, SHIP} and 150 <= at_s < 210


def quick_table(**more: Any) -> Any:
    """Return a table for such a voyage."""
    return table(after_s=30.0, **more)


def report(voyage: Voyage) -> None:
    """Check that everything arrived once and in order, and that the mooring knows it."""
    got = [value for value, _ in voyage.got]
    again = [value for value, is_again in voyage.got if is_again]
    firsts = list(dict.fromkeys(got))
    # What was not journalled when the mooring died may have gone with it.
    expected = [each for each in voyage.given if each in voyage.stored or each in firsts]
    assert firsts == expected
    assert len(got) - len(firsts) <= len(again), "doubled, and not flagged"
    assert voyage.outcomes == dict.fromkeys(expected, DeliveryOutcome.DELIVERED)


def test_mule_brings_what_two_nodes_say_that_never_hear_each_other(
    sized: Callable[..., int],
) -> None:
    for seed in range(sized(12, share=1)):
        voyage = Voyage(seed, loss=0.2)
        hours = sized(12, share=3)
        for index in range(hours * 30):
            voyage.publish_at(120.0 * index + 60, b"%d" % index)
        voyage.network.run(until_s=(hours + 1.6) * PERIOD_S)
        report(voyage)
        assert all(each.custodian == MULE for each in voyage.custody)
        for address in (MOORING, MULE, SHIP):
            names = voyage.network.journal(address).entries
            assert not [key for key in names if key.startswith(("carry/", "carryback"))]


@pytest.mark.parametrize("address", [MOORING, MULE, SHIP])
def test_nothing_is_lost_or_doubled_when_a_node_is_killed(
    address: int, count: Callable[[int], int]
) -> None:
    for point in range(count(200)):
        rng = random.Random(1000 * address + point)
        voyage = Voyage(point, loss=0.2, hears=quickly, table=quick_table())
        for index in range(20):
            voyage.publish_at(10.0 + 25 * index, b"%d" % index)
        for _ in range(3):
            at_s = rng.uniform(5, 700)
            crash = partial(voyage.network.crash, address, reboots=rng.random() < 0.5)
            voyage.network.at(at_s, crash)
            voyage.network.at(at_s + rng.uniform(1, 40), partial(voyage.network.start, address))
        voyage.network.run(until_s=2400)
        report(voyage)


def test_straight_way_that_opens_now_and_then_doubles_nothing(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        rng = random.Random(seed)
        opens = sorted(rng.uniform(0, 1500) for _ in range(8))

        def hears(source: int, node: int, now: int) -> bool:
            at_s = now / NS_PER_S
            if {source, node} == {MOORING, SHIP}:
                return any(each <= at_s < each + 40 for each in opens)  # noqa: B023
            return quickly(source, node, now)

        voyage = Voyage(
            seed, loss=rng.choice([0.0, 0.2, 0.4]), hears=hears, copies=(rng.uniform(0, 20),),
            table=quick_table(),
        )  # fmt: skip
        for index in range(40):
            voyage.publish_at(10.0 + 25 * index, b"%d" % index)
        voyage.network.run(until_s=3600)
        report(voyage)


def test_large_samples_are_carried_as_well(count: Callable[[int], int]) -> None:
    for seed in range(count(20)):
        voyage = Voyage(seed, loss=0.1)
        photos = [random.Random(seed + each).randbytes(10_240) for each in range(3)]
        for index, photo in enumerate(photos):
            voyage.publish_at(30.0 + 3000 * index, photo, PHOTO)
            voyage.publish_at(60.0 + 3000 * index, b"%d" % index)
        voyage.network.run(until_s=6 * PERIOD_S)
        assert sorted(value for value, _ in voyage.got) == sorted(voyage.given)
        assert voyage.ended == {DeliveryOutcome.DELIVERED: 6}


def test_full_custodian_refuses_and_the_publisher_learns(count: Callable[[int], int]) -> None:
    for seed in range(count(50)):
        voyage = Voyage(
            seed, loss=0.2, hears=quickly, table=quick_table(),
            rules=TransmitRules(carry_bytes=100),
        )  # fmt: skip
        for index in range(12):
            voyage.publish_at(10.0 + 2 * index, b"%d" % index)
        voyage.network.run(until_s=2 * 3600)
        report(voyage)
        refused = [each for each in voyage.custody if each.custodian is None]
        assert refused
        assert all(each.detail == "node 2 has no room for it" for each in refused)


def test_samples_go_along_a_chain_of_custodians_and_never_back(count: Callable[[int], int]) -> None:
    other = 4

    def hears(source: int, node: int, now: int) -> bool:
        at_s, ends = now / NS_PER_S % 400, {source, node}
        if ends == {MOORING, MULE}:
            return at_s < 60
        if ends == {MULE, other}:
            return 100 <= at_s < 160
        return ends == {other, SHIP} and 200 <= at_s < 260

    for seed in range(count(50)):
        nodes = (MOORING, MULE, SHIP, other)
        voyage = Voyage(
            seed,
            loss=0.2,
            hears=hears,
            nodes=nodes,
            table=quick_table(by=(other, MULE), nodes=nodes),
        )
        for index in range(12):
            voyage.publish_at(10.0 + 25 * index, b"%d" % index)
        voyage.network.run(until_s=3 * 3600)
        report(voyage)


def test_what_nobody_carries_in_time_expires_at_its_publisher_and_on_the_way() -> None:
    voyage = Voyage(hears=quickly, table=quick_table(expires_s=120.0))
    voyage.publish_at(10.0, b"too late")
    voyage.network.run(until_s=1200)
    assert voyage.got == []
    assert voyage.ended == {DeliveryOutcome.EXPIRED: 1}
    assert [each.custodian for each in voyage.custody] == [MULE]


def test_newer_samples_supersede_older_ones_beyond_the_depth() -> None:
    voyage = Voyage(hears=quickly, table=quick_table(depth=3))
    for index in range(10):
        voyage.publish_at(70.0 + index, b"%d" % index)
    voyage.network.run(until_s=1200)
    assert [value for value, _ in voyage.got] == [b"7", b"8", b"9"]
    assert voyage.ended == {DeliveryOutcome.SUPERSEDED: 7, DeliveryOutcome.DELIVERED: 3}


def test_idle_fleet_is_silent() -> None:
    voyage = Voyage()
    voyage.network.run(until_s=24 * 3600)
    sent = sum(voyage.network.engine(each).stats.frames_transmitted for each in (1, 2, 3))
    assert sent == 0


def test_nodes_in_reach_talk_straight() -> None:
    voyage = Voyage(hears=lambda source, node, now: True)
    for index in range(20):
        voyage.publish_at(10.0 + 30 * index, b"%d" % index)
    voyage.network.run(until_s=1000)
    report(voyage)
    assert voyage.custody == []
    assert max(at_s for at_s in voyage.got_s.values()) < 10 + 30 * 19 + 30
