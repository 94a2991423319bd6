"""The curve: all shares together are the whole, what is written is read, what is far is dear."""

import math

from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.values.dense.coder.curve import (
    CURVES,
    LARGEST_SIZE,
    LISTED,
    MOST_HOLD,
    SCALES,
    WHOLE,
    Curve,
    log_scale,
    logarithm,
    span,
)
from zacoustic.core.values.dense.coder.reader import Reader
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.payload import PayloadError


@st.composite
def curves(draw: st.DrawFn) -> tuple[Curve, int]:
    """A curve and one of its values."""
    size = draw(st.one_of(st.integers(2, 400), st.integers(2, LARGEST_SIZE)))
    center = draw(st.integers(-(1 << 28), 1 << 28) | st.integers(0, 16 * size))
    scale = draw(st.integers(1, 1 << 40) | st.integers(1, 1 << 14))
    held = draw(st.integers(-3, size + 3))
    curve = Curve(size, center, scale, held, draw(st.sampled_from((0, 200, 1000, MOST_HOLD))))
    near = min(max((center >> 4) + draw(st.integers(-5, 5)), 0), size - 1)
    value = draw(st.integers(0, size - 1) | st.sampled_from((near, 0, size - 1)))
    if 0 <= held < size and draw(st.booleans()):
        value = held
    return curve, value


def bits(curve: Curve, value: int) -> float:
    """What a value costs."""
    writer = Writer()
    for _ in range(16):
        writer.number(curve, value)
    return writer.bits / 16


@given(curves())
def test_a_value_is_read_as_it_was_written(case: tuple[Curve, int]) -> None:
    curve, value = case
    writer = Writer()
    assert writer.number(curve, value) == value
    writer.uniform(1000, 777)
    reader = Reader(writer.finish(4, 3))
    assert reader.number(curve) == value
    assert reader.uniform(1000) == 777
    reader.check(4, 3)


@given(curves(), st.binary(min_size=1, max_size=12))
def test_whatever_is_read_is_a_value_or_an_error(case: tuple[Curve, int], block: bytes) -> None:
    curve, _ = case
    reader = Reader(block)
    try:
        while reader.bits_left > 0:
            assert 0 <= reader.number(curve) < curve.size
            reader.flag(1 << 15)  # that alone is no end, where a value costs nothing
    except PayloadError:
        pass


def test_the_shares_lie_one_behind_the_other_and_are_the_whole() -> None:
    for grade in range(0, LISTED, 5):
        reach, last, places = CURVES[grade]
        for place in (0, 7, 15):
            sums = places[place]
            assert len(sums) == last + 2 == 2 * reach + 2
            for first, size, held in ((-reach, 2, 1), (5, last + 50, 0), (-3, last, 4)):
                odds = WHOLE // 3
                end = span(sums, first, size, held, odds, first - 1)[1] if first > 0 else 0
                for value in range(max(first, 0), min(first + last + 1, size)):
                    start, after = span(sums, first, size, held, odds, value)
                    assert start == end < after
                    end = after
                if first + last + 1 < size:
                    start, end = span(sums, first, size, held, odds, first + last + 1)
                assert end == WHOLE + odds


def test_what_is_expected_is_cheap_and_what_is_not_is_not_impossible() -> None:
    for scale in (1 << 12, 1 << 14, 1 << 17, 1 << 20):
        curve = Curve(1 << 20, 1 << 23, scale)
        here, near, far = (
            bits(curve, (1 << 19) + way) for way in (0, 4 * scale >> 12, 400 * scale >> 12)
        )
        assert here < max(math.log2(scale / 4096) + 1.6, 0.5)
        assert here < near < far < 42
    assert bits(Curve(1000, 100, 4096, 6, MOST_HOLD), 6) < 0.07


def test_scales_are_logarithms() -> None:
    for number in (1, 3, 1 << 12, 12345, (1 << 31) - 1):
        assert 0 <= 1024 * math.log2(number / 4096) - logarithm(number, 12) < 1.001
    assert log_scale(1) == 0
    for scale in (300, 4096, 1 << 20):
        assert abs(math.log2(SCALES[Curve(2, 0, scale).grade] / scale)) < 1 / 16
