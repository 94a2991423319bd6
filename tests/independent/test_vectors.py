"""Every vector of tests/golden, read from docs/wire.md alone."""

import hashlib
import hmac
import json
import math
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.keywrap import aes_key_unwrap

from tests.independent import (
    access,
    agreement,
    calls,
    cborpos,
    compose,
    dense,
    describe,
    envelope,
    fields,
    fleet,
    frame,
    goals,
    objects,
    packed,
    reliable,
    sealed,
    subscriptions,
    table,
)
from tests.independent.agreement import Ask, Confirm, Hello, Row, Tag
from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError
from tests.independent.fleet import AUV, NAV_VALUE, SHORE
from tests.independent.record import Acknowledgement, Call, Goal, Sample, Way
from tests.independent.reliable import Holding, Sync

GOLDEN = Path(__file__).parent.parent / "golden"


def _load(name: str) -> Any:
    return json.loads((GOLDEN / name).read_text(encoding="utf-8"))


NATIVE = {one["name"]: bytes.fromhex(one["hex"]) for one in _load("wire_native.json")}
MEANINGS = {one["name"]: one["meaning"] for one in _load("wire_native.json")}
SEALED = {one["name"]: bytes.fromhex(one["frame"]) for one in _load("wire_sealed.json")}
DENSE = _load("dense_frames.json")

DOWN = Way(fleet.TABLE, SHORE, AUV)
UP = Way(fleet.TABLE, AUV, SHORE)
ALL = Way(fleet.TABLE, AUV, envelope.BROADCAST)
DENSE_ALL = Way(fleet.DENSE, AUV, envelope.BROADCAST)
DENSE_DOWN = Way(fleet.DENSE, SHORE, AUV)
DIGEST = bytes.fromhex("a1b2c3d4")
TABLE_DIGEST = bytes.fromhex("200b2be1")
OBJECT_DIGEST = bytes.fromhex("0b4c60aa2edc4ecb")
PICTURE = bytes(range(100))
ME = Hello(2, 1, TABLE_DIGEST)
NAV = Sample(10, (), NAV_VALUE)
NOTHING: dict[str, Any] = {"on": None, "min_interval_s": None, "priority": None}
ASKING = {"for_s": None, "stream": None, **NOTHING, "heard": 1}


def _call(number: int, payload: Any, kind: int = calls.REQUEST) -> Call:
    return Call(20, calls.Head(kind, number, kind != calls.REQUEST), payload)


def _named(kind: int, payload: Any) -> Call:
    return Call(20, calls.Head(kind, 5, True, 0x34), payload)


def _order(number: int, value: dict[str, Any]) -> Call:
    head = calls.Head(calls.REQUEST, number, False)
    return Call(0xAF, head, {"serial": number, **ASKING, **value}, AUV, 0.0)


def _answer(number: int, **value: Any) -> Call:
    head = calls.Head(calls.RESPONSE, number, True, 1)
    state = {"silent": False, "ordered": False, "left_s": None, **NOTHING, **value}
    return Call(0xAF, head, state, AUV, 0.0)


def _goal(operation: str, number: int, **more: Any) -> Goal:
    from_server = more.pop("from_server", False)
    epoch = more.pop("epoch", None)
    return Goal(40, goals.Head(operation, number, from_server, epoch), **more)


def _up_goal(operation: str, number: int, **more: Any) -> Goal:
    return _goal(operation, number, from_server=True, **more)


