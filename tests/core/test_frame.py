"""Frame: records and controls, whole, cut and made up."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.profiles.native.controls import CONTROLS
from zacoustic.core.wire.agreement import (
    ABSENT_DIGEST,
    WIRE_VERSION,
    Ask,
    Confirm,
    Hello,
    TableRow,
    Tag,
)
from zacoustic.core.wire.controls import Item
from zacoustic.core.wire.frame import (
    Control,
    DenseAck,
    DenseBlock,
    Prefixes,
    Record,
    Stray,
    parse_frame,
)

SAID: tuple[Hello | Tag | Confirm | Ask | TableRow, ...] = (
    Hello(WIRE_VERSION, 0x1234, b"abcd"),
    Tag(0xFFFF),
    Confirm(254, 7),
    Ask(3, 0),
    TableRow(258, 175, ABSENT_DIGEST),
)


def measure(stream_id: int, buffer: bytes, offset: int, prefixes: Prefixes) -> int | None:
    """Stream 1 has two bytes, stream 2 shows no end, stream 3 claims too much; others: unknown."""
    if stream_id not in (1, 2, 3):
        raise KeyError(stream_id)
    if stream_id == 2:
        return None
    return offset + (0 if prefixes.delete else 2) if stream_id == 1 else offset + 1000


def parse(frame: bytes) -> list[Item]:
    return list(parse_frame(frame, measure, CONTROLS))


@pytest.mark.parametrize("control", SAID)
def test_control_comes_back_as_it_was(control: Hello | Tag | Confirm | Ask | TableRow) -> None:
    assert parse(control.encode()) == [control]
    assert parse(bytes(3) + control.encode() + bytes(3)) == [control]


@pytest.mark.parametrize("control", SAID)
def test_cut_control_is_truncated(control: Hello | Tag | Confirm | Ask | TableRow) -> None:
    for size in range(1, len(control.encode())):
        assert parse(control.encode()[:size]) == [Stray("truncated", size)]


def test_controls_stand_in_any_order_before_records() -> None:
    for order in itertools.permutations(SAID, 3):
        frame = b"".join(control.encode() for control in order) + b"\x02rest"
        assert parse(frame) == [*order, Record(2, b"rest")]


def test_record_ends_where_its_payload_shows() -> None:
    assert parse(b"\x01ab\x01cd\x02ef") == [
        Record(1, b"ab"),
        Record(1, b"cd"),
        Record(2, b"ef"),
    ]


@pytest.mark.parametrize("control", [SAID[0], SAID[1]])
def test_nothing_behind_hello_or_tag_is_measured(control: Hello | Tag) -> None:
    assert parse(control.encode() + b"\x01ab\x01cd") == [control, Record(1, b"ab\x01cd")]
    delimited = control.encode() + b"\xb2\x03\x01ab\x01cd"
    assert parse(delimited) == [control, Record(1, b"ab"), Record(1, b"cd")]


def test_unknown_stream_ends_the_frame_unless_it_is_delimited() -> None:
    assert parse(b"\x09ab\x01cd") == [Stray("unknown_stream", 6)]
    # LEN says where it ends, so that it is left to the table to know it or not.
    assert parse(b"\xb2\x03\x09ab\x01cd") == [Record(9, b"ab"), Record(1, b"cd")]


@pytest.mark.parametrize("code", [0xBF])
def test_reserved_code_ends_the_frame_or_its_delimited_record(code: int) -> None:
    assert parse(bytes((code,)) + b"\x01ab") == [Stray("reserved", 4)]
    assert parse(b"\xb2\x02" + bytes((code, 1)) + b"\x01ab") == [
        Stray("reserved", 2),
        Record(1, b"ab"),
    ]


def test_length_of_nothing_is_nothing() -> None:
    assert parse(b"\xb2\x00\x01ab") == [Record(1, b"ab")]
    assert parse(b"\xb2\x00") == []


@pytest.mark.parametrize("frame", [b"\xb2", b"\xb2\x01", b"\xb2\x05\x01abc", b"\xb2\xff\x01ab"])
def test_length_beyond_the_end_is_truncated(frame: bytes) -> None:
    assert parse(frame) == [Stray("truncated", len(frame))]


def test_length_inside_of_a_delimited_record_is_content_or_reserved() -> None:
    assert parse(b"\xb2\x04\x02\xb2\x01\x01") == [Record(2, b"\xb2\x01\x01")]
    assert parse(b"\xb2\x03\xb2\x01\x01") == [Stray("reserved", 3)]


def test_prefixes_mark_deletes_and_encodings() -> None:
    assert parse(b"\xb3\x01\x02x") == [Record(1, b"", Prefixes(delete=True)), Record(2, b"x")]
    assert parse(b"\xb4\x05\x02{}") == [Record(2, b"{}", Prefixes(encoding="application/json"))]
    assert parse(b"\xb4\xff\x03a/b\x02x") == [Record(2, b"x", Prefixes(encoding="a/b"))]
    both = Prefixes(delete=True, encoding="application/json")
    assert parse(b"\xb4\x05\xb3\x01") == [Record(1, b"", both)]


@pytest.mark.parametrize(
    "frame", [b"\xb3", b"\xb4", b"\xb4\x05", b"\xb4\xfe\x02x", b"\xb4\xff\x09abc", b"\xb4\xff\x00"]
)
def test_prefix_without_its_record_is_truncated(frame: bytes) -> None:
    assert parse(frame) == [Stray("truncated", len(frame))]


def test_payload_that_claims_more_than_there_is_ends_with_the_frame() -> None:
    assert parse(b"\x03abc") == [Record(3, b"abc")]


def test_empty_frame_and_padding_hold_nothing() -> None:
    assert parse(b"") == parse(bytes(64)) == []


@given(st.binary(max_size=600))
def test_any_bytes_are_taken_apart_and_accounted_for(frame: bytes) -> None:
    items = parse(frame)
    assert len(items) <= len(frame)
    # Only what ends the frame, or what LEN delimits, is a stray.
    lengths = frame.count(Control.LEN)
    assert sum(isinstance(item, Stray) for item in items) <= lengths + 1


@given(
    st.lists(
        st.one_of(
            st.sampled_from(SAID[2:]).map(lambda control: control.encode()),
            st.binary(max_size=20).map(lambda content: b"\x02" + content),
            st.just(b"\x01ab"),
        ),
        max_size=20,
    )
)
def test_delimited_records_come_back_in_their_order(pieces: list[bytes]) -> None:
    frame = b"".join(
        piece if piece[0] > 0xAF or piece[0] == 1 else bytes((Control.LEN, len(piece))) + piece
        for piece in pieces
    )
    items = parse(frame)
    records = [
        bytes((item.stream_id,)) + item.content for item in items if isinstance(item, Record)
    ]
    assert records == [piece for piece in pieces if piece[0] <= 0xAF]
    assert not [item for item in items if isinstance(item, Stray)]


@given(st.integers(1, 254), st.integers(0, 0x3FFF))
def test_an_acknowledgement_of_a_dense_block_names_its_source_in_a_broadcast(
    address: int, mark: int
) -> None:
    named, bare = DenseAck(address, mark), DenseAck(0, mark)
    assert len(bare.encode()) == 3
    assert parse(named.encode() + bytes(1)) == [named]
    assert list(parse_frame(bare.encode() + b"\x02x", measure, CONTROLS, unicast=True)) == [
        bare,
        Record(2, b"x"),
    ]


def test_an_acknowledgement_of_a_dense_block_that_is_cut_off_is_read_no_further() -> None:
    for size in (1, 2, 3):
        (item,) = parse(DenseAck(9, 5).encode()[:size])
        assert isinstance(item, Stray)


def test_a_dense_block_is_all_of_the_rest() -> None:
    block = b"\xc0\x01\xb2\xff"
    assert parse(b"\x01ab" + block) == [Record(1, b"ab"), DenseBlock(block)]
    assert parse(Tag(1).encode() + b"\xb2\x02\x02x" + block) == [
        Tag(1),
        Record(2, b"x"),
        DenseBlock(block),
    ]
