"""The messages of carried topics, to the byte."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.wire.carry import (
    LINEAGES,
    MOST_HOPS,
    NUMBERS,
    Bundle,
    CarryRefusal,
    Envelope,
    Receipt,
    decode,
    decode_life,
    encode_answer,
    encode_envelope,
    encode_life,
)

WILDCARDS = {5: 0, 6: 2}
BUNDLE = Bundle(1, 3, 5, (), 0xABCD)


def envelope(**changes: object) -> Envelope:
    """Return an envelope."""
    fields: dict[str, object] = {
        "bundle": BUNDLE, "number": 0x010203, "floor": 0x010200, "digest": b"\x11\x22",
        "life_s": 3600.0, "hops": 2, "payload": b"hi",
    }  # fmt: skip
    return Envelope(**{**fields, **changes})  # type: ignore[arg-type]


def test_bytes_of_each_message() -> None:
    by_custodian = encode_envelope(envelope(), sender=1, receiver=2)
    assert by_custodian.hex(" ") == "02 01 03 2f 05 11 22 ab cd 01 02 03 03 68 69"
    straight = encode_envelope(envelope(encoding="text/plain"), sender=1, receiver=3)
    assert straight[:10].hex(" ") == "d0 05 11 22 ab cd 01 02 03 03"
    assert encode_answer(Receipt(BUNDLE, 7)).hex(" ") == "40 01 03 05 ab cd 00 00 07"
    other = Bundle(1, 3, 6, (8, 9), 0xABCD)
    assert encode_answer(CarryRefusal(other, 7)).hex(" ") == "80 01 03 06 ab cd 00 00 07 08 09"


def test_floor_that_is_too_far_back_is_unknown() -> None:
    far = encode_envelope(envelope(floor=0), sender=1, receiver=2)
    read = decode(far, 1, 2, WILDCARDS)
    assert isinstance(read, Envelope)
    assert read.floor is None


@pytest.mark.parametrize(
    ("life_s", "byte"),
    [(0, 0x00), (59, 0x00), (60, 0x01), (900, 0x0F), (960, 0x18), (3600, 0x2F), (86400, 0x7B),
     (29_491_200, 0xFF), (1e9, 0xFF)],
)  # fmt: skip
def test_life_is_in_minutes_and_never_longer_than_it_was(life_s: float, byte: int) -> None:
    assert encode_life(life_s) == byte
    assert decode_life(byte) <= life_s


bundles = st.builds(
    Bundle, st.integers(1, 254), st.integers(1, 254), st.just(6),
    st.tuples(st.integers(0, 254), st.integers(0, 254)), st.integers(0, LINEAGES - 1),
)  # fmt: skip


@given(bundles, st.integers(0, NUMBERS - 1), st.integers(0, 254), st.binary(max_size=40),
       st.integers(0, MOST_HOPS), st.sampled_from([None, "application/json", "my/own"]),
       st.booleans())  # fmt: skip
def test_what_is_written_is_read(
    bundle: Bundle, number: int, behind: int, payload: bytes, hops: int, encoding: str | None,
    deleted: bool,
) -> None:  # fmt: skip
    written = envelope(
        bundle=bundle, number=number, floor=max(0, number - behind), hops=hops, deleted=deleted,
        encoding=None if deleted else encoding, payload=b"" if deleted else payload,
    )  # fmt: skip
    sender, receiver = 77, 78
    read = decode(encode_envelope(written, sender, receiver), sender, receiver, WILDCARDS)
    life_s = decode_life(encode_life(written.life_s))
    assert read == msgspec.structs.replace(written, life_s=life_s)
    for answer in (Receipt(bundle, number), CarryRefusal(bundle, number)):
        assert decode(encode_answer(answer), sender, receiver, WILDCARDS) == answer


@given(st.binary(max_size=40))
def test_random_bytes_are_read_or_refused(message: bytes) -> None:
    read = decode(message, 1, 2, WILDCARDS)
    if isinstance(read, Receipt | CarryRefusal):
        assert encode_answer(read) == message
    elif read is not None:
        assert read.floor is None or 0 <= read.floor <= read.number