EXPECTED: dict[str, tuple[Way, list[Any]]] = {
    "hello": (ALL, [Hello(2, 0x1234, DIGEST)]),
    "tag": (ALL, [Tag(0x1234)]),
    "confirm": (ALL, [Confirm(2, 0x1234)]),
    "ask_hello": (ALL, [Ask(2, 0)]),
    "ask_row": (ALL, [Ask(2, 10)]),
    "table_row": (ALL, [Row(0x1234, 10, DIGEST)]),
    "confirm_assured": (DOWN, [Confirm(agreement.DESTINATION, 0x1234)]),
    "confirm_provisional": (DOWN, [Tag(0x1234), Confirm(agreement.PROVISIONAL, 0x5678)]),
    "sample_typed": (ALL, [NAV]),
    "sample_opaque": (ALL, [Sample(11, (), b"hello")]),
    "sample_aged": (ALL, [Sample(12, (), b"old", age_s=4.2)]),
    "sample_six_hours_old": (ALL, [Sample(12, (), b"old", age_s=21184.788)]),
    "sample_too_old": (ALL, [Sample(12, (), b"old", age_s=float("inf"))]),
    "sample_wildcard": (ALL, [Sample(13, ("sonar",), b"\x01")]),
    "delete": (ALL, [Sample(13, ("ctd",), None)]),
    "sample_encoding": (ALL, [Sample(11, (), b"hi", "text/plain")]),
    "sample_encoding_spelled": (ALL, [Sample(11, (), b"hi", "x/y")]),
    "two_samples": (ALL, [NAV, Sample(11, (), b"raw")]),
    "two_opaque": (ALL, [Sample(11, (), b"one"), Sample(21, (), b"two")]),
    "first_frame": (ALL, [ME, NAV, Sample(11, (), b"raw")]),
    "second_frame": (ALL, [Tag(1), Sample(11, (), b"raw")]),
    "request": (DOWN, [_call(0, b"\x01")]),
    "response": (UP, [_call(0, b"ok", calls.RESPONSE)]),
    "error": (UP, [_call(1, calls.Failure(1, "no arm"), calls.ERROR)]),
    "turn": (ALL, [access.Turn(3, 50)]),
    "turn_back": (ALL, [access.Turn(access.BACK, 0)]),
    "turn_pause": (ALL, [access.Turn(access.PAUSE, 142)]),
    "clock": (ALL, [access.Clock(17672256000000, 2)]),
    "fragment_withdrawn": (ALL, [objects.Fragment(5, 0, 0xFFFF, b"")]),
    "fragment_turn": (DOWN, [objects.Fragment(5, 0, 0xFFFF, OBJECT_DIGEST[:4])]),
    "feedback_lacks": (UP, [objects.Feedback(5, objects.LACKS, block=3, missing=(12, 0, 255))]),
    "feedback_waits": (UP, [objects.Feedback(5, objects.LACKS, block=3, missing=(0,))]),
    "feedback_complete": (UP, [objects.Feedback(5, objects.COMPLETE, digest=OBJECT_DIGEST[:4])]),
    "feedback_refused": (UP, [objects.Feedback(5, objects.REFUSED, reason=2)]),
    "feedback_refused_later": (UP, [objects.Feedback(5, objects.REFUSED, reason=200)]),
    "error_later": (UP, [_call(1, calls.Failure(1, ""), calls.ERROR)]),
    "error_no_text": (UP, [_call(1, calls.Failure(1, ""), calls.ERROR)]),
    "feedback_headless": (UP, [objects.Feedback(5, objects.HEADLESS, held=300)]),
    "call_confirm_request": (UP, [_call(0, None, calls.CONFIRM)]),
    "call_confirm_answer": (DOWN, [Call(20, calls.Head(calls.CONFIRM, 0, False), None)]),
    "named_confirm": (UP, [_named(calls.CONFIRM, None)]),
    "named_response": (UP, [_named(calls.RESPONSE, b"ok")]),
    "named_error": (UP, [_named(calls.ERROR, calls.Failure(8, ""))]),
    "reliable_first": (DOWN, [Sample(30, (), b"dive", number=0, sync=Sync(1, 0))]),
    "ack_sync": (UP, [Acknowledgement(None, 30, (), Holding(1), Sync(1, 1))]),
    "reliable_sample": (DOWN, [Sample(30, (), b"dive", number=2)]),
    "ack": (UP, [Acknowledgement(None, 30, (), Holding(3))]),
    "reliable_delete": (DOWN, [Sample(31, ("sonar",), None, number=0, sync=Sync(1, 0))]),
    "ack_holding": (UP, [Acknowledgement(None, 30, (), Holding(72, (1, 3, 12)))]),
    "ack_asking": (UP, [Acknowledgement(None, 30, (), Holding(0, (), knows_lineage=False))]),
    "ack_broadcast": (ALL, [Acknowledgement(1, 31, ("sonar",), Holding(5))]),
    "reliable_in_rhythm": (DOWN, [Sample(30, (), b"dive", number=5, in_rhythm=True)]),
    "goal": (DOWN, [_goal("GOAL", 0, payload=NAV_VALUE)]),
    "goal_accepted": (UP, [_up_goal("ACCEPTED", 0)]),
    "goal_feedback": (UP, [_up_goal("FEEDBACK", 0, payload=b"near")]),
    "goal_cancel": (DOWN, [_goal("CANCEL", 0)]),
    "goal_cancel_accepted": (UP, [_up_goal("CANCEL", 0)]),
    "goal_result": (UP, [_up_goal("RESULT", 0, status=5, payload=b"up")]),
    "goal_succeeded": (UP, [_up_goal("SUCCEEDED", 1, status=4, payload=b"up")]),
    "goal_confirm": (DOWN, [_goal("CONFIRM", 0)]),
    "goal_refused": (UP, [_up_goal("REFUSED", 5, payload=goals.Refusal(1, None, "too deep"))]),
    "goal_cancel_refused": (UP, [_up_goal("REFUSED", 5, payload=goals.Refusal(9, None, ""))]),
    "goal_without_result": (UP, [_up_goal("RESULT", 5, status=0x80 | 6)]),
    "goal_unknown": (UP, [_up_goal("RESULT", 5, status=goals.UNKNOWN)]),
    "goal_cancel_again": (DOWN, [_goal("CANCEL AGAIN", 5, attempt=1)]),
    "goal_cancel_again_refused": (
        UP,
        [_up_goal("REFUSED", 5, payload=goals.Refusal(10, 1, "too deep"))],
    ),
    "goal_reminder": (UP, [_up_goal("RESULT", 5, status=goals.REMINDER)]),
    "goal_claim": (DOWN, [_goal("CLAIM", 5, epoch=0x1234)]),
    "goal_former_result": (UP, [_up_goal("RESULT", 5, epoch=0x1234, status=4, payload=b"up")]),
    "goal_former_succeeded": (
        UP,
        [_up_goal("SUCCEEDED", 5, epoch=0x1234, status=4, payload=b"up")],
    ),
    "order_ask": (DOWN, [ME, _order(0, {"order": "ask"})]),
    "order_ask_answer": (UP, [ME, _answer(0)]),
    "order_silence": (DOWN, [ME, _order(1, {"order": "silence", "for_s": 1800.0})]),
    "order_silence_answer": (UP, [ME, _answer(1, silent=True, ordered=True, left_s=1800.0)]),
    "order_resume": (DOWN, [ME, _order(2, {"order": "resume"})]),
    "order_resume_answer": (UP, [ME, _answer(2)]),
    "order_tune": (
        DOWN,
        [
            ME,
            _order(
                3,
                {
                    "order": "tune",
                    "stream": 11,
                    "on": False,
                    "min_interval_s": 10.0,
                    "priority": "background",
                },
            ),
        ],
    ),
    "order_tune_answer": (
        UP,
        [ME, _answer(3, on=False, min_interval_s=10.0, priority="background")],
    ),
    "order_reset": (DOWN, [ME, _order(4, {"order": "reset", "stream": 20})]),
    "order_reset_answer": (
        UP,
        [
            ME,
            Call(
                0xAF,
                calls.Head(calls.ERROR, 4, True, 1),
                calls.Failure(1, "stream 20 is no topic"),
                AUV,
            ),
        ],
    ),
    "order_confirm": (DOWN, [Call(0xAF, calls.Head(calls.CONFIRM, 4, False), None, AUV)]),
    "status": (DOWN, [ME, Call(0xAE, calls.Head(calls.REQUEST, 0, False), b"", AUV, 0.0)]),
    "status_answer": (
        UP,
        [
            ME,
            Call(
                0xAE,
                calls.Head(calls.RESPONSE, 0, True, 1),
                {
                    "journal": "kept",
                    "starts": 1,
                    "utc_s": 1750000000,
                    "clock_error_s": 0.0,
                    "range_m": None,
                    "schedule": 0,
                },
                AUV,
                0.0,
            ),
        ],
    ),
    "subscribe": (DOWN, [subscriptions.Subscribe(6, 1, 0x04, 1)]),
    "subscribe_answer": (UP, [subscriptions.Subscribe(6, 1, 0x04, 1, answer=True, proved=True)]),
    "unsubscribe": (DOWN, [subscriptions.Subscribe(6, 2, 0, 1)]),
    "dense_ack": (DOWN, [dense.BlockAck(None, 0x1234)]),
    "dense_ack_broadcast": (ALL, [dense.BlockAck(1, 0x3FFF)]),
    "dense_acknowledged": (DENSE_ALL, [dense.BlockAck(1, 0x2A42), Sample(11, (), b"")]),
    "packed_octets": (ALL, [Sample(51, (), bytes.fromhex("8f03ff77"))]),
    "packed_octets_marked": (ALL, [Sample(51, (), bytes.fromhex("c803ff77"))]),
}
"""How each vector goes, and what it holds, as its meaning says."""

