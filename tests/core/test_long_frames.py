"""Frames above a length that a device carries in another way have an airtime of their own."""

import msgspec
import pytest

from zacoustic.core.clock import NS_PER_S
from zacoustic.core.linktypes import LinkCapabilities

LINK = LinkCapabilities(
    mtu_bytes=1024,
    bit_rate_bps=800.0,
    preamble_s=0.2,
    long_above_bytes=64,
    long_bit_rate_bps=8000.0,
    long_preamble_s=0.1,
)


def test_a_long_frame_has_the_airtime_of_what_carries_it() -> None:
    assert LINK.airtime_ns(64) == pytest.approx(0.84 * NS_PER_S)
    assert LINK.airtime_ns(65) == pytest.approx(0.165 * NS_PER_S)
    assert LINK.airtime_ns(1024) == pytest.approx(1.124 * NS_PER_S)


def test_the_longest_frame_of_a_time_is_a_long_one() -> None:
    assert LINK.bounded(4.0) is LINK
    assert LINK.bounded(0.5).mtu_bytes == 400
    assert LINK.bounded(0.15).mtu_bytes == 32
    plain = msgspec.structs.replace(LINK, long_above_bytes=None)
    assert plain.bounded(4.0).mtu_bytes == 380


def test_a_rate_of_zero_is_refused() -> None:
    with pytest.raises(ValueError, match="long_bit_rate_bps"):
        msgspec.structs.replace(LINK, long_bit_rate_bps=0.0)
