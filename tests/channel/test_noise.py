import pytest

from zacoustic.channel.formulae.noise import (
    ambient_noise_db,
    band_noise_level_db,
    flat_noise_level_db,
    shipping_noise_db,
    thermal_noise_db,
    turbulence_noise_db,
    wind_noise_db,
)

# kHz, wind, shipping; total, turbulence, ships, wind, thermal.
POINTS = (
    (10, 0, 0.5, 29.354704, -13.0000, 5.9219, 29.3187, 5.0000),
    (10, 10, 0, 53.035827, -13.0000, -4.0781, 53.0357, 5.0000),
    (11.52, 5, 0.5, 44.949434, -14.8436, 3.8428, 44.9485, 6.2290),
    (25, 0, 0.5, 22.307034, -24.9382, -7.5612, 21.7655, 12.9588),
    (25, 10, 0, 45.484965, -24.9382, -17.5612, 45.4825, 12.9588),
    (25, 10, 1, 45.485178, -24.9382, 2.4388, 45.4825, 12.9588),
    (50, 0, 0.5, 20.712161, -33.9691, -17.7806, 15.8822, 18.9794),
    (50, 10, 0, 39.636753, -33.9691, -27.7806, 39.5993, 18.9794),
)


@pytest.mark.parametrize("point", POINTS)
def test_ambient_noise_agrees_with_the_reference_table(
    point: tuple[float, float, float, float, float, float, float, float],
) -> None:
    khz, wind, shipping, total, turbulence, ships, waves, thermal = point
    hz = khz * 1000.0
    assert ambient_noise_db(hz, wind_m_s=wind, shipping=shipping) == pytest.approx(total, abs=6e-7)
    assert turbulence_noise_db(hz) == pytest.approx(turbulence, abs=6e-5)
    assert shipping_noise_db(hz, shipping) == pytest.approx(ships, abs=6e-5)
    assert wind_noise_db(hz, wind) == pytest.approx(waves, abs=6e-5)
    assert thermal_noise_db(hz) == pytest.approx(thermal, abs=6e-5)


@pytest.mark.parametrize(
    ("low_khz", "high_khz", "flat_db", "integrated_db"),
    [(22.5, 27.5, 82.4747, 82.5156), (18.0, 34.0, 87.1964, 87.6011)],
)
def test_band_level_is_higher_than_the_flat_rule_says(
    low_khz: float, high_khz: float, flat_db: float, integrated_db: float
) -> None:
    centre_hz = (low_khz + high_khz) * 500.0
    width_hz = (high_khz - low_khz) * 1000.0
    flat = flat_noise_level_db(centre_hz, width_hz, wind_m_s=10.0, shipping=0.0)
    integrated = band_noise_level_db(centre_hz, width_hz, wind_m_s=10.0, shipping=0.0)
    assert flat == pytest.approx(flat_db, abs=6e-5)
    assert integrated == pytest.approx(integrated_db, abs=6e-5)


def test_a_band_that_reaches_zero_is_refused() -> None:
    with pytest.raises(ValueError, match=r"the band starts at 0\.0 Hz; allowed: above 0"):
        band_noise_level_db(1000.0, 2000.0)