BLOCKS: dict[str, tuple[Way, list[Any], int]] = {
    "dense_first": (DENSE_ALL, [Hello(2, 1, bytes.fromhex("0c894778"))], 8),
    "dense_several": (DENSE_ALL, [Sample(11, (), b"raw")], 18),
    "dense_referring": (DENSE_ALL, [], 4),
    "dense_text": (DENSE_ALL, [], 7),
}
"""Vectors with a dense block: what stands before it, and how many bytes it has."""

APART = {
    "fragment_first",
    "fragment_last",
    "fragment_repair",
    "fragment_aged",
    "sample_of_unknown_age",
    "unaddressed",
    "unchecked",
    "byte_stream",
    "packed_text",
    *BLOCKS,
}
COMBINED = {
    *("reliable_wildcards_aged", "ack_sync_holding", "hello_len_ack", "extension_padding"),
    "byte_stream_long",
    "latched_publisher",
}
"""Vectors of several parts that are read above one by one."""
DIGESTS = {name for name in NATIVE if name.startswith("digest_of_")}


def _read(name: str, data: bytes | None = None) -> frame.Frame:
    way = EXPECTED[name][0] if name in EXPECTED else BLOCKS[name][0]
    return frame.read(NATIVE[name] if data is None else data, way)


def _mutated(data: bytes) -> Iterator[bytes]:
    for place in range(len(data)):
        for bit in range(8):
            yield data[:place] + bytes((data[place] ^ 1 << bit,)) + data[place + 1 :]


