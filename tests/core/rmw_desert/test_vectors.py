import json
import math
import struct
from itertools import chain
from pathlib import Path
from typing import Any

import pytest

from tests.core.rmw_desert.vectors import Vector, read_vectors
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.rmw_desert.codec import RmwDesertCodec
from zacoustic.core.values.rmw_desert.messages import decode_message
from zacoustic.core.values.rmw_desert.packets import PacketDecoder
from zacoustic.core.values.types import FieldSpec, TypeSpec

VECTORS = {vector.name: vector for vector in read_vectors()}
CUT = "len300_truncated_by_55"
WITHOUT_FIELDS = "discovery_request"


def test_all_vectors_of_the_reference_are_there() -> None:
    written = json.loads(Path(__file__).with_name("vectors.json").read_text(encoding="utf-8"))
    assert len(written) == 125
    assert len(VECTORS) == 124


# A discovery request is no message of ROS: see test_discovery.
@pytest.mark.parametrize("name", [name for name in VECTORS if name != WITHOUT_FIELDS])
def test_each_packet_is_the_one_that_rmw_desert_sends(name: str) -> None:
    vector = VECTORS[name]
    assert vector.encode().hex() == vector.packet.hex()


@pytest.mark.parametrize("vector", VECTORS.values(), ids=VECTORS)
def test_each_packet_is_read_as_what_was_sent(vector: Vector) -> None:
    decoder = PacketDecoder()
    payloads = decoder.feed(vector.packet) + decoder.flush()
    if vector.name == CUT:
        # The end marker stands where that of a packet of 44 bytes would: nobody can tell.
        assert payloads == [vector.payload[:44]]
        message = decode_message(payloads[0])
        with pytest.raises(PayloadError):
            RmwDesertCodec(vector.type_spec).decode(message.fields)
        return
    assert payloads == [vector.payload]
    message = decode_message(payloads[0])
    assert (message.kind, message.stream_id) == (vector.kind, vector.stream_id)
    assert message.sequence == (vector.sequence or 0)
    if vector.name == WITHOUT_FIELDS:
        assert message.fields == b""
        return
    value = RmwDesertCodec(vector.type_spec).decode(message.fields)
    assert_same(list(value.values()), list(vector.value.values()), close=True)
    if vector.heard is not None and vector.name != "idl_char":
        # Above 64 items its own receiver has nothing but uninitialised memory.
        kept = flat(vector.heard)[: 64 - (3 if vector.sequence is not None else 2)]
        assert_same(flat(list(value.values()))[: len(kept)], kept, close=False)


def test_text_that_is_not_utf_8_is_refused() -> None:
    spec = TypeSpec(name="T", fields=(FieldSpec(name="f", type="string"),))
    message = decode_message(bytes.fromhex("000a64fffe9999"))
    with pytest.raises(PayloadError, match="UTF-8"):
        RmwDesertCodec(spec).decode(message.fields)


def flat(values: Any) -> list[Any]:
    """All scalars of a value, in their order."""
    if isinstance(values, dict):
        return flat(list(values.values()))
    if isinstance(values, list):
        return list(chain.from_iterable(flat(each) for each in values))
    return [values]


def assert_same(found: list[Any], expected: list[Any], *, close: bool) -> None:
    """Compare values: floats as singles, or where the rule of halves loses them roughly."""
    found, expected = flat(found), flat(expected)
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        if isinstance(one, float):
            assert_float(one, float(other), close=close)
        else:
            assert one == other


def assert_float(found: float, expected: float, *, close: bool) -> None:
    if math.isnan(expected):
        assert math.isnan(found)
        return
    try:
        (single,) = struct.unpack(">f", struct.pack(">f", expected))
    except OverflowError:
        single = math.copysign(math.inf, expected)
    if 2**-24 <= abs(single) < 2**-14 and close:
        assert found == pytest.approx(single, rel=1.0)
    elif abs(single) < 2**-126 and close:
        assert found in (single, 0.0)
    else:
        # What was printed has nine digits.
        assert found == pytest.approx(single, rel=1e-8, abs=0.0)
        assert math.copysign(1, found) == math.copysign(1, single)
