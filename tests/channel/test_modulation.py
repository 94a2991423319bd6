import math

import pytest

from zacoustic.channel.formulae.modulation import (
    Modulation,
    bit_error_rate,
    block_rayleigh_packet_error_rate,
    mfsk_bit_error_rate,
    mfsk_symbol_error_rate,
    packet_error_rate,
    ratio,
    rayleigh_bit_error_rate,
    rician_bpsk_bit_error_rate,
    rician_ncfsk_bit_error_rate,
)

# dB; BPSK, coherent FSK, non-coherent FSK, DPSK. None: the reference only says about zero.
STILL: tuple[tuple[float | None, ...], ...] = (
    (0, 7.864960e-2, 1.586553e-1, 3.032653e-1, 1.839397e-1),
    (5, 5.953867e-3, 3.767899e-2, 1.028703e-1, 2.116461e-2),
    (8, 1.909078e-4, 6.004386e-3, 2.132375e-2, 9.094044e-4),
    (10, 3.872108e-6, 7.827011e-4, 3.368973e-3, 2.269996e-5),
    (12, 9.006010e-9, 3.430262e-5, 1.808915e-4, 6.544347e-8),
    (15, None, 9.361040e-9, 6.794716e-8, None),
    (20, None, None, None, None),
)  # fmt: skip
# The same four under Rayleigh fading, in the same order of levels.
RAYLEIGH = (
    (1.464466e-1, 2.113249e-1, 3.333333e-1, 2.5e-1),
    (6.418269e-2, 1.086644e-1, 1.937129e-1, 1.201265e-1),
    (3.545907e-2, 6.430694e-2, 1.203431e-1, 6.840344e-2),
    (2.326871e-2, 4.356454e-2, 8.333333e-2, 4.545455e-2),
    (1.506468e-2, 2.884491e-2, 5.602576e-2, 2.967547e-2),
    (7.723002e-3, 1.509885e-2, 2.974174e-2, 1.532672e-2),
    (2.481405e-3, 4.926229e-3, 9.803922e-3, 4.950495e-3),
)  # fmt: skip
COLUMNS = (Modulation.BPSK, Modulation.BFSK, Modulation.NCFSK, Modulation.DBPSK)


@pytest.mark.parametrize(("row", "rayleigh_row"), tuple(zip(STILL, RAYLEIGH, strict=True)))
def test_bit_error_rates_agree_with_the_reference_table(
    row: tuple[float | None, ...], rayleigh_row: tuple[float, ...]
) -> None:
    level_db = row[0]
    assert level_db is not None
    gamma = ratio(level_db)
    for modulation, still, rayleigh in zip(COLUMNS, row[1:], rayleigh_row, strict=True):
        if still is not None:
            assert bit_error_rate(modulation, gamma) == pytest.approx(still, rel=6e-7)
        assert rayleigh_bit_error_rate(modulation, gamma) == pytest.approx(rayleigh, rel=6e-7)


@pytest.mark.parametrize(
    ("modulation", "level_db", "expected", "digits"),
    [
        (Modulation.BPSK, 15.0, 9.12e-16, 1e-2),
        (Modulation.DBPSK, 15.0, 9.2e-15, 1e-2),
        (Modulation.BFSK, 20.0, 7.6e-24, 1e-2),
        (Modulation.NCFSK, 20.0, 9.6e-23, 1e-2),
    ],
)
def test_tiny_bit_error_rates_keep_their_digits(
    modulation: Modulation, level_db: float, expected: float, digits: float
) -> None:
    assert bit_error_rate(modulation, ratio(level_db)) == pytest.approx(expected, rel=digits)


def test_rician_bit_error_rates_agree_with_the_reference() -> None:
    gamma = 10.0
    assert rician_ncfsk_bit_error_rate(gamma, 10.0) == pytest.approx(0.01510332, abs=6e-9)
    assert rician_ncfsk_bit_error_rate(gamma, 3.0) == pytest.approx(0.04197236, abs=6e-9)
    assert rician_bpsk_bit_error_rate(gamma, 10.0) == pytest.approx(7.014439e-4, rel=6e-7)


