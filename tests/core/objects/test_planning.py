"""How many repair fragments to send."""

import random

from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.transport.objects.sending.planning import LossEstimate, Need, repairs_to_send


def known(lacking: int, loss: float, *, seen: float = 300.0) -> Need:
    return Need(lacking, seen * (1 - loss), max(0.5, seen * loss))


def test_without_loss_nothing_is_added() -> None:
    assert repairs_to_send([Need(7, 400.0, 0.5)], 3.0, 255) == 7


def test_more_where_more_is_lost_and_where_a_round_is_dearer() -> None:
    few = repairs_to_send([known(40, 0.2)], 3.0, 255)
    many = repairs_to_send([known(40, 0.5)], 3.0, 255)
    assert 40 < few < many < 100
    assert repairs_to_send([known(40, 0.2)], 20.0, 255) > few


def test_several_receivers_need_the_largest_of_their_numbers() -> None:
    one = repairs_to_send([known(40, 0.3)], 3.0, 255)
    three = repairs_to_send([known(40, 0.3)] * 3, 3.0, 255)
    assert one < three <= 1.3 * one


@given(
    st.lists(
        st.tuples(st.integers(1, 255), st.floats(0.01, 0.99), st.floats(2, 400)),
        min_size=1,
        max_size=8,
    ),
    st.floats(0, 100),
)
def test_number_is_in_its_bounds(needs: list[tuple[int, float, float]], cost: float) -> None:
    least = max(lacking for lacking, _, _ in needs)
    number = repairs_to_send([known(n, loss, seen=seen) for n, loss, seen in needs], cost, 255)
    assert least <= number <= 255


def test_loss_is_learnt_and_forgotten() -> None:
    loss = LossEstimate()
    rng = random.Random(1)
    for _ in range(50):
        loss.learn(20, sum(rng.random() < 0.7 for _ in range(20)))
    assert 0.25 < loss.loss < 0.35
    for _ in range(60):
        loss.learn(20, 20)
    assert loss.loss < 0.05


@given(st.lists(st.tuples(st.integers(-5, 300), st.integers(-300, 300))))
def test_nonsense_is_learnt_without_harm(reports: list[tuple[int, int]]) -> None:
    loss = LossEstimate()
    for sent, received in reports:
        loss.learn(max(0, sent), received)
        assert 0 < loss.loss < 1
