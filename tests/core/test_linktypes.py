"""Link types: what no link may claim, and how long its frames last."""

from typing import Any

import pytest

from zacoustic.core.linktypes import LinkCapabilities


@pytest.mark.parametrize(
    ("lacks", "least"),
    [
        ((), 8),
        (("addressed",), 10),
        (("checked",), 12),
        (("framed",), 11),
        (("addressed", "checked", "framed"), 17),
    ],
)
def test_frame_must_have_room_for_a_hello(lacks: tuple[str, ...], least: int) -> None:
    settings: dict[str, Any] = dict.fromkeys(lacks, False)
    LinkCapabilities(mtu_bytes=least, bit_rate_bps=1, **settings)
    with pytest.raises(ValueError, match=f"mtu_bytes is {least - 1}; allowed: at least {least}"):
        LinkCapabilities(mtu_bytes=least - 1, bit_rate_bps=1, **settings)


@pytest.mark.parametrize("rate", [0, -1, float("nan")])
def test_bit_rate_is_above_zero(rate: float) -> None:
    with pytest.raises(ValueError, match="bit_rate_bps is"):
        LinkCapabilities(mtu_bytes=64, bit_rate_bps=rate)


@pytest.mark.parametrize("addresses", [(0, 5), (5, 4), (1, 255)])
def test_addresses_are_node_addresses(addresses: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="address_range is"):
        LinkCapabilities(mtu_bytes=64, bit_rate_bps=1, address_range=addresses)


def test_airtime_is_preamble_and_bits_without_the_gap() -> None:
    link = LinkCapabilities(mtu_bytes=64, bit_rate_bps=800, preamble_s=0.5, gap_s=9)
    assert link.airtime_ns(0) == 500_000_000
    assert link.airtime_ns(100) == 1_500_000_000
