import math

import pytest

from zacoustic.channel.formulae.acoustics import (
    ainslie_mccolm_absorption_db_km,
    combined_snr_db,
    doppler_factor,
    eb_n0_db,
    francois_garrison_absorption_db_km,
    propagation_delay_s,
    received_level_db,
    snr_db,
    source_level_of_power_db,
    sum_of_levels_db,
    thorp_absorption_db_km,
    transmission_loss_db,
)
from zacoustic.channel.formulae.noise import flat_noise_level_db

# kHz; Thorp, Ainslie-McColm at 100 m, Francois-Garrison at 100 m, the same two at the surface.
ABSORPTION = (
    (1, 0.069004, 0.061181, 0.059944, 0.061323, 0.060126),
    (5, 0.382311, 0.331254, 0.321740, 0.334790, 0.324945),
    (10, 1.187030, 0.972608, 0.950339, 0.986572, 0.962637),
    (11.52, 1.528228, 1.245846, 1.218280, 1.264276, 1.234471),
    (25, 6.104805, 5.027164, 4.928066, 5.107323, 4.998070),
    (50, 17.467123, 15.461051, 15.175009, 15.709684, 15.391909),
    (100, 34.068663, 33.811500, 33.169939, 34.341022, 33.630316),
)
DISTANCES_M = (100, 500, 1000, 2000, 3000, 5000)
# kHz, spreading factor; loss at each distance.
LOSSES = (
    (10, 1, 20.1187, 27.5832, 31.1870, 35.3844, 38.3323, 42.9248),
    (10, 1.5, 30.1187, 41.0781, 46.1870, 51.8895, 55.7179, 61.4197),
    (10, 1.75, 35.1187, 47.8255, 53.6870, 60.1421, 64.4107, 70.6671),
    (10, 2, 40.1187, 54.5729, 61.1870, 68.3947, 73.1035, 79.9145),
    (25, 1, 20.6105, 30.0421, 36.1048, 45.2199, 53.0856, 67.5137),
    (25, 1.5, 30.6105, 43.5370, 51.1048, 61.7251, 70.4712, 86.0086),
    (25, 1.75, 35.6105, 50.2844, 58.6048, 69.9776, 79.1640, 95.2560),
    (25, 2, 40.6105, 57.0318, 66.1048, 78.2302, 87.8568, 104.5034),
    (50, 1, 21.7467, 35.7233, 47.4671, 67.9445, 87.1726, 124.3253),
    (50, 1.5, 31.7467, 49.2181, 62.4671, 84.4497, 104.5582, 142.8202),
    (50, 1.75, 36.7467, 55.9655, 69.9671, 92.7023, 113.2510, 152.0676),
    (50, 2, 41.7467, 62.7130, 77.4671, 100.9548, 121.9438, 161.3150),
)


@pytest.mark.parametrize("row", ABSORPTION)
def test_absorption_agrees_with_the_reference_table(
    row: tuple[float, float, float, float, float, float],
) -> None:
    khz, thorp, ainslie, francois, ainslie_surface, francois_surface = row
    hz = khz * 1000.0
    assert thorp_absorption_db_km(hz) == pytest.approx(thorp, abs=6e-7)
    assert ainslie_mccolm_absorption_db_km(hz, depth_m=100.0) == pytest.approx(ainslie, abs=6e-7)
    assert francois_garrison_absorption_db_km(hz, depth_m=100.0) == pytest.approx(
        francois, abs=6e-7
    )
    assert ainslie_mccolm_absorption_db_km(hz) == pytest.approx(ainslie_surface, abs=6e-7)
    assert francois_garrison_absorption_db_km(hz) == pytest.approx(francois_surface, abs=6e-7)


def test_thorp_has_a_branch_of_its_own_below_400_hz() -> None:
    f = 0.1
    expected = 0.002 + 0.11 * f**2 / (1 + f**2) + 0.011 * f**2
    assert thorp_absorption_db_km(100.0) == pytest.approx(expected, rel=1e-12)
    assert thorp_absorption_db_km(399.0) < thorp_absorption_db_km(400.0)


def test_absorption_of_warm_water_uses_the_other_polynomial_of_pure_water() -> None:
    # The two polynomials meet at 20 °C within a few thousandths.
    cold = francois_garrison_absorption_db_km(50_000.0, temperature_c=20.0)
    warm = francois_garrison_absorption_db_km(50_000.0, temperature_c=20.001)
    assert warm == pytest.approx(cold, rel=5e-3)
    assert warm != cold


