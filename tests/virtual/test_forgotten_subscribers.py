"""A publisher of an on-demand topic starts again without its journal, and publishes.

Its subscribers are on shore and stay; nothing else of it would ever be on the channel.
"""

from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec
import pytest

from tests.virtual.fleet import line
from zacoustic.core.base.qos import Forward, Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

VIEW: Final = 10
SHORE: Final = 1
RULES: Final = TransmitRules(contact=ContactRules(announces=True))
DAY_S: Final = 86_400.0


def table(nodes: int, *, reliable: bool = False) -> StreamTable:
    reliability = Reliability.RELIABLE if reliable else Reliability.BEST_EFFORT
    qos = Qos(forward=Forward.ON_DEMAND, depth=4, reliability=reliability)
    return StreamTable(
        [TopicSpec(stream_id=VIEW, name="{node}/view", qos=qos)],
        nodes={address: f"n{address}" for address in range(1, nodes + 1)},
    )


def network(
    seed: int,
    nodes: int = 2,
    *,
    loss: float = 0.0,
    keeps: bool = False,
    reliable: bool = False,
    rules: TransmitRules = RULES,
    **faults: Any,
) -> VirtualNetwork:
    journal: Mapping[str, Any] = {"commit_s": 0.02, "keeps": keeps}
    scenario = line(
        *(150 * place for place in range(nodes)),
        seed=seed,
        channel="none",
        loss={"frame": loss},
        faults={"journal": journal, **faults},
    )
    return VirtualNetwork(scenario, table(nodes, reliable=reliable), rules=rules, digest=False)


def restart(sea: VirtualNetwork, *addresses: int) -> None:
    for address in addresses:
        sea.crash(address)
        sea.start(address)


def want(sea: VirtualNetwork, address: int, *sources: int) -> None:
    sea.apply(address, lambda engine, now: engine.subscriptions.want(VIEW, now, sources))


def publish(sea: VirtualNetwork, address: int, every_s: float, from_s: float, to_s: float) -> None:
    for number in range(int((to_s - from_s) / every_s)):
        sea.at(from_s + number * every_s, lambda: sea.publish(address, VIEW, b"look"))


def first_after(sea: VirtualNetwork, at_s: float, source: int) -> float:
    """Return when the first sample of a node arrived on shore, s after an instant."""
    return min(
        (
            event.received_at / NS_PER_S - at_s
            for address, event in sea.events
            if address == SHORE
            and isinstance(event, SampleReceived)
            and event.source == source
            and event.received_at > at_s * NS_PER_S
        ),
        default=float("inf"),
    )


@pytest.mark.parametrize("reliable", [False, True])
@pytest.mark.parametrize("loss", [0.0, 0.4])
def test_its_subscribers_have_it_again(
    count: Callable[[int], int], loss: float, reliable: bool
) -> None:
    after_s = []
    for seed in range(count(100)):
        sea = network(seed, loss=loss, reliable=reliable)
        want(sea, SHORE, 2)
        sea.at(600.0, lambda sea=sea: restart(sea, 2))  # type: ignore[misc]
        publish(sea, 2, 3.0, 605.0, 1200.0)
        sea.run(until_s=1300.0)
        after_s.append(first_after(sea, 605.0, 2))
    assert max(after_s) < (300.0 if loss else 30.0)
    assert sorted(after_s)[len(after_s) // 2] < (60.0 if loss else 20.0)


def test_it_has_them_after_an_outage_of_hours(count: Callable[[int], int]) -> None:
    for seed in range(count(20)):
        outage = [{"from_s": 500.0, "to_s": 500.0 + 4 * 3600.0, "pair": [1, 2]}]
        sea = network(seed, loss=0.2, blackouts=outage)
        want(sea, SHORE, 2)
        sea.at(600.0, lambda sea=sea: restart(sea, 2))  # type: ignore[misc]
        publish(sea, 2, 10.0, 605.0, 500.0 + 6 * 3600.0)
        back_s = 500.0 + 4 * 3600.0
        sea.run(until_s=back_s + 2 * 3600.0)
        assert first_after(sea, back_s, 2) < 4 * 3600.0 / 2


def test_one_that_nobody_wants_costs_little() -> None:
    sea = network(1)
    restart(sea, 2)
    publish(sea, 2, 20.0, 10.0, DAY_S)
    sea.run(until_s=DAY_S)
    frames = sum(stats.frames_transmitted for stats in sea.stats_of(2))
    assert frames <= 6  # the other node has confirmed it, and wants nothing
    assert sea.engine(2).poll_timeout() is None


def test_one_that_nobody_hears_costs_some_forty_frames_a_day() -> None:
    sea = network(1)
    sea.crash(SHORE)
    publish(sea, 2, 20.0, 10.0, DAY_S)
    sea.run(until_s=DAY_S)
    assert 10 <= sum(stats.frames_transmitted for stats in sea.stats_of(2)) <= 60


def test_one_that_publishes_nothing_says_nothing() -> None:
    sea = network(1)
    restart(sea, 2)
    sea.run()
    assert sum(stats.frames_transmitted for stats in sea.stats()) == 0


def test_one_whose_journal_has_them_does_not_ask() -> None:
    sea = network(1, keeps=True)
    want(sea, SHORE, 2)
    sea.run(until_s=100.0)
    restart(sea, 2)
    sea.run(until_s=200.0)
    want(sea, SHORE)
    sea.run(until_s=300.0)
    before = sum(stats.frames_transmitted for stats in sea.stats_of(2))
    publish(sea, 2, 20.0, 300.0, 2000.0)
    sea.run(until_s=2100.0)
    assert sum(stats.frames_transmitted for stats in sea.stats_of(2)) == before


def test_many_that_start_again_at_once_all_have_them_again(sized: Callable[..., int]) -> None:
    many = sized(20, share=12)
    sea = network(3, many, rules=msgspec.structs.replace(RULES, agreement=AgreementMethod.TAG))
    others = range(2, many + 1)
    want(sea, SHORE, *others)
    sea.at(900.0, lambda: restart(sea, *others))
    for address in others:
        publish(sea, address, 60.0, 901.0 + address / 10, 3000.0)
    sea.run(until_s=3000.0)
    after_s = [first_after(sea, 900.0, address) for address in others]
    assert max(after_s) < 1800.0, after_s
