"""Encodings of the application's side, and their names on the channel."""

import contextlib
import math
from datetime import date
from typing import Any

import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.values.encoding import (
    CBOR,
    ENCODINGS,
    JSON,
    LARGEST_VALUE_BYTES,
    OPAQUE,
    SPELLED_OUT,
    decode_application,
    decode_prefix,
    encode_application,
    encode_prefix,
)
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import PayloadInvalidError


def test_numbers_of_encodings_are_fixed_for_ever() -> None:
    # Wire format: append to this list, never change it.
    listed = (
        "zenoh/bytes zenoh/string zenoh/serialized application/octet-stream text/plain "
        "application/json text/json application/cdr application/cbor application/yaml "
        "text/yaml text/json5 application/python-serialized-object application/protobuf "
        "application/xml text/xml text/csv text/markdown text/html image/png image/jpeg "
        "image/gif image/bmp image/webp audio/aac audio/ogg audio/vorbis video/h264 "
        "video/h265 video/mp4"
    )
    assert " ".join(ENCODINGS) == listed
    assert len(ENCODINGS) < SPELLED_OUT


@given(st.one_of(st.sampled_from(ENCODINGS), st.text(min_size=1, max_size=60)), st.binary())
def test_prefix_comes_back_wherever_it_stands(encoding: str, around: bytes) -> None:
    prefix = encode_prefix(encoding)
    assert decode_prefix(around + prefix + around, len(around)) == (
        encoding,
        len(around) + len(prefix),
    )
    if encoding in ENCODINGS:
        assert len(prefix) == 1


@pytest.mark.parametrize("buffer", ["", "fe", "ff", "ff00", "ff0361", "ff01ff", "1e"])
def test_prefix_that_is_none_is_none(buffer: str) -> None:
    assert decode_prefix(bytes.fromhex(buffer), 0) is None


@given(st.binary(max_size=12))
def test_any_bytes_are_a_prefix_or_none(buffer: bytes) -> None:
    found = decode_prefix(buffer, 0)
    assert found is None or 0 < found[1] <= len(buffer)


@pytest.mark.parametrize("encoding", ["", "x" * 256])
def test_encoding_that_cannot_be_spelled_is_refused(encoding: str) -> None:
    with pytest.raises(PayloadInvalidError, match=r"encoding has \d+ bytes; allowed: 1\.\.255"):
        encode_prefix(encoding)


VALUE: dict[str, Any] = {"b": 1.5, "a": "grün", "list": [1, None, True], "inner": {"x": -3}}


@pytest.mark.parametrize("encoding", [CBOR, JSON, "text/json", "application/json;nav"])
def test_value_comes_back_from_the_application(encoding: str) -> None:
    payload = encode_application(VALUE, encoding)
    value = decode_application(payload, encoding)
    assert value == VALUE
    assert isinstance(value, dict)
    assert list(value) == list(VALUE)


def test_cbor_is_the_default() -> None:
    assert encode_application(VALUE) == cbor2.dumps(VALUE)


def test_opaque_payload_is_itself() -> None:
    for encoding in (OPAQUE, "text/plain", "application/cdr", "x/y"):
        assert encode_application(b"\x00\xff", encoding) == b"\x00\xff"
        assert decode_application(b"\x00\xff", encoding) == b"\x00\xff"
    with pytest.raises(PayloadInvalidError, match="dict of 4 as zenoh/bytes; allowed: bytes, or"):
        encode_application(VALUE, OPAQUE)


BYTES_TYPE = TypeTable(
    [
        TypeSpec(
            name="T",
            fields=(
                FieldSpec(name="raw", type="bytes"),
                FieldSpec(name="list", type="bytes", length=2),
                FieldSpec(name="in", type="In"),
                FieldSpec(name="text", type="string", optional=True),
                FieldSpec(name="none", type="bytes", optional=True),
            ),
        ),
        TypeSpec(name="In", fields=(FieldSpec(name="raw", type="bytes"),)),
    ]
)["T"]


def test_bytes_fields_are_base64_in_json() -> None:
    value = {"raw": b"\x00", "list": [b"a", b""], "in": {"raw": b"b"}, "text": "AA==", "none": None}
    payload = encode_application(value, JSON)
    assert decode_application(payload, JSON, type_spec=BYTES_TYPE) == value


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (b'{"raw":"A"}', "T.raw is 'A'; allowed: base64"),
        (b'{"raw":"\xc3\xbc"}', "allowed: base64"),
        (b'{"in":{"raw":"!!!!"}}', "T.in.raw is '!!!!'; allowed: base64"),
    ],
)
def test_bad_base64_names_the_field(value: bytes, message: str) -> None:
    with pytest.raises(PayloadInvalidError) as caught:
        decode_application(value, JSON, type_spec=BYTES_TYPE)
    assert message in str(caught.value)


