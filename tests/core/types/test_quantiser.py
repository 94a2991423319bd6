"""Steps: a value is the nearest count of them, and comes back as a clean decimal."""

import pytest

from zacoustic.core.values.types import Quantiser


@pytest.mark.parametrize(
    ("step", "value", "text"),
    [(0.1, 45.4, "45.4"), (1e-6, 45.4, "45.4"), (0.3, 0.9, "0.9"), (0.05, 1.15, "1.15")],
)
def test_decimal_steps_come_back_as_clean_decimals(step: float, value: float, text: str) -> None:
    quantiser = Quantiser(step, (-90.0, 90.0))
    assert repr(quantiser.value(quantiser.count(value))) == text


def test_count_is_the_nearest_not_the_floor() -> None:
    quantiser = Quantiser(0.1, (-10.0, 10.0))
    assert [quantiser.count(v) for v in (0.16, 0.14, -0.16, -0.14)] == [2, 1, -2, -1]
    whole = Quantiser(10, (-100, 100))
    assert [whole.count(v) for v in (16, 14, -16, -14)] == [2, 1, -2, -1]


def test_ends_of_a_range_that_is_no_whole_number_of_steps_come_back_as_themselves() -> None:
    quantiser = Quantiser(0.1, (0.0, 0.26))
    assert quantiser.value(quantiser.count(0.26)) == 0.26
    assert quantiser.high_count == 3


def test_top_of_a_wrapping_range_is_its_bottom() -> None:
    quantiser = Quantiser(0.1, (0.0, 360.0), wraps=True)
    assert quantiser.count(359.96) == 0
    assert quantiser.high_count == 3599


def test_a_step_that_is_no_short_decimal_still_round_trips() -> None:
    quantiser = Quantiser(2.0**-60 / 3, (0.0, 1e-15))
    assert quantiser.value(quantiser.count(5e-16)) == pytest.approx(5e-16, abs=2.0**-60)