def test_every_native_vector_has_a_test() -> None:
    apart = {one for one in NATIVE if one.startswith(("routing_", "carried_", "keys"))}
    # test_fields.py reads those.
    assert set(NATIVE) == set(EXPECTED) | APART | DIGESTS | COMBINED | apart


@pytest.mark.parametrize("name", EXPECTED)
def test_native_vector(name: str) -> None:
    way, expected = EXPECTED[name]
    whole = _read(name)
    controls = [one for one in expected if isinstance(one, agreement.Control)]
    assert list(whole.agreement) == controls, MEANINGS[name]
    assert list(whole.items) == expected[len(controls) :], MEANINGS[name]
    assert not whole.padding
    introduction = next((one for one in controls if isinstance(one, Hello | Tag)), None)
    assert whole.introduction == introduction
    assert way.table is fleet.TABLE or name.startswith("dense")


@pytest.mark.parametrize("name", sorted(EXPECTED.keys() - fleet.READ_ONLY))
def test_native_vector_is_written_the_same(name: str) -> None:
    way, expected = EXPECTED[name]
    records = [one for one in expected if isinstance(one, Sample | Acknowledgement | Call | Goal)]
    controls = expected[: len(expected) - len(records)]
    assert compose.frame_of(controls, records, way.table) == NATIVE[name]


@pytest.mark.parametrize("name", [*EXPECTED, *BLOCKS])
def test_a_flipped_bit_is_read_as_something_else(name: str) -> None:
    whole = _read(name)
    for other in _mutated(NATIVE[name]):
        assert _read(name, other) != whole


@pytest.mark.parametrize("name", EXPECTED)
def test_a_cut_frame_is_read_as_something_else(name: str) -> None:
    whole = _read(name)
    for length in range(len(NATIVE[name])):
        assert _read(name, NATIVE[name][:length]) != whole


def test_what_the_meanings_say_of_times() -> None:
    (turn,) = _read("turn").items
    (pause,) = _read("turn_pause").items
    (clock,) = _read("clock").items
    assert isinstance(turn, access.Turn)
    assert turn.span_s == 1.0
    assert isinstance(pause, access.Turn)
    assert pause.span_s == 2.84
    assert isinstance(clock, access.Clock)
    assert clock.utc == datetime(2026, 1, 1, tzinfo=UTC)


def test_what_the_meanings_say_of_streams_and_numbers() -> None:
    (message,) = _read("subscribe").items
    (nothing,) = _read("unsubscribe").items
    (ack,) = _read("ack_holding").items
    (waits,) = _read("feedback_waits").items
    assert isinstance(message, subscriptions.Subscribe)
    assert message.wanted == (50,)
    assert isinstance(nothing, subscriptions.Subscribe)
    assert nothing.wanted == ()
    assert isinstance(ack, Acknowledgement)
    assert ack.holding.numbers(reliable.whole_awaited(ack.holding.awaited, 190)) == (201, 203, 212)
    assert isinstance(waits, objects.Feedback)
    assert waits.waits


# Envelopes

RECORD = bytes.fromhex("0b00ff")
ENVELOPES = {
    "unaddressed": envelope.Capabilities(checks=True, delimits=True),
    "unchecked": envelope.Capabilities(addresses=True, delimits=True),
    "byte_stream": envelope.Capabilities(),
}