def test_values_of_other_kinds_are_left_to_validation() -> None:
    for text in (b"3", b'{"raw":3,"in":[],"list":"AA=="}', b"[]", b"null"):
        decode_application(text, JSON, type_spec=BYTES_TYPE)


def test_numbers_that_json_lacks_are_null() -> None:
    assert encode_application({"a": math.nan}, JSON) == b'{"a":null}'


@pytest.mark.parametrize(
    ("payload", "encoding", "message"),
    [
        (b"", CBOR, "no application/cbor: premature end"),
        (b"\x01\x02", CBOR, "1 bytes behind the value; allowed: one value"),
        (b"\x9b\xff\xff\xff\xff\xff\xff\xff\xff", CBOR, "no application/cbor"),
        (b"\x62\xc3\x28", CBOR, "no application/cbor"),
        (b"\x81" * 100000, CBOR, "no application/cbor"),
        (b"\xd8\x23\x64((((", CBOR, "no application/cbor"),
        (b"\xc1\xfb" + b"\xff" * 8, CBOR, "no application/cbor"),
        (b"", JSON, "no application/json"),
        (b"NaNa", JSON, "no application/json: JSON is malformed"),
        (b"[1] x", JSON, "trailing characters"),
        (b"[" * 100000, JSON, "no application/json"),
        (b"1e999", JSON, "no application/json: Number out of range"),
        (b'"\xff"', JSON, "no application/json"),
        (b"0" * (LARGEST_VALUE_BYTES + 1), JSON, "allowed: at most 1048576 bytes"),
    ],
)
def test_malformed_payload_is_one_line(payload: bytes, encoding: str, message: str) -> None:
    with pytest.raises(PayloadInvalidError) as caught:
        decode_application(payload, encoding)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def cyclic() -> list[Any]:
    value: list[Any] = []
    value.append(value)
    return value


@pytest.mark.parametrize("encoding", [CBOR, JSON])
@pytest.mark.parametrize("value", [{"a": object()}, "\ud800", cyclic(), {"a": [date]}])
def test_value_that_no_encoding_carries_is_refused(value: Any, encoding: str) -> None:
    with pytest.raises(PayloadInvalidError) as caught:
        encode_application(value, encoding)
    assert f"as {encoding}: " in str(caught.value)


@given(st.binary(max_size=40), st.sampled_from([CBOR, JSON, OPAQUE]))
def test_any_payload_is_a_value_or_invalid(payload: bytes, encoding: str) -> None:
    with contextlib.suppress(PayloadInvalidError):
        decode_application(payload, encoding, type_spec=BYTES_TYPE)


def test_json_reads_the_null_that_it_writes() -> None:
    fields = (
        FieldSpec(name="free", type="float64"),
        FieldSpec(name="maybe", type="float32", range=(0, 1), step=0.5, nan=True),
        FieldSpec(name="several", type="float32", length=2),
        FieldSpec(name="absent", type="float64", optional=True),
        FieldSpec(name="inner", type="Inner"),
    )
    inner = TypeSpec(name="Inner", fields=fields[:1])
    spec = TypeSpec(name="T", fields=fields, nested=(inner,))
    nan = math.nan
    value = {"free": nan, "maybe": nan, "several": [nan, 1.0], "absent": None}
    value |= {"inner": {"free": nan}}
    for encoding, written in (("application/json", b"null"), ("application/json;nan", b"NaN")):
        text = encode_application(value, encoding)
        assert text.count(written) >= 4
        again = spec.validate(decode_application(text, encoding, type_spec=spec))
        assert repr(again) == repr(value)
    bounded = TypeSpec(name="B", fields=(FieldSpec(name="a", type="float64", range=(0, 1)),))
    with pytest.raises(PayloadInvalidError, match="a is None"):
        bounded.validate(decode_application(b'{"a":null}', "text/json", type_spec=bounded))


def test_json_has_words_for_the_infinities_by_choice() -> None:
    value = {"a": -math.inf, "b": math.inf, "c": b"\1"}
    text = encode_application(value, "application/json;nan")
    assert text == b'{"a":-Infinity,"b":Infinity,"c":"AQ=="}'
    assert encode_application(value, "application/json") == b'{"a":null,"b":null,"c":"AQ=="}'
    read = decode_application(b'{"a":-Infinity,"b":NaN}', "application/json")
    assert repr(read) == "{'a': -inf, 'b': nan}"
    with pytest.raises(PayloadInvalidError, match="no application/json"):
        decode_application(b'{"a":NaN', "application/json")
