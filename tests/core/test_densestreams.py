"""What strings save is booked: who is in the red sends records, and tries again."""

import random

from zacoustic.core.schedule.savings import Savings


def test_a_block_that_is_a_byte_longer_goes_until_that_has_not_paid() -> None:
    savings = Savings()
    tries = 0
    while savings.is_worth(11, 10):
        savings.book(-1)
        tries += 1
    assert tries == 6
    savings.book(-1)
    assert not savings.is_worth(9, 10)
    assert savings.is_worth(6, 10)  # saves more than an acknowledgement costs
    assert not Savings().is_worth(12, 10)


def test_whatever_comes_the_loss_is_bounded() -> None:
    for seed in range(50):
        rng, savings, lost_bytes = random.Random(seed), Savings(), 0
        dear = rng.random()
        for _ in range(2000):
            block_bytes = 20 + (rng.random() < dear) - rng.choice((0, 0, 1, 5))
            if savings.is_worth(block_bytes, 20):
                savings.book(20 - block_bytes)
                lost_bytes += block_bytes - 20
                if rng.random() < 0.5:
                    savings.book(-3)
                    lost_bytes += 3
        assert lost_bytes <= 6 + 4 + 2000 / 32, seed


def test_a_block_is_tried_again() -> None:
    savings = Savings()
    savings.book(-20)
    tries = [number for number in range(2000) if savings.is_worth(10, 10)]
    assert 400 < tries[0] < 500