@pytest.mark.parametrize("frequency_hz", [0.0, -1.0, math.nan])
def test_absorption_refuses_a_frequency_that_is_not_positive(frequency_hz: float) -> None:
    with pytest.raises(ValueError, match="allowed: above 0"):
        thorp_absorption_db_km(frequency_hz)
    with pytest.raises(ValueError, match="allowed: above 0"):
        ainslie_mccolm_absorption_db_km(frequency_hz)
    with pytest.raises(ValueError, match="allowed: above 0"):
        francois_garrison_absorption_db_km(frequency_hz)


@pytest.mark.parametrize("row", LOSSES)
def test_transmission_loss_agrees_with_the_reference_table(row: tuple[float, ...]) -> None:
    khz, spreading, *losses = row
    absorption = thorp_absorption_db_km(khz * 1000.0)
    for distance, expected in zip(DISTANCES_M, losses, strict=True):
        loss = transmission_loss_db(distance, absorption, spreading=spreading)
        assert loss == pytest.approx(expected, abs=6e-5)


def test_transmission_loss_agrees_with_the_reference_for_other_absorptions() -> None:
    francois = francois_garrison_absorption_db_km(25_000.0, depth_m=100.0)
    ainslie = ainslie_mccolm_absorption_db_km(25_000.0, depth_m=100.0)
    assert transmission_loss_db(1000, francois, spreading=2) == pytest.approx(64.9281, abs=6e-5)
    assert transmission_loss_db(1000, ainslie, spreading=2) == pytest.approx(65.0272, abs=6e-5)


@pytest.mark.parametrize("distance_m", [0.0, 0.5, 1.0])
def test_there_is_no_loss_within_a_metre(distance_m: float) -> None:
    assert transmission_loss_db(distance_m, 10.0) == 0.0


@pytest.mark.parametrize(
    ("distance_m", "expected_db"),
    [
        (500, (72.4832, 58.9884, 45.4935)),
        (1000, (66.4205, 51.4205, 36.4205)),
        (2000, (57.3054, 40.8003, 24.2951)),
        (3000, (49.4397, 32.0541, 14.6685)),
        (5000, (35.0116, 16.5168, -1.9781)),
    ],
)
def test_sonar_equation_agrees_with_the_worked_example(
    distance_m: float, expected_db: tuple[float, float, float]
) -> None:
    noise = flat_noise_level_db(25_000.0, 5_000.0, wind_m_s=10.0, shipping=0.0)
    absorption = thorp_absorption_db_km(25_000.0)
    for spreading, expected in zip((1.0, 1.5, 2.0), expected_db, strict=True):
        level = received_level_db(
            185.0, transmission_loss_db(distance_m, absorption, spreading=spreading)
        )
        assert snr_db(level, noise) == pytest.approx(expected, abs=6e-5)


def test_energy_per_bit_counts_bandwidth_rate_and_implementation_loss() -> None:
    per_bit = eb_n0_db(3.0, bandwidth_hz=5000.0, bit_rate_bps=500.0, implementation_loss_db=2.0)
    assert per_bit == pytest.approx(11.0)
    assert snr_db(100.0, 90.0, directivity_db=3.0) == 13.0


def test_source_level_of_a_watt_is_170_8_db() -> None:
    assert source_level_of_power_db(1.0) == 170.8
    assert source_level_of_power_db(100.0, directivity_db=3.0) == pytest.approx(193.8)


def test_equal_levels_add_three_decibels_and_silence_adds_nothing() -> None:
    assert sum_of_levels_db(80.0, 80.0) == pytest.approx(83.0103, abs=1e-4)
    assert sum_of_levels_db(80.0, float("-inf")) == 80.0
    assert sum_of_levels_db(float("-inf")) == float("-inf")
    assert combined_snr_db(10.0, 10.0) == pytest.approx(6.9897, abs=1e-4)
    assert combined_snr_db(10.0, -5000.0) == -5000.0


def test_delay_is_distance_over_speed() -> None:
    assert propagation_delay_s(1500.0) == 1.0
    assert propagation_delay_s(1530.0, sound_speed_m_s=1530.0) == 1.0


@pytest.mark.parametrize(
    ("speed_m_s", "factor", "shift_hz"),
    [(1.0, 6.667e-4, 16.667), (2.0, 1.333e-3, 33.333), (5.0, 3.333e-3, 83.333)],
)
def test_doppler_shift_agrees_with_the_reference(
    speed_m_s: float, factor: float, shift_hz: float
) -> None:
    assert doppler_factor(speed_m_s) == pytest.approx(factor, abs=5e-7)
    assert 25_000.0 * doppler_factor(speed_m_s) == pytest.approx(shift_hz, abs=5e-4)