@pytest.mark.parametrize("name", ENVELOPES)
def test_envelope(name: str) -> None:
    link = ENVELOPES[name]
    opened = envelope.unwrap(NATIVE[name], link, addresses=(SHORE, AUV))
    assert opened == envelope.Opened(AUV, SHORE, RECORD)
    assert envelope.wrap(opened, link) == NATIVE[name]
    for other in _mutated(NATIVE[name]):
        with_check = not link.checks
        try:
            again = envelope.unwrap(other, link, addresses=(SHORE, AUV))
        except ReadError:
            continue
        assert not with_check
        assert again != opened


@pytest.mark.parametrize("addresses", [False, True])
@pytest.mark.parametrize("checks", [False, True])
@pytest.mark.parametrize("delimits", [False, True])
def test_every_envelope_returns_what_it_was_given(
    addresses: bool, checks: bool, delimits: bool
) -> None:
    link = envelope.Capabilities(addresses, checks, delimits)
    for length in (0, 1, 3, 247, 248, 249, 250, 254, 255, 600):
        for filler in (b"\0", b"\x01", b"\0\x07"):
            opened = envelope.Opened(AUV, SHORE, (filler * length)[:length])
            wrapped = envelope.wrap(opened, link)
            assert envelope.unwrap(wrapped, link, addresses=(SHORE, AUV)) == opened
            if not delimits:
                assert not wrapped[0]
                assert envelope.stream_frames(wrapped) == [wrapped]


# Digests

FILE = _load("tables.json")


@pytest.mark.parametrize("name", fleet.TABLES)
def test_digests_of_tables(name: str) -> None:
    table, plain = fleet.TABLES[name], FILE["tables"][name]
    for one in plain["streams"]:
        stream = table.streams[one["id"]]
        assert describe.stream_text(stream, table) == one["description"]
        assert describe.stream_digest(stream, table).hex() == one["digest"]
    for one in plain["types"]:
        assert describe.type_text(table.types, one["name"]) == one["description"]
    assert describe.nodes_text(table) == plain["nodes_description"]
    assert describe.table_digest(table).hex() == plain["digest"]


def test_digests_of_the_streams_of_every_table() -> None:
    rows = describe.rows(fleet.TABLES["carried"])
    for one in FILE["built_in"]:
        assert rows[one["id"]].hex() == one["digest"]
    assert {one["id"] for one in FILE["built_in"]} == {0xAB, 0xAC, 0xAD, 0xAE, 0xAF}


@pytest.mark.parametrize(
    "one",
    [one for one in _load("wire_native.json") if "source" not in one],
    ids=lambda one: one["name"],
)
def test_digest_vectors(one: dict[str, Any]) -> None:
    table = fleet.TABLES[one["table"]]
    ((what,),) = [item.values() for item in one["fields"]]
    if what == "table":
        assert describe.table_digest(table).hex() == one["hex"]
    else:
        assert describe.rows(table)[int(what.removeprefix("stream "))].hex() == one["hex"]


def test_the_example_of_the_page() -> None:
    depth = table.Field("depth", "float32", range=(0, 1000), step=0.1)
    topic = table.Topic(7, "nav", "T", subscribers=(2,))
    example = table.Table({7: topic}, {"T": (depth,)}, {})
    assert describe.stream_digest(topic, example).hex() == "a5000b16"


def test_digests_of_streams_differ() -> None:
    assert len({NATIVE[name] for name in DIGESTS}) == len(DIGESTS)


# Objects


def _fragment(name: str) -> objects.Fragment:
    (item,) = frame.read(NATIVE[name], ALL).items
    assert isinstance(item, objects.Fragment)
    assert item.write() == NATIVE[name]
    return item


FRAGMENTS = [_fragment(f"fragment_{name}") for name in ("first", "last", "repair")]


def test_fragments() -> None:
    assert [(one.number, one.hint, one.index) for one in FRAGMENTS] == [
        (5, 3, 0),
        (5, 0, 1),
        (5, 2, 2),
    ]
    manifest = objects.read_manifest(FRAGMENTS[0].data)
    assert (manifest.stream, manifest.lineage, manifest.number) == (12, 0x1234, 7)
    assert (manifest.instance, manifest.encoding) == (b"\x02", "image/png")
    assert (manifest.length, manifest.digest) == (100, OBJECT_DIGEST)


def test_an_object_says_its_age_in_its_first_fragment() -> None:
    first = _fragment("fragment_aged")
    manifest = objects.read_manifest(first.data)
    assert manifest.aged
    assert (manifest.stream, manifest.number, manifest.length) == (12, 8, 100)
    code = objects.age_of(first)
    assert code == 42
    assembly = objects.Assembly(len(first.data))
    assembly.take(first)
    whole = objects.make_object(12, 0x1234, 8, b"\x02", None, PICTURE, aged=True)
    assembly.take(objects.Fragment(6, 0, 1, objects.cut(whole, len(first.data))[1]))
    assert objects.payload_of(assembly.whole(2)) == (manifest, PICTURE)


