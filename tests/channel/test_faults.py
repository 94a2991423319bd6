import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.channel.faults.faults import FaultSpec, corrupt


@given(st.binary(min_size=1, max_size=64), st.integers(min_value=0, max_value=2**53))
def test_a_corrupt_frame_keeps_its_length_and_differs_by_one_to_four_bits(
    frame: bytes, seed: int
) -> None:
    damaged = corrupt(frame, random.Random(seed))
    assert len(damaged) == len(frame)
    flipped = sum((a ^ b).bit_count() for a, b in zip(frame, damaged, strict=True))
    assert 1 <= flipped <= 4
    assert corrupt(frame, random.Random(seed)) == damaged


def test_an_empty_frame_cannot_be_damaged() -> None:
    assert corrupt(b"", random.Random(1)) == b""


@pytest.mark.parametrize(
    ("key", "value"), [("corrupt", 1.5), ("duplicate", -0.1), ("duplicate_after_s", -1.0)]
)
def test_fault_shares_are_checked(key: str, value: float) -> None:
    settings: dict[str, Any] = {key: value}
    with pytest.raises(ValueError, match=f"{key} is {value}"):
        FaultSpec(**settings)
