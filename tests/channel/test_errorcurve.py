import pytest

from zacoustic.channel.formulae.errorcurve import (
    JANUS_BASELINE,
    MICROMODEM_RATE_1,
    MICROMODEM_RATE_3,
    MICROMODEM_RATE_5,
    FrameErrorCurve,
)

CURVES = (MICROMODEM_RATE_1, MICROMODEM_RATE_3, MICROMODEM_RATE_5, JANUS_BASELINE)


@pytest.mark.parametrize("curve", CURVES)
def test_curves_pass_through_their_points(curve: FrameErrorCurve) -> None:
    for snr_db, rate in curve.points:
        assert curve.frame_error_rate(snr_db, curve.reference_bytes) == pytest.approx(rate)


@pytest.mark.parametrize("curve", CURVES)
def test_curves_fall_with_the_level_and_stay_constant_beyond_their_ends(
    curve: FrameErrorCurve,
) -> None:
    rates = [
        curve.frame_error_rate(level / 10.0, curve.reference_bytes) for level in range(-300, 300)
    ]
    assert rates == sorted(rates, reverse=True)
    assert (rates[0], rates[-1]) == (curve.points[0][1], curve.points[-1][1])


def test_a_curve_is_straight_between_two_points() -> None:
    middle_db = (3.097 + 4.443) / 2.0
    assert MICROMODEM_RATE_5.frame_error_rate(middle_db, 256) == pytest.approx((1 + 0.135) / 2)


def test_longer_frames_err_like_several_of_the_reference_length() -> None:
    rate = MICROMODEM_RATE_1.frame_error_rate(-6.845, 64)
    assert MICROMODEM_RATE_1.frame_error_rate(-6.845, 128) == pytest.approx(1 - (1 - rate) ** 2)
    assert MICROMODEM_RATE_1.frame_error_rate(-20.0, 8) == 1.0
    assert MICROMODEM_RATE_1.frame_error_rate(0.0, 192) == 0.0


@pytest.mark.parametrize(("ec_n0_db", "rate"), [(3.0, 0.8075), (4.0, 0.3070), (5.0, 0.0307)])
def test_janus_meets_its_simulated_rates(ec_n0_db: float, rate: float) -> None:
    assert JANUS_BASELINE.frame_error_rate(ec_n0_db - 14.15, 8) == pytest.approx(rate)