def test_an_unknown_age() -> None:
    (item,) = frame.read(NATIVE["sample_of_unknown_age"], ALL).items
    assert isinstance(item, Sample)
    assert item.age_s is not None
    assert math.isnan(item.age_s)
    assert item.payload == b"old"


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_any_two_of_three_fragments_restore_the_object(lost: int) -> None:
    size = len(FRAGMENTS[0].data)
    assembly = objects.Assembly(size)
    for one in FRAGMENTS[:lost] + FRAGMENTS[lost + 1 :]:
        assembly.take(one)
    whole = objects.make_object(12, 0x1234, 7, b"\x02", "image/png", PICTURE)
    assert assembly.whole(-(-len(whole) // size)).rstrip(b"\0") == whole.rstrip(b"\0")
    manifest, payload = objects.payload_of(assembly.whole(2))
    assert payload == PICTURE
    assert manifest.digest == OBJECT_DIGEST


def test_fragments_are_made_the_same() -> None:
    whole = objects.make_object(12, 0x1234, 7, b"\x02", "image/png", PICTURE)
    sources = objects.cut(whole, len(FRAGMENTS[0].data))
    assert [*sources, objects.repair(0, 0, sources)] == [one.data for one in FRAGMENTS]


def test_a_flipped_bit_of_a_fragment_spoils_the_object() -> None:
    for data in list(_mutated(FRAGMENTS[0].data))[::5]:
        other = objects.Fragment(5, 3, 0, data)
        assembly = objects.Assembly(len(data))
        assembly.take(other)
        assembly.take(FRAGMENTS[1])
        with pytest.raises(ReadError):
            objects.payload_of(assembly.whole(2))


def test_blocks_of_a_large_object() -> None:
    whole = objects.make_object(12, 1, 0, b"", None, bytes(range(256)) * 2)
    sources = objects.cut(whole, 1)
    layout = objects.Layout(len(sources))
    assert [layout.block_size(one) for one in range(layout.blocks)] == [177, 176, 176]
    assembly = objects.Assembly(1)
    for index, data in enumerate(sources):
        if index not in (3, 200, 201, 528):
            assembly.take(objects.Fragment(1, 3, index, data))
    with pytest.raises(ReadError):
        assembly.whole(len(sources))
    for block, seed in ((0, 0), (0, 300), (1, 0), (1, 1), (2, 7)):
        start = layout.first(block)
        part = sources[start : start + layout.block_size(block)]
        data = objects.repair(block, seed, part)
        assembly.take(objects.Fragment(1, 3, layout.repair_index(block, seed), data))
    assert objects.payload_of(assembly.whole(len(sources)))[1] == bytes(range(256)) * 2


# Payloads


@pytest.mark.parametrize(
    "one", _load("payload_cbor.json")["vectors"], ids=lambda one: one["meaning"]
)
def test_cbor_by_position(one: dict[str, Any]) -> None:
    types, name = table.types_of(one["types"]), one["types"][0]["name"]
    data = bytes.fromhex(one["hex"])
    cursor = Cursor(data)
    value = cborpos.read(types, name, cursor)
    cursor.end()
    assert fields.plain(value) == one["decoded"]
    assert describe.type_text(types, name) == one["description"]
    assert cborpos.write(types, name, value) == data
    if one.get("value") and one["types"][0]["fields"][0].get("outside") != "clamp":
        assert cborpos.write(types, name, one["value"]) == data
    for other in _mutated(data):
        try:
            cursor = Cursor(other)
            again = cborpos.read(types, name, cursor)
            cursor.end()
        except ReadError:
            continue
        assert repr(again) != repr(value)  # minus zero is another one


@pytest.mark.parametrize(
    "one", _load("payload_packed.json")["vectors"], ids=lambda one: one["meaning"]
)
def test_packed(one: dict[str, Any]) -> None:
    types, name = table.types_of(one["types"]), one["types"][0]["name"]
    data = bytes.fromhex(one["hex"])
    assert describe.type_text(types, name) == one["description"]
    assert packed.write(types, name, one["value"]) == data
    cursor = Cursor(data)
    value = packed.read(types, name, cursor)
    cursor.end()
    assert fields.plain(value) == one["decoded"]
    for other in _mutated(data):
        try:
            cursor = Cursor(other)
            again = packed.read(types, name, cursor)
            cursor.end()
        except ReadError:
            continue
        assert repr(again) != repr(value)


@pytest.mark.parametrize(
    "one", _load("payload_refused.json")["vectors"], ids=lambda one: one["name"]
)
def test_refused_payload(one: dict[str, Any]) -> None:
    read = {"cbor": cborpos.read, "packed": packed.read}[one["codec"]]
    cursor = Cursor(bytes.fromhex(one["hex"]))
    with pytest.raises(ReadError):  # noqa: PT012
        read(table.types_of(one["types"]), "T", cursor)
        cursor.end()


@pytest.mark.parametrize("plain", DENSE["bytes without a type, packed"])
def test_packed_bytes(plain: str) -> None:
    payload = bytes.fromhex(DENSE["bytes without a type, packed"][plain])
    assert packed.read_bytes(payload).hex() == plain
    assert packed.write_bytes(bytes.fromhex(plain)) == payload


# Dense blocks in frames


@pytest.mark.parametrize("name", BLOCKS)
def test_frames_with_a_dense_block(name: str) -> None:
    _, before, size = BLOCKS[name]
    whole = _read(name)
    assert [*whole.agreement, *whole.items[:-1]] == before
    block = whole.items[-1]
    assert isinstance(block, dense.Block)
    assert len(block.data) == size
    assert NATIVE[name].endswith(block.data)


def _blocks() -> Iterator[bytes]:
    for model in ("model", "no model"):
        for way in ("each for itself", "acknowledged"):
            yield from map(bytes.fromhex, DENSE[model][way])
        yield bytes.fromhex(DENSE[model]["together"])


def test_blocks_of_the_vectors_are_the_rest_of_a_frame() -> None:
    front = compose.delimited(b"\x0braw")
    for data in _blocks():
        whole = frame.read(front + data, DENSE_ALL)
        assert whole.items == (Sample(11, (), b"raw"), dense.Block(data))


@pytest.mark.parametrize("model", ["model", "no model"])
def test_names_of_references(model: str) -> None:
    """Of a block that refers to nothing near, the name is its turn, three on from the last one."""
    heads = [dense.read_head(bytes.fromhex(data)) for data in DENSE[model]["acknowledged"]]
    assert [head.kind for head in heads] == 3 * [dense.INDEPENDENT] + 57 * [dense.REFERRING]
    names = [head.name for head in heads[3:]]
    turn = names[0]
    assert turn is not None
    for place in range(0, len(names), 3):
        name = names[place]
        assert name is not None
        assert names[place : place + 3] == [name] * 3
        assert name in ((turn + place) % 38, *range(38, 44))
    assert sum(name is not None and name >= 38 for name in names) == (3 if model == "model" else 0)


@pytest.mark.parametrize("model", ["model", "no model"])
def test_blocks_for_themselves_refer_to_nothing(model: str) -> None:
    blocks = [*DENSE[model]["each for itself"], DENSE[model]["together"]]
    kinds = {dense.read_head(bytes.fromhex(data)).kind for data in blocks}
    assert kinds <= {dense.INDEPENDENT, dense.SINGLE}


def test_the_blocks_of_the_page_are_of_the_kinds_that_it_says() -> None:
    kinds = {"dense_first": dense.INDEPENDENT, "dense_several": dense.INDEPENDENT}
    kinds |= {"dense_referring": dense.REFERRING, "dense_text": dense.INDEPENDENT}
    for name, kind in kinds.items():
        block = _read(name).items[-1]
        assert isinstance(block, dense.Block)
        assert dense.read_head(block.data).kind == kind


def test_an_acknowledgement_names_its_block() -> None:
    """The vector `dense_acknowledged` answers `dense_several`."""
    (hello,) = _read("dense_first").agreement
    assert isinstance(hello, Hello)
    root = dense.root(hello.digest)
    block = _read("dense_several").items[-1]
    (ack, _) = _read("dense_acknowledged").items
    assert isinstance(block, dense.Block)
    assert isinstance(ack, dense.BlockAck)
    assert dense.mark_of(dense.block_digest(root, block.data)) == ack.mark
    assert dense.mark_of(dense.block_digest(b"", block.data)) != ack.mark


# Sealed frames

KEY = sealed.FleetKey("harbour", 3, bytes(range(32)))
HELLO_OF_LIFE = Hello(2, 7, DIGEST)
SEALED_WAYS: dict[str, tuple[sealed.Way, int, bytes, bool, bytes]] = {
    "sealed_introduction": (
        sealed.Way(1, 255, 0),
        0,
        sealed.NO_TABLE,
        True,
        HELLO_OF_LIFE.write() + NATIVE["sample_typed"],
    ),
    "sealed_short": (sealed.Way(1, 255, 0), 1, DIGEST, True, NATIVE["sample_typed"]),
    "sealed_unicast": (sealed.Way(1, 2, 1), 0, DIGEST, True, NATIVE["sample_typed"]),
    "sealed_strong": (sealed.Way(1, 2, 0), 0, sealed.NO_TABLE, True, bytes.fromhex("af020000")),
    "sealed_readable": (sealed.Way(1, 255, 0), 0, DIGEST, False, NATIVE["sample_typed"]),
    "sealed_later": (sealed.Way(1, 255, 0), 65, DIGEST, True, NATIVE["sample_typed"]),
    "sealed_long_again": (sealed.Way(1, 255, 0), 80, DIGEST, True, NATIVE["sample_typed"]),
    "sealed_last_life": (sealed.Way(1, 2, 0), 0, DIGEST, True, NATIVE["sample_typed"]),
}
SHORT = ("sealed_short", "sealed_later")
LIVES = {"sealed_last_life": sealed.LAST_LIFE}
"""The lives that are not 7."""


def _open(name: str, data: bytes) -> bytes:
    way, counter, digest, encrypted, _ = SEALED_WAYS[name]
    return sealed.open_frame(
        data, way, KEY, life=LIVES.get(name, 7), counter=counter, digest=digest, encrypted=encrypted
    )


def test_every_sealed_vector_has_a_test() -> None:
    assert set(SEALED) == set(SEALED_WAYS)


@pytest.mark.parametrize("name", SEALED_WAYS)
def test_sealed_vector(name: str) -> None:
    way, counter, digest, encrypted, records = SEALED_WAYS[name]
    data = SEALED[name]
    head, _ = sealed.read_head(data)
    assert head.generation == 1
    assert head.strong == (name == "sealed_strong")
    assert head.life == (None if name in SHORT else LIVES.get(name, 7))
    assert head.counter == (counter & 63 if name in SHORT else counter)
    assert _open(name, data) == records
    again = sealed.seal(
        records,
        way,
        KEY,
        head,
        life=LIVES.get(name, 7),
        counter=counter,
        digest=digest,
        encrypted=encrypted,
    )
    assert again == data


@pytest.mark.parametrize("name", SEALED_WAYS)
def test_a_sealed_frame_with_a_flipped_bit_is_refused(name: str) -> None:
    for other in _mutated(SEALED[name]):
        with pytest.raises(ReadError):
            _open(name, other)


@pytest.mark.parametrize("name", SEALED_WAYS)
def test_a_sealed_frame_of_another_nonce_is_refused(name: str) -> None:
    way, counter, digest, encrypted, _ = SEALED_WAYS[name]
    life = LIVES.get(name, 7)
    others = [
        (sealed.Way(way.source + 1, way.destination, way.port), life, counter, digest),
        (sealed.Way(way.source, 3, way.port), life, counter, digest),
        (sealed.Way(way.source, way.destination, way.port + 2), life, counter, digest),
        (way, life + 1, counter, digest),
        (way, life, counter + 1, digest),
        (way, life, counter, bytes(3) + b"\x01"),
    ]
    for other, life, count, known in others:
        with pytest.raises(ReadError):
            sealed.open_frame(
                SEALED[name],
                other,
                KEY,
                life=life,
                counter=count,
                digest=known,
                encrypted=encrypted,
            )


def test_the_counters_that_six_bits_may_stand_for() -> None:
    window = sealed.Window()
    assert window.candidates(1) == (1, 65)
    window.take(100)
    assert window.candidates(100 & 63) == (100, 164)
    assert window.candidates(85 & 63) == (85, 149)
    assert window.candidates(84 & 63) == (148, 212)
    with pytest.raises(ReadError):
        window.take(100)
    window.take(37)
    with pytest.raises(ReadError):
        window.take(36)


def test_the_secret_in_the_call_of_stream_173() -> None:
    way = Way(fleet.TABLE, SHORE, AUV)
    (item,) = frame.read(NATIVE["keys"], way).items
    assert isinstance(item, Call)
    assert isinstance(item.payload, bytes)
    info = b"carry" + bytes((item.payload[0], way.source, way.destination))
    pair_key = hmac.digest(bytes(range(0x20, 0x40)), info + b"\x01", hashlib.sha256)
    assert aes_key_unwrap(pair_key, item.payload[1:]) == bytes(range(0x20))


def test_digest_of_an_object_is_sha256_of_all_of_it() -> None:
    whole = objects.make_object(12, 0x1234, 7, b"\x02", "image/png", PICTURE)
    front = whole[: len(whole) - 108]
    assert hashlib.sha256(front + PICTURE).digest()[:8] == OBJECT_DIGEST
