"""SYNC and ACK in frames: before a record in any order, cut off, and among random bytes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.base.qos import Qos, Reliability, Stamp
from zacoustic.core.profiles.native.controls import CONTROLS
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.core.wire.content import measure_content
from zacoustic.core.wire.controls import Item
from zacoustic.core.wire.frame import Control, Prefixes, Record, Stray, Sync, parse_frame

RELIABLE = Qos(reliability=Reliability.RELIABLE)
TABLE = StreamTable(
    [
        TopicSpec(stream_id=1, name="opaque", qos=RELIABLE),
        TopicSpec(stream_id=2, name="typed", type_name="N", qos=RELIABLE),
        TopicSpec(
            stream_id=3,
            name="v/{k}",
            type_name="N",
            wildcards=(Wildcard(name="k", values=("a", "b")),),
            qos=Qos(reliability=Reliability.RELIABLE, stamp=Stamp.AGE),
        ),
        TopicSpec(stream_id=4, name="plain"),
    ],
    types=TypeTable(
        [TypeSpec(name="N", fields=(FieldSpec(name="n", type="uint8", range=(0, 9)),))]
    ),
    nodes={1: "a", 2: "b"},
)


def stream(stream_id: int) -> Stream:
    found = TABLE.get(stream_id)
    if found is None:
        raise KeyError(stream_id)
    return found


def parse(frame: bytes, *, unicast: bool = True) -> list[Item]:
    def measure(stream_id: int, buffer: bytes, offset: int, prefixes: Prefixes) -> int | None:
        return measure_content(stream(stream_id), buffer, offset, prefixes, source=1)

    return list(parse_frame(frame, measure, CONTROLS, unicast=unicast))


SYNC = Sync(0x1234, 0x56789A)


def test_sync_stands_before_a_sample() -> None:
    assert parse(SYNC.encode() + b"\x01\x05payload") == [
        Record(1, b"\x05payload", Prefixes(sync=SYNC))
    ]


def test_prefixes_stand_in_any_order() -> None:
    prefixes = Prefixes(delete=True, sync=SYNC)
    for head in (SYNC.encode() + b"\xb3", b"\xb3" + SYNC.encode()):
        assert parse(head + b"\x01\x05\x02\x07\x01") == [
            Record(1, b"\x05", prefixes),
            Record(2, b"\x07\x01"),
        ]


def test_ack_names_its_node_in_a_broadcast_frame_only() -> None:
    assert parse(b"\xb9\x01\x07") == [Record(1, b"\x07", Prefixes(acknowledged=0))]
    assert parse(b"\xb9\x02\x01\x07", unicast=False) == [
        Record(1, b"\x07", Prefixes(acknowledged=2))
    ]


def test_records_behind_an_ack_are_found() -> None:
    frame = b"\xb9\x03\x01\x87\x85\x01" + SYNC.encode() + b"\xb9\x01\x07" + b"\x02\x08\x01\x04rest"
    assert parse(frame) == [
        Record(3, b"\x01\x87\x85\x01", Prefixes(acknowledged=0)),
        Record(1, b"\x07", Prefixes(sync=SYNC, acknowledged=0)),
        Record(2, b"\x08\x01"),
        Record(4, b"rest"),
    ]


@pytest.mark.parametrize("unicast", [True, False])
@pytest.mark.parametrize("frame", [SYNC.encode(), b"\xb9\x02", SYNC.encode() + b"\xb9\x02"])
def test_prefix_that_is_cut_off_is_truncated(frame: bytes, unicast: bool) -> None:
    for size in range(1, len(frame) + 1 if not unicast or frame[0] == Control.SYNC else 2):
        items = parse(frame[:size], unicast=unicast)
        whole = [item for item in items if isinstance(item, Record)]
        assert whole or items == [Stray("truncated", size)]


PIECES = st.one_of(
    st.builds(lambda a, b: Sync(a, b).encode(), st.integers(0, 65535), st.integers(0, 1 << 24)),
    st.sampled_from([b"\xb9", b"\xb3", b"\xb4\x05", b"\xb2\x04", b"\xb1\x00\x01", b"\x00"]),
    st.integers(1, 5).map(lambda stream_id: bytes((stream_id,))),
    st.binary(max_size=8),
)


@given(st.lists(PIECES, max_size=12), st.booleans())
def test_any_frame_is_taken_apart(pieces: list[bytes], unicast: bool) -> None:
    frame = b"".join(pieces)
    items = parse(frame, unicast=unicast)
    assert len(items) <= len(frame)
    for item in items:
        if isinstance(item, Record):
            acknowledged = item.prefixes.acknowledged
            assert acknowledged is None or (acknowledged == 0) >= unicast
            assert len(item.content) <= len(frame)


@given(st.binary(max_size=80), st.booleans())
def test_any_bytes_are_taken_apart(frame: bytes, unicast: bool) -> None:
    assert len(parse(frame, unicast=unicast)) <= len(frame)
