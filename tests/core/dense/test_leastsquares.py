"""Least squares: the weights find out what follows from what, and survive nonsense."""

import random

from zacoustic.core.values.dense.model.leastsquares import Explained, Shape

TRUST = 1 << 16


def test_packed_weights_are_the_weights() -> None:
    rng, shape = random.Random(3), Shape(6)
    weights = [[rng.randint(-(1 << 40), 1 << 40) for _ in range(k)] for k in range(6)]
    assert shape.unpacked(shape.packed(weights)) == weights


def test_what_was_learnt_elsewhere_is_carried_over_in_full_or_by_half() -> None:
    rng, shape = random.Random(4), Shape(5)
    lists = [
        [[rng.randint(-(1 << 30), 1 << 30) for _ in range(k)] for k in range(5)] for _ in range(3)
    ]
    weights, learnt, start = (shape.packed(each) for each in lists)
    for in_full in (True, False):
        found = shape.unpacked(shape.carried_over(weights, learnt, start, in_full=in_full))
        for row, *others in zip(found, *lists, strict=True):
            for number, weight, new, old in zip(row, *others, strict=True):
                moved = weight + new - old
                assert number == (moved if in_full else (weight + moved) >> 1)


def test_a_quantity_that_follows_from_others_is_predicted() -> None:
    rng, shape = random.Random(1), Shape(3)
    weights, energies = [0] * 3, [256] * 3
    misses = []
    for _ in range(400):
        first, second = rng.randint(-800, 800), rng.randint(-800, 800)
        explained = Explained(shape, weights, energies)
        prediction = explained.add((first, second))
        third = 3 * first - second // 2
        explained.add((third,))
        misses.append(abs(third - prediction))
        weights, energies = explained.moved(TRUST)
    assert max(misses[300:]) <= 4  # quarters of a step, of values up to 175 steps


def test_a_sample_of_no_trust_changes_little() -> None:
    shape = Shape(2)
    steady = [0, 0], [1 << 20, 1 << 20]
    moved = {}
    for trust in (TRUST, TRUST >> 8):
        explained = Explained(shape, *steady)
        explained.add((1000,))
        explained.add((5000,))
        moved[trust] = shape.unpacked(explained.moved(trust)[0])[1][0]
    assert 0 < moved[TRUST >> 8] < moved[TRUST] // 50


def test_weights_that_spill_are_noticed() -> None:
    shape = Shape(2)
    explained = Explained(shape, shape.packed([[], [1 << 45]]), [256, 256])
    assert explained.add((1 << 30,)) == 0
    assert explained.is_broken


def test_a_quantity_that_stood_still_does_not_throw_its_weights_about() -> None:
    shape, weights, energies = Shape(2), [0, 0], [256, 256]
    for n in range(2000):
        explained = Explained(shape, weights, energies)
        explained.add((0 if n < 1990 else 1, n % 7))
        weights, energies = explained.moved(TRUST)
    assert all(abs(each) < 1 << 24 for each in shape.unpacked(weights)[1])


def test_what_is_smaller_than_usual_moves_the_energy_and_no_weights() -> None:
    shape, weights, energies = Shape(2), [0, 0], [128 * 400, 256]
    for quantity, moves in ((19, False), (-19, False), (21, True)):
        explained = Explained(shape, weights, energies)
        explained.add((quantity, 1000))
        moved, more = explained.moved(TRUST)
        assert (moved != weights) == moves
        assert more[0] == energies[0] - energies[0] // 128 + quantity**2
