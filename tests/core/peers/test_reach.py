"""Whether a link of a bond reaches a node."""

import pytest

from zacoustic.core.bond.reach import PeerReach, Reach
from zacoustic.core.bond.spec import BondLink, LinkCost
from zacoustic.core.clock import NS_PER_S
from zacoustic.errors import ConfigError

FREE = BondLink(cost=LinkCost.FREE)


def test_a_free_link_is_up_when_answered_and_down_when_not() -> None:
    reach = PeerReach(FREE)
    states = [reach.state]
    reach.answered(0)
    states.append(reach.state)
    reach.overdue(100 * NS_PER_S)
    states.append(reach.state)
    reach.review(102 * NS_PER_S)
    states.append(reach.state)
    reach.review(103 * NS_PER_S)
    states.append(reach.state)
    assert states == [Reach.DOWN, Reach.UP, Reach.DOUBT, Reach.DOUBT, Reach.DOWN]
    assert not reach.may_try(107 * NS_PER_S)
    assert reach.may_try(108 * NS_PER_S)


def test_an_unsteady_link_is_tried_less_often() -> None:
    reach = PeerReach(FREE)
    now, pauses = 0, []
    for _ in range(6):
        reach.answered(now)
        reach.overdue(now)
        now += 3 * NS_PER_S
        reach.review(now)
        pauses.append((reach.next_try_at - now) // NS_PER_S)
        now = reach.next_try_at
    assert pauses == [10, 20, 40, 60, 60, 60]
    reach.answered(now)
    now += 100 * NS_PER_S
    reach.overdue(now)
    now += 3 * NS_PER_S
    reach.review(now)
    assert reach.next_try_at - now == 5 * NS_PER_S


def test_to_be_heard_is_a_hope_for_a_short_while() -> None:
    reach = PeerReach(FREE)
    reach.heard(0)
    assert reach.state is Reach.DOWN
    assert reach.is_hopeful(10 * NS_PER_S)
    assert not reach.is_hopeful(11 * NS_PER_S)


def test_silence_counts_where_nobody_answers() -> None:
    reach = PeerReach(BondLink())
    states = [reach.state]
    for second in range(0, 590, 10):
        reach.transmitted(second * NS_PER_S)
    states.append(reach.state)
    reach.transmitted(600 * NS_PER_S)
    states.append(reach.state)
    reach.heard(700 * NS_PER_S)
    states.append(reach.state)
    assert states == [Reach.UP, Reach.UP, Reach.DOWN, Reach.UP]
    last = PeerReach(BondLink(), is_last=True)
    for second in range(0, 2000, 10):
        last.transmitted(second * NS_PER_S)
    assert last.state is Reach.UP


def test_an_answer_is_sure_for_ten_seconds() -> None:
    reach = PeerReach(FREE)
    reach.answered(0)
    assert reach.is_sure(10 * NS_PER_S)
    assert not reach.is_sure(11 * NS_PER_S)
    assert PeerReach(BondLink()).is_sure(10**15)


@pytest.mark.parametrize("key", ["probe_s", "down_after_s"])
def test_durations_are_checked(key: str) -> None:
    values = {"probe_s": 1.0, "down_after_s": 1.0, key: float("nan")}
    with pytest.raises(ConfigError, match=key):
        BondLink(probe_s=values["probe_s"], down_after_s=values["down_after_s"])
