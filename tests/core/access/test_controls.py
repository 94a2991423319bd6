"""What medium access says on the channel."""

from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.clock import NS_PER_S
from zacoustic.core.wire.access import (
    ANYBODY,
    CLOCK_TICK_NS,
    LONGEST_SPAN_NS,
    SPAN_STEP_NS,
    ClockTime,
    Turn,
)


@given(node=st.integers(0, 255), span_ns=st.integers(0, 2 * LONGEST_SPAN_NS))
def test_turn_comes_back_in_steps_of_twenty_milliseconds(node: int, span_ns: int) -> None:
    encoded = Turn(node, span_ns).encode()
    assert len(encoded) == 3
    back = Turn.decode(encoded[1:])
    assert back.node == node
    assert back.span_ns == min(span_ns // SPAN_STEP_NS * SPAN_STEP_NS, LONGEST_SPAN_NS)


@given(
    time_ns=st.integers(0, 4 * 10**18),
    error_ns=st.one_of(st.none(), st.integers(0, NS_PER_S)),
)
def test_time_comes_back_with_an_error_that_is_not_smaller(
    time_ns: int, error_ns: int | None
) -> None:
    encoded = ClockTime(time_ns, error_ns).encode()
    assert len(encoded) == 8
    back = ClockTime.decode(encoded[1:])
    assert abs(back.time_ns - time_ns) <= CLOCK_TICK_NS // 2
    if error_ns is None or error_ns > 254 * NS_PER_S // 1000:
        assert back.error_ns is None
    else:
        assert back.error_ns is not None
        assert error_ns <= back.error_ns < error_ns + NS_PER_S // 1000 + 1


def test_golden_bytes() -> None:
    assert Turn(ANYBODY, 2_850_000_000).encode().hex() == "beff8e"
    assert Turn(3, 1_000_000_000).encode().hex() == "be0332"
    assert ClockTime(1_767_225_600_000_000_000, 1_500_000).encode().hex() == "bd1012a48a900002"
