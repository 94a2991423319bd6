"""The two records of objects, and the manifest."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.transport.objects.manifest import (
    DIGEST_BYTES,
    decode_manifest,
    encode_object,
    open_object,
)
from zacoustic.core.wire.objects import (
    CHECK_BYTES,
    FEEDBACK_BYTES,
    FRAGMENT_HEADER_BYTES,
    MOST_BLOCKS,
    NO_FRAGMENT,
    WITHDRAWN,
    Complete,
    Feedback,
    Fragment,
    Headless,
    Lacks,
    ListenHint,
    Refused,
    decode_feedback,
    decode_fragment,
)

TRANSFERS = st.integers(0, 63)
FEEDBACKS: st.SearchStrategy[Feedback] = st.one_of(
    st.builds(
        Lacks,
        TRANSFERS,
        st.integers(0, 255),
        st.lists(st.integers(0, 255), min_size=1, max_size=MOST_BLOCKS).map(tuple),
    ),
    st.builds(Complete, TRANSFERS, st.binary(min_size=CHECK_BYTES, max_size=CHECK_BYTES)),
    st.builds(Refused, TRANSFERS, st.integers(0, 255)),
    st.builds(Headless, TRANSFERS, st.integers(0, 65535)),
)


@given(
    TRANSFERS,
    st.sampled_from(ListenHint),
    st.integers(0, NO_FRAGMENT - 1),
    st.binary(min_size=1, max_size=600),
)
def test_fragment_survives(transfer: int, call: ListenHint, index: int, data: bytes) -> None:
    fragment = Fragment(transfer, call, index, data)
    record = fragment.encode()
    assert len(record) == FRAGMENT_HEADER_BYTES + len(data)
    assert FRAGMENT_HEADER_BYTES == 4
    assert decode_fragment(record) == fragment


@pytest.mark.parametrize("about", [WITHDRAWN, b"1234"])
def test_what_is_no_fragment(about: bytes) -> None:
    fragment = Fragment(5, ListenHint.ANSWER, NO_FRAGMENT, about)
    assert decode_fragment(fragment.encode()) == fragment
    assert decode_fragment(fragment.encode() + b"x") is None
    assert decode_fragment(Fragment(5, ListenHint.ANSWER, 3, b"").encode()) is None


@given(FEEDBACKS, st.binary(max_size=20), st.binary(max_size=20))
def test_feedback_survives_and_shows_its_end(
    feedback: Feedback, before: bytes, behind: bytes
) -> None:
    record = feedback.encode()
    assert len(record) <= FEEDBACK_BYTES == 8
    found = decode_feedback(before + record + behind, len(before))
    assert found == (feedback, len(before) + len(record))


@given(st.binary(max_size=80), st.integers(0, 80))
def test_random_bytes_raise_nothing(buffer: bytes, offset: int) -> None:
    decode_fragment(buffer)
    found = decode_feedback(buffer, offset)
    if found is not None:
        assert buffer[offset : found[1]] == found[0].encode()
    decode_manifest(buffer)


@given(
    st.integers(1, 175),
    st.lists(st.integers(0, 255), max_size=5).map(tuple),
    st.sampled_from([None, "image/png", "x/y"]),
    st.binary(max_size=300),
    st.integers(0, 65535),
    st.integers(0, (1 << 24) - 1),
)
def test_object_survives(
    stream_id: int,
    instance: tuple[int, ...],
    encoding: str | None,
    payload: bytes,
    lineage: int,
    number: int,
) -> None:
    manifest, coded = encode_object(
        stream_id, instance, encoding, payload, lineage=lineage, number=number
    )
    assert decode_manifest(coded + bytes(7)) == manifest
    assert manifest.coded_bytes == len(coded)
    assert open_object(manifest, coded + bytes(7)) == payload


@given(st.binary(min_size=1, max_size=100), st.randoms(use_true_random=False))
def test_altered_object_is_not_opened(payload: bytes, rng: random.Random) -> None:
    manifest, coded = encode_object(12, (3,), "image/png", payload, lineage=7, number=8)
    altered = bytearray(coded)
    altered[rng.randrange(len(altered))] ^= rng.randrange(1, 256)
    assert open_object(manifest, bytes(altered)) is None


@pytest.mark.parametrize("size_bytes", [0, 127, 128, 10_240, 1 << 20])
def test_manifest_is_short(size_bytes: int) -> None:
    manifest, coded = encode_object(12, (), None, bytes(size_bytes), lineage=7, number=8)
    assert manifest.payload_bytes == size_bytes
    assert manifest.size_bytes <= 7 + 4 + DIGEST_BYTES
    assert decode_manifest(coded[: manifest.size_bytes - 1]) is None
