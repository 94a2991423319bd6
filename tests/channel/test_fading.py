import random
import statistics

import pytest

from zacoustic.channel.formulae.modulation import ratio
from zacoustic.channel.propagation.fading import Fading, FadingProcess, fade_quantiles_db
from zacoustic.channel.propagation.randomness import direction_random, gaussian_pair

SECOND = 1_000_000_000


def _gains_db(fading: Fading, step_ns: int, count: int, seed: int = 1) -> list[float]:
    process = FadingProcess(fading, random.Random(seed))
    return [process.next_gain_db(index * step_ns) for index in range(count)]


def test_shadowing_has_its_deviation_and_its_memory() -> None:
    # A steady path of a million to one leaves the shadowing alone.
    fading = Fading(k_factor=1e6, shadowing_db=3.0, shadowing_time_s=30.0)
    gains = _gains_db(fading, 10 * SECOND, 40_000)
    assert statistics.fmean(gains) == pytest.approx(0.0, abs=0.1)
    assert statistics.pstdev(gains) == pytest.approx(3.0, abs=0.1)
    assert statistics.correlation(gains[:-1], gains[1:]) == pytest.approx(0.7165, abs=0.02)
    assert statistics.correlation(gains[:-3], gains[3:]) == pytest.approx(0.3679, abs=0.03)


def test_frames_at_one_instant_meet_the_same_shadow() -> None:
    fading = Fading(k_factor=1e9, shadowing_db=3.0, shadowing_time_s=30.0)
    gains = _gains_db(fading, 0, 5)
    assert max(gains) - min(gains) < 0.01


@pytest.mark.parametrize("k_factor", [0.0, 3.0, 10.0])
def test_fast_fade_keeps_the_mean_power_and_has_no_memory(k_factor: float) -> None:
    fading = Fading(k_factor=k_factor, shadowing_db=0.0, shadowing_time_s=30.0)
    powers = [ratio(gain) for gain in _gains_db(fading, SECOND, 20_000)]
    assert statistics.fmean(powers) == pytest.approx(1.0, abs=0.02)
    variance = (2.0 * k_factor + 1.0) / (k_factor + 1.0) ** 2
    assert statistics.pvariance(powers) == pytest.approx(variance, rel=0.06)
    assert statistics.correlation(powers[:-1], powers[1:]) == pytest.approx(0.0, abs=0.03)


def test_quantiles_describe_what_is_drawn() -> None:
    fading = Fading(k_factor=3.0, shadowing_db=3.0, shadowing_time_s=0.001)
    drawn = sorted(_gains_db(fading, SECOND, 20_000))
    quantiles = fade_quantiles_db(fading)
    assert len(quantiles) == 128
    assert list(quantiles) == sorted(quantiles)
    for share in (0.05, 0.1, 0.25, 0.5, 0.75, 0.9):
        expected = drawn[int(share * len(drawn))]
        assert quantiles[int(share * 128)] == pytest.approx(expected, abs=0.3)


def test_gaussian_pairs_are_standard_normal_and_independent() -> None:
    rng = random.Random(1)
    pairs = [gaussian_pair(rng) for _ in range(20_000)]
    for axis in (0, 1):
        assert statistics.fmean(pair[axis] for pair in pairs) == pytest.approx(0.0, abs=0.02)
        assert statistics.pstdev(pair[axis] for pair in pairs) == pytest.approx(1.0, abs=0.02)
    first, second = zip(*pairs, strict=True)
    assert statistics.correlation(first, second) == pytest.approx(0.0, abs=0.02)


def test_directions_and_purposes_have_generators_of_their_own() -> None:
    draws = {
        direction_random(seed, source, node, purpose).random()
        for seed in (1, 2)
        for source in (1, 2)
        for node in (3, 4)
        for purpose in ("water", "loss")
    }
    assert len(draws) == 16


def test_generators_are_the_same_in_every_process_and_version() -> None:
    # Guards the promise that a seed means the same sea everywhere and for ever.
    rng = direction_random(7, 1, 2, "water")
    assert [rng.random(), rng.random()] == [0.8957709399969435, 0.9276199350475667]
