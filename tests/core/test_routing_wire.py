"""The bytes of commands about routes, as docs/wire.md, section 5, has them."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.wire.routing import RoutingAnswer, RoutingKind, RoutingRequest

REQUESTS = {
    "00 03 07 08": RoutingRequest(kind=RoutingKind.PROBE, run=7, count=8),
    "02 03 04 04 07 00": RoutingRequest(kind=RoutingKind.HEARD, via=(3, 4), run=7),
    "00 00 01": RoutingRequest(kind=RoutingKind.ASK, route_id=1),
    "00 01 01 00 05 1f 01 04 03": RoutingRequest(
        kind=RoutingKind.SET, route_id=1, revision=5, number=31, path=(1, 4, 3)
    ),
    "01 03 02 01 00 06": RoutingRequest(kind=RoutingKind.RESET, via=(3,), route_id=1, revision=6),
}
ANSWERS = {
    "00 0c 01 2c": (RoutingKind.PROBE, RoutingAnswer(over_s=12, airtime_ms=300)),
    "02 08 05 03": (RoutingKind.HEARD, RoutingAnswer(heard={2: 8, 5: 3})),
    "": (RoutingKind.HEARD, RoutingAnswer()),
    "00 05 1f 01 04 03": (
        RoutingKind.SET,
        RoutingAnswer(revision=5, number=31, path=(1, 4, 3)),
    ),
}


@pytest.mark.parametrize("encoded", REQUESTS)
def test_requests(encoded: str) -> None:
    assert REQUESTS[encoded].encode() == bytes.fromhex(encoded)
    assert RoutingRequest.decode(bytes.fromhex(encoded)) == REQUESTS[encoded]


@pytest.mark.parametrize("encoded", ANSWERS)
def test_answers(encoded: str) -> None:
    kind, answer = ANSWERS[encoded]
    assert answer.encode(kind) == bytes.fromhex(encoded)
    assert RoutingAnswer.decode(kind, bytes.fromhex(encoded)) == answer


@given(st.binary(max_size=40))
def test_any_request_is_decoded_to_itself_or_refused(request: bytes) -> None:
    decoded = None
    with contextlib.suppress(ValueError):
        decoded = RoutingRequest.decode(request)
    assert decoded is None or decoded.encode() == request


@given(st.sampled_from(RoutingKind), st.binary(max_size=40))
def test_any_answer_is_read_or_refused(kind: RoutingKind, answer: bytes) -> None:
    with contextlib.suppress(ValueError):
        RoutingAnswer.decode(kind, answer)


@pytest.mark.parametrize(
    ("encoded", "allowed"),
    [
        ("", "cut short"),
        ("03 02 03", "cut short"),
        ("01 00 03 07 08", r"via is 0; allowed: 1\.\.254"),
        ("00 05 01", "5 is not a valid"),
        ("00 03 07 21", r"count is 33; allowed: 1\.\.32"),
        ("00 04 07 ff", r"after is 255; allowed: 0\.\.254"),
        ("00 01 20 00 05 1f 01 04", r"route is 32; allowed: 1\.\.31"),
        ("00 01 01 00 05 00 01 04", r"number is 0; allowed: 1\.\.31"),
        ("00 01 01 00 05 1f 01 01", r"path is \[1, 1\]; allowed: 2\.\.16"),
        ("00 01 01 00 05 1f 01", "a request of 7 bytes"),
    ],
)
def test_a_wrong_request_names_what_is_allowed(encoded: str, allowed: str) -> None:
    with pytest.raises(ValueError, match=allowed):
        RoutingRequest.decode(bytes.fromhex(encoded))
