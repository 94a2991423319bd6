import pytest

from zacoustic.channel.formulae.desert import (
    DesertModulation,
    desert_bit_error_rate,
    desert_depth_sound_speed_m_s,
    desert_packet_error_rate,
    desert_snr_db,
)


def _snr_db(distance_m: float) -> float:
    return desert_snr_db(
        distance_m, source_level_db=180.0, frequency_hz=25_000.0, bandwidth_hz=5_000.0
    )


# m; SNR; PER of 1000 bits: BPSK, BFSK, and both with the penalty of -10 dB.
TABLE = (
    (1000, 62.098461, 0.0, 0.0, 0.0, 0.0),
    (3000, 41.539229, 0.0, 0.0, 0.0, 0.0),
    (5000, 25.447266, 0.0, 0.0, 0.0, 1.2226e-5),
    (6000, 17.956789, 0.0, 1.37e-11, 0.184642, 1.0),
    (6500, 14.296049, 1.12e-10, 7.236586e-4, 0.999965, 1.0),
    (7000, 10.680415, 6.603403e-4, 0.763970, 1.0, 1.0),
    (7200, 9.245351, 2.044690e-2, 0.999451, 1.0, 1.0),
    (7400, 7.816153, 0.223275, 1.0, 1.0, 1.0),
    (7600, 6.392510, 0.793824, 1.0, 1.0, 1.0),
    (8000, 3.560751, 1.000000, 1.0, 1.0, 1.0),
)


@pytest.mark.parametrize("row", TABLE)
def test_desert_table_is_reproduced(
    row: tuple[float, float, float, float, float, float],
) -> None:
    distance, snr, bpsk, bfsk, bpsk_penalty, bfsk_penalty = row
    computed = _snr_db(distance)
    assert computed == pytest.approx(snr, abs=6e-7)
    for modulation, penalty_db, expected in (
        (DesertModulation.BPSK, 0.0, bpsk),
        (DesertModulation.BFSK, 0.0, bfsk),
        (DesertModulation.BPSK, -10.0, bpsk_penalty),
        (DesertModulation.BFSK, -10.0, bfsk_penalty),
    ):
        rate = desert_packet_error_rate(modulation, computed, 1000, penalty_db=penalty_db)
        # Below 1e-8 the table itself lost digits: it subtracts from one, we do not.
        digits = 1e-2 if 0.0 < expected < 1e-8 else 5e-5 if 0.0 < expected < 1e-4 else 0.0
        assert rate == pytest.approx(expected, rel=digits, abs=0.0 if digits else 6e-7)


def test_desert_ranges_of_ten_and_fifty_percent_are_reproduced() -> None:
    for distance, target in ((7322.768, 0.1), (7502.459, 0.5)):
        near = desert_packet_error_rate(DesertModulation.BPSK, _snr_db(distance - 1e-3), 1000)
        far = desert_packet_error_rate(DesertModulation.BPSK, _snr_db(distance + 1e-3), 1000)
        assert near < target < far


@pytest.mark.parametrize(
    ("modulation", "rates"),
    [
        (DesertModulation.PSK8, (0.116188, 0.0318433, 1.01140e-3, 4.516e-8)),
        (DesertModulation.PSK16, (0.145272, 0.0816171, 0.0202488, 4.78936e-4, 8.57e-9)),
        (DesertModulation.PSK32, (0.151319, 0.116301, 0.0654003, 0.0162661, 3.87598e-4)),
    ],
)
def test_desert_phase_modulations_agree_with_the_reference(
    modulation: DesertModulation, rates: tuple[float, ...]
) -> None:
    for level_db, expected in zip((0.0, 5.0, 10.0, 15.0, 20.0), rates, strict=False):
        digits = 1e-3 if expected < 1e-6 else 6e-6
        assert desert_bit_error_rate(modulation, level_db) == pytest.approx(expected, rel=digits)


def test_one_bit_has_the_bit_error_rate() -> None:
    assert desert_packet_error_rate(DesertModulation.BPSK, 3.0, 1) == pytest.approx(
        desert_bit_error_rate(DesertModulation.BPSK, 3.0)
    )


@pytest.mark.parametrize(
    ("temperature_c", "depth_m", "expected"),
    [
        (10.0, 100.0, 1491.4018),
        (0.0, 0.0, 1449.0500),
        (4.0, 1000.0, 1482.9911),
        (20.0, 10.0, 1521.6130),
        (27.0, 10.0, 1539.1492),
    ],
)
def test_desert_sound_speed_agrees_with_the_reference(
    temperature_c: float, depth_m: float, expected: float
) -> None:
    assert desert_depth_sound_speed_m_s(temperature_c, depth_m) == pytest.approx(expected, abs=6e-5)


def test_desert_sound_speed_of_salty_water_agrees_with_the_reference() -> None:
    speed = desert_depth_sound_speed_m_s(15.0, 50.0, salinity_psu=38.0)
    assert speed == pytest.approx(1510.9619, abs=6e-5)