@pytest.mark.parametrize("level_db", [0.0, 5.0, 10.0, 20.0])
def test_rician_without_a_steady_path_is_rayleigh(level_db: float) -> None:
    gamma = ratio(level_db)
    assert rician_ncfsk_bit_error_rate(gamma, 0.0) == pytest.approx(
        rayleigh_bit_error_rate(Modulation.NCFSK, gamma), rel=1e-12
    )
    assert rician_bpsk_bit_error_rate(gamma, 0.0) == pytest.approx(
        rayleigh_bit_error_rate(Modulation.BPSK, gamma), rel=1e-10
    )


def test_mfsk_agrees_with_the_reference_and_with_two_tones() -> None:
    assert mfsk_symbol_error_rate(4, 10.0) == pytest.approx(8.97256e-3, rel=6e-6)
    assert mfsk_bit_error_rate(4, 10.0) == pytest.approx(5.98170e-3, rel=6e-6)
    assert mfsk_bit_error_rate(2, 10.0) == pytest.approx(bit_error_rate(Modulation.NCFSK, 10.0))


@pytest.mark.parametrize(
    ("bits", "bpsk_db", "ncfsk_db"),
    [
        (64, (8.1240, 6.3545, 4.2179, 2.1315), (12.0769, 10.5819, 8.8510, 7.2422)),
        (256, (8.9192, 7.4775, 5.8758, 4.4755), (12.7656, 11.5245, 10.1869, 9.0553)),
        (1000, (9.5856, 8.3674, 7.0862, 6.0371), (13.3505, 12.2866, 11.1935, 10.3195)),
        (8000, (10.4448, 9.4609, 8.4821, 7.7281), (14.1142, 13.2405, 12.3858, 11.7378)),
    ],
)
def test_packet_error_rates_are_reached_at_the_reference_levels(
    bits: int, bpsk_db: tuple[float, ...], ncfsk_db: tuple[float, ...]
) -> None:
    def per(modulation: Modulation, level_db: float) -> float:
        return packet_error_rate(bit_error_rate(modulation, ratio(level_db)), bits)

    for modulation, levels in ((Modulation.BPSK, bpsk_db), (Modulation.NCFSK, ncfsk_db)):
        for target, level in zip((0.01, 0.1, 0.5, 0.9), levels, strict=True):
            # The level that gives exactly this rate rounds to the four digits of the table.
            assert per(modulation, level - 6e-5) > target > per(modulation, level + 6e-5)


@pytest.mark.parametrize(
    ("level_db", "bpsk", "ncfsk", "per_bit"),
    [
        (5, 0.80184, 0.98239, 1.0),
        (10, 0.40829, 0.73510, 1.0),
        (15, 0.15412, 0.34714, 0.99957),
        (20, 0.05170, 0.12674, 0.91663),
        (25, 0.01666, 0.04202, 0.54571),
        (30, 0.00530, 0.01349, 0.22108),
    ],
)
def test_block_and_bit_fading_give_the_two_reference_columns(
    level_db: float, bpsk: float, ncfsk: float, per_bit: float
) -> None:
    gamma = ratio(level_db)
    for modulation, expected in ((Modulation.BPSK, bpsk), (Modulation.NCFSK, ncfsk)):
        rate = block_rayleigh_packet_error_rate(modulation, gamma, 1000)
        assert rate == pytest.approx(expected, abs=6e-6)
    independent = packet_error_rate(rayleigh_bit_error_rate(Modulation.BPSK, gamma), 1000)
    assert independent == pytest.approx(per_bit, abs=6e-6)


def test_packet_error_rate_keeps_its_digits_at_both_ends() -> None:
    assert packet_error_rate(1e-20, 1000) == pytest.approx(1e-17)
    assert packet_error_rate(0.25, 1) == pytest.approx(0.25)
    assert packet_error_rate(1.0, 8) == 1.0
    assert packet_error_rate(1.0, 0) == 0.0
    assert packet_error_rate(0.0, 8) == 0.0


def test_the_perfect_modulation_never_errs() -> None:
    assert bit_error_rate(Modulation.PERFECT, 0.0) == 0.0
    assert rayleigh_bit_error_rate(Modulation.PERFECT, 0.0) == 0.0


def test_bit_error_rates_fall_with_the_level() -> None:
    for modulation in COLUMNS:
        rates = [bit_error_rate(modulation, ratio(level)) for level in range(-10, 15)]
        assert rates == sorted(rates, reverse=True)
        assert all(0.0 <= rate <= 0.5 and math.isfinite(rate) for rate in rates)
