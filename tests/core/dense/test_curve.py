"""The curve: every value has a share, all shares together are the whole, and the inverse is one."""

from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.dense.curve import LARGEST_SIZE, MOST_HOLD, SHARE_BITS, Curve


@st.composite
def curves(draw: st.DrawFn) -> tuple[Curve, int]:
    """A curve and one of its values."""
    size = draw(st.one_of(st.integers(2, 400), st.integers(2, LARGEST_SIZE)))
    center = draw(st.integers(-(1 << 28), 1 << 28) | st.integers(0, 16 * size))
    scale = draw(st.integers(1, 1 << 40) | st.integers(1, 1 << 14))
    held = draw(st.integers(-3, size + 3))
    curve = Curve(size, center, scale, held, draw(st.sampled_from((0, 1000, MOST_HOLD))))
    return curve, draw(st.integers(0, size - 1))


@given(curves())
def test_every_value_has_a_share_and_is_found_by_all_of_it(case: tuple[Curve, int]) -> None:
    curve, value = case
    start, end = curve.below(value), curve.below(value + 1)
    assert 0 <= start < end <= 1 << SHARE_BITS
    for share in (start, (start + end) // 2, end - 1):
        assert curve.find(share) == (value, start, end)


def test_the_shares_are_the_whole() -> None:
    for size in (2, 3, 500, LARGEST_SIZE):
        curve = Curve(size, 16 * 7, 5000, 1, 30000)
        assert curve.below(0) == 0
        assert curve.below(size) == 1 << SHARE_BITS


def test_what_is_expected_is_cheap_and_what_is_not_is_not_impossible() -> None:
    curve = Curve(1000, 16 * 500, 4096 * 4)
    shares = [curve.below(n + 1) - curve.below(n) for n in range(1000)]
    assert max(shares) == shares[500]
    assert shares[500] > (1 << SHARE_BITS) // 10
    assert min(shares) >= 100
