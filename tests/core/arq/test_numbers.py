"""Seven bits of a number, and the content of an ACK."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.base.sizes import SIZES
from zacoustic.core.wire.numbers import (
    LONGEST_ACK_BYTES,
    NUMBERS,
    WINDOW,
    Ack,
    decode_ack,
    measure_ack,
    resolve_floor,
)

POSITIONS = st.integers(0, 1 << 40)
HELD = st.integers(0, (1 << WINDOW - 1) - 1)


@given(POSITIONS, st.integers(0, WINDOW - 1))
def test_number_in_the_window_is_found_from_its_seven_bits(expected: int, ahead: int) -> None:
    assert SIZES.samples.resolve((expected + ahead) % NUMBERS, expected) == expected + ahead


@given(st.integers(NUMBERS, 1 << 40), st.integers(1, NUMBERS - WINDOW))
def test_number_that_is_over_is_never_taken_for_a_new_one(expected: int, behind: int) -> None:
    assert SIZES.samples.resolve((expected - behind) % NUMBERS, expected) == expected - behind


@given(POSITIONS, st.integers(0, WINDOW))
def test_ack_of_up_to_a_whole_window_is_found_from_its_seven_bits(known: int, more: int) -> None:
    assert SIZES.samples.resolve_expected((known + more) % NUMBERS, known) == known + more


@given(st.integers(NUMBERS, 1 << 40), st.integers(1, NUMBERS - WINDOW - 1))
def test_ack_that_came_late_is_an_older_one(known: int, behind: int) -> None:
    assert SIZES.samples.resolve_expected((known - behind) % NUMBERS, known) == known - behind


@given(POSITIONS, st.integers(-(1 << 23), (1 << 23) - 1))
def test_floor_is_found_from_its_24_bits(expected: int, distance: int) -> None:
    floor = max(0, expected + distance)
    assert resolve_floor(floor & 0xFFFFFF, expected) == floor


@given(st.integers(0, NUMBERS - 1), HELD)
def test_ack_is_read_as_it_was_written(expected: int, held: int) -> None:
    content = Ack(expected, held).encode()
    assert decode_ack(content) == Ack(expected, held)
    assert len(content) <= LONGEST_ACK_BYTES
    assert measure_ack(content + b"\xff\xff", 0) == len(content)


def test_ack_says_that_it_does_not_know() -> None:
    assert Ack(7, knows=False).encode() == b"\x80\x00"
    assert decode_ack(b"\x80\x00") == Ack(0, knows=False)


@given(st.integers(0, NUMBERS - 1), HELD, st.integers(1, LONGEST_ACK_BYTES))
def test_ack_with_little_room_tells_of_the_first_that_are_held(
    expected: int, held: int, most_bytes: int
) -> None:
    content = Ack(expected, held).encode(most_bytes)
    assert len(content) <= most_bytes
    assert decode_ack(content) == Ack(expected, held & (1 << 7 * (most_bytes - 1)) - 1)


@pytest.mark.parametrize(
    ("content", "ack"),
    [
        (b"\x05", Ack(5)),
        (b"\x85\x01", Ack(5, 1)),
        (b"\x85\x00", None),
        (b"\x80\x80\x00", None),
        (b"\x85\x81\x01", Ack(5, 0b10000001)),
        (b"", None),
        (b"\x85", None),
        (b"\x85\x81", None),
        (b"\x05\x01", None),
        (b"\xff\xff\xff\xff\xff\x07", Ack(127, (1 << 31) - 1)),
        (b"\xff\xff\xff\xff\xff\x0f", None),
        (b"\xff\xff\xff\xff\xff\xff\x01", None),
    ],
)
def test_ack_on_the_wire(content: bytes, ack: Ack | None) -> None:
    assert decode_ack(content) == ack


@given(st.binary(max_size=12))
def test_any_bytes_are_an_ack_or_none(content: bytes) -> None:
    ack = decode_ack(content)
    if ack is not None:
        assert 0 <= ack.expected < NUMBERS
        assert 0 <= ack.held < 1 << WINDOW - 1
        assert decode_ack(ack.encode()) == ack


@given(st.binary(max_size=12), st.integers(0, 12))
def test_end_of_an_ack_is_inside_of_its_frame_and_past_its_beginning(
    buffer: bytes, offset: int
) -> None:
    end = measure_ack(buffer, offset)
    assert end is None or offset < end <= len(buffer)
