"""`zacoustic decode`: frames in words, from arguments and from standard input."""

import io
import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.cli.dive import section, write_config
from tests.golden.tables import bytes_table, carried_table
from tests.golden.vectors import vectors
from zacoustic.app.cli import main
from zacoustic.app.tools.inspect.decode.decoder import FrameDecoder, decode_frame
from zacoustic.config import config_from_mapping, read_config
from zacoustic.core.engine.events import CallFailure
from zacoustic.core.streams.table import AGE_FIELD, StreamTable
from zacoustic.core.values.dense import DenseCodec, DenseSample, Listener, Speaker
from zacoustic.core.wire.agreement import WIRE_VERSION, Ask, Confirm, Hello, TableRow, Tag
from zacoustic.core.wire.calls import NAMED, CallKind, encode_call_byte, encode_error, encode_name
from zacoustic.core.wire.frame import DenseAck

FLEET = Path(__file__).parents[2] / "zacoustic" / "app" / "tools" / "demo" / "fleet.json5"
TABLE = read_config(FLEET).table


DENSE = config_from_mapping(section(), source="made up").table


def blocks(count: int) -> list[bytes]:
    """Dense strings of node 2, each but the first with a reference to the one before it."""
    types = {each.stream_id: each.dense_type for each in DENSE if each.dense_type is not None}
    codec = DenseCodec(types, digest=DENSE.digest)
    speaker, listener, made = Speaker(codec), Listener(codec), []
    for number in range(count):
        nav = {"lat": 43.1 + number * 1e-5, "depth": 10, "heading": 90, "speed": 1}
        status = {"mode": "survey", "leak": False, "battery": 90, AGE_FIELD: 15}
        samples = [DenseSample(10, nav), DenseSample(11, status)]
        encoded = speaker.encode(samples, 60, {1})
        assert encoded is not None
        speaker.sent(encoded)
        listener.decode(encoded.frame)
        assert listener.mark is not None
        speaker.acknowledged(1, listener.mark)
        made.append(encoded.frame)
    return made


@pytest.fixture
def table() -> StreamTable:
    return TABLE


def nav(table: StreamTable) -> bytes:
    """A record of navigation, 1.5 s old."""
    value = {"count": 7, "lat": 43.1, "lon": 5.9, "depth": 12.3, "heading": 90.0}
    return bytes((10, 15)) + table.by_id(10).codec.encode(value)


def test_controls_are_told_with_and_without_a_table(table: StreamTable) -> None:
    frame = (
        Hello(WIRE_VERSION, 77, table.digest).encode()
        + Tag(77).encode()
        + Confirm(2, 5).encode()
        + Ask(2, 10).encode()
        + TableRow(77, 10, bytes(4)).encode()
    )
    kinds = [item.kind for item in decode_frame(frame)]
    assert kinds == ["hello", "tag", "confirm", "ask", "table"]
    assert [item.fault for item in decode_frame(frame, table)] == [""] * 5
    assert "is not in my table" in decode_frame(frame)[-1].text


def test_a_hello_of_another_table_says_so(table: StreamTable) -> None:
    (item,) = decode_frame(Hello(WIRE_VERSION, 77, b"\x01\x02\x03\x04").encode(), table)
    assert item.fault == f"another table than {table.digest.hex()}"


def test_values_are_decoded_with_a_table(table: StreamTable) -> None:
    (item,) = decode_frame(nav(table), table, source=2)
    assert (item.kind, item.stream_id, item.name) == ("sample", 10, "auv1/nav")
    assert item.value == {"count": 7, "lat": 43.1, "lon": 5.9, "depth": 12.3, "heading": 90.0}
    assert "1.5 s old" in item.text


def test_records_that_delimit_themselves_are_told_apart_with_a_table_only(
    table: StreamTable,
) -> None:
    status = table.by_id(11).codec.encode(
        {"count": 7, "battery": 87.5, "mode": "idle", "leak": False}
    )
    frame = nav(table) + bytes((11,)) + status
    assert [item.stream_id for item in decode_frame(frame, table, source=2)] == [10, 11]
    assert decode_frame(frame, table, source=2)[1].name == "fleet/auv1/status"
    assert [item.kind for item in decode_frame(frame)] == ["record"]


def test_calls_are_told_with_their_numbers(table: StreamTable) -> None:
    request = bytes((20, encode_call_byte(CallKind.REQUEST, 9))) + table.by_id(20).codec.encode(
        {"armed": True}
    )
    (item,) = decode_frame(request, table)
    assert item.text == 'stream 20 auv1/arm, request of call 9: {"armed": true}'
    refused = bytes((20, encode_call_byte(CallKind.ERROR, 9))) + encode_error(
        CallFailure.HANDLER, "leak"
    )
    (item,) = decode_frame(refused, table)
    assert item.text == "stream 20 auv1/arm, error of call 9: handler: leak"
    head = bytes((20, encode_call_byte(NAMED, 9)))
    named = head + encode_name(CallKind.ERROR, 70) + encode_error(CallFailure.UNKNOWN, "")
    (item,) = decode_frame(named, table, source=2)
    assert item.text == "stream 20 auv1/arm, error of call 9 of a life 6 mod 64: unknown: "
    (item,) = decode_frame(head + encode_name(CallKind.CONFIRM, 70), table, source=2)
    assert item.kind == "call_confirm"
    (item,) = decode_frame(head, table, source=2)
    assert item.kind == "record"


def test_orders_are_told_whatever_is_in_the_table() -> None:
    order = bytes.fromhex("af0200030101190bb8f6f6f6f6f6")
    (item,) = decode_frame(order, TABLE, source=1)
    assert item.text.startswith("stream 175 orders, request of call 0 of node 2, 0.3 s old: ")
    assert isinstance(item.value, dict)
    assert (item.value["order"], item.value["for_s"]) == ("silence", 300.0)
    (item,) = decode_frame(bytes.fromhex("af024100f5f5190bb8f6f6f6"), TABLE, source=2)
    assert item.text.startswith("stream 175 orders, response of call 1 of node 2, 0 s old: ")


def test_what_does_not_decode_says_why(table: StreamTable) -> None:
    (item,) = decode_frame(bytes((10, 0, 0x18)), table)
    assert item.kind == "sample"
    assert item.fault
    assert "does not decode" in item.text


@given(st.binary(max_size=80), st.integers(0, 255))
def test_garbage_never_raises(frame: bytes, source: int) -> None:
    for known in (None, TABLE, DENSE):
        for item in decode_frame(frame, known, source=source):
            assert item.text
            assert "\n" not in item.text.replace("\\n", "")


def test_frames_come_as_arguments_in_any_usual_form(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["decode", "b10007", "0xb1 0x00 0x07", "B1:00:07"]) == 0
    written = capsys.readouterr().out
    assert written.count("3 bytes: b10007\n  TAG epoch 7") == 3


def test_frames_come_as_lines_of_a_trace(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = '{"at": 1, "frame": "b10007"}\n\n{"at": 2}\nb10008\n'
    monkeypatch.setattr("sys.stdin", io.StringIO(lines))
    assert main(["decode", "--json"]) == 0
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [each["frame"] for each in told] == ["b10007", "b10008"]
    assert told[0]["items"][0]["kind"] == "tag"


def test_what_is_not_hexadecimal_is_said_and_the_rest_is_decoded(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["decode", "hello", "b10007"]) == 1
    written = capsys.readouterr()
    assert written.err == "zacoustic decode: 'hello' is not hexadecimal\n"
    assert "TAG epoch 7" in written.out


def test_a_dense_block_that_stands_for_itself_is_decoded_with_a_table() -> None:
    (frame,) = blocks(1)
    (item,) = decode_frame(frame)
    assert (item.kind, item.value, item.fault) == ("dense", frame.hex(), "")
    block, nav, status = decode_frame(frame, DENSE, source=2)
    assert (block.kind, block.fault) == ("dense", "")
    assert (nav.kind, nav.stream_id, nav.name) == ("sample", 10, "auv1/nav")
    assert nav.value == {"lat": 43.1, "depth": 10.0, "heading": 90.0, "speed": 1.0}
    assert status.value == {"mode": "survey", "leak": False, "battery": 90}
    assert "auv1/status, 1.5 s old: {" in status.text


def test_packed_bytes_are_decoded_with_a_table() -> None:
    for name, line in (("packed_text", 0), ("dense_text", 1)):
        (vector,) = (each for each in vectors() if each.name == name)
        item = decode_frame(bytes.fromhex(vector.hex), bytes_table(), source=1)[line]
        assert item.value == b"INF battery: 25.9 V, 2.8 A, 79 %".hex()
        assert item.fault == ""


def test_a_dense_block_that_refers_to_a_frame_that_is_not_there_says_so() -> None:
    (item,) = decode_frame(blocks(2)[1], DENSE, source=2)
    assert item.fault == "a reference to a frame that is not held"
    assert "is not decoded: a reference to a frame that is not held" in item.text


def test_whose_dense_block_it_is_must_be_known() -> None:
    streams = [each for each in section()["streams"] if "publishers" in each]
    log = config_from_mapping(section(streams=streams), source="made up").table
    (item,) = decode_frame(b"\xff\x00", log, source=1)
    assert item.fault == "node 1 has no dense streams"


def test_references_are_known_to_who_has_seen_the_frames_before() -> None:
    first, second, third = blocks(3)
    decoder = FrameDecoder(DENSE)
    hello = Hello(WIRE_VERSION, 7, DENSE.digest).encode()
    for frame in (hello + first, second, second, hello + third):
        assert decoder.decode(frame, source=2)[-1].kind == "sample"
    restarted = Hello(WIRE_VERSION, 8, DENSE.digest).encode()
    assert decoder.decode(restarted + third, source=2)[-1].fault
    assert decoder.decode(third, source=1)[-1].fault


def test_dense_blocks_of_a_trace_are_told_apart_by_their_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet = write_config(tmp_path / "fleet.json5")
    ack = DenseAck(0, 0x1234).encode()
    lines = [
        {"node": 2, "what": "transmit", "peer": 255, "frame": blocks(1)[0].hex()},
        {"node": 1, "what": "receive", "peer": 2, "frame": blocks(1)[0].hex()},
        {"node": 1, "what": "transmit", "peer": 2, "frame": ack.hex()},
        {"node": 2, "what": "receive", "peer": 1, "frame": ack.hex()},
        {"node": 1, "what": "receive", "peer": 2, "frame": blocks(2)[1].hex()},
        {"node": 1, "what": "transmit", "peer": 255, "frame": blocks(2)[1].hex()},
    ]
    monkeypatch.setattr("sys.stdin", io.StringIO("\n".join(map(json.dumps, lines))))
    assert main(["decode", "--json", "--config", str(fleet)]) == 0
    told = [json.loads(line)["items"] for line in capsys.readouterr().out.splitlines()]
    kinds = [[item["kind"] for item in items] for items in told]
    samples = ["dense", "sample", "sample"]
    assert kinds == [samples, samples, ["dense_ack"], ["dense_ack"], samples, ["dense"]]
    assert told[2][0]["text"] == "ACK for its destination: its dense string 1234 is held here"
    assert told[5][0]["fault"] == "a reference to a frame that is not held"


def test_frames_as_arguments_are_taken_in_their_order(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet = write_config(tmp_path / "fleet.json5")
    frames = [frame.hex() for frame in blocks(3)]
    assert main(["decode", *frames, "--config", str(fleet), "--source", "2"]) == 0
    assert capsys.readouterr().out.count("auv1/nav: {") == 3


def test_a_file_of_a_fleet_is_no_nodes_and_needs_no_address(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet = write_config(tmp_path / "fleet.json5")
    section = json.loads(fleet.read_text(encoding="utf-8"))
    del section["plugins"]["acoustic"]["address"]
    fleet.write_text(json.dumps(section), encoding="utf-8")
    assert main(["decode", "--config", str(fleet), blocks(1)[0].hex(), "--source", "2"]) == 0
    assert "missing" not in capsys.readouterr().err
    # With a router that is not there: the file is read before.
    nowhere = ["--connect", "tcp/127.0.0.1:1"]
    for verb in (["record", "-o", str(tmp_path / "a.mcap")], ["topics"], ["silence"]):
        assert main([*verb, "--config", str(fleet), *nowhere]) != 0
        assert "address" not in capsys.readouterr().err


def test_messages_of_carried_topics_are_explained() -> None:
    known = {each.name: each for each in vectors() if each.name.startswith("carried_")}
    decoder = FrameDecoder(carried_table())
    said: dict[str, str] = {}
    for name, vector in known.items():
        (item,) = decoder.decode(bytes.fromhex(vector.hex), source=vector.source, unicast=True)
        assert (item.kind, item.fault) == ("carried", "")
        said[name] = item.text.partition("): ")[2]
    assert said["carried_envelope"].startswith(
        "auv1/track from node 2 to node 1, number 65541 of count 1234, all before 65538 are done, "
        'for 1408 min and 1 more hops: {"lat": 45.4,'
    )
    assert said["carried_direct"] == (
        'deep/sonar from node 2 to node 1, number 7 of count beef, text/plain: "70696e67"'
    )
    assert said["carried_delete"].endswith("for 15 min and 1 more hops, deleted")
    assert said["carried_receipt"] == (
        "RECEIPT, auv1/track from node 2 to node 1: everything before 65542 is there"
    )
    assert said["carried_refusal"].endswith("number 8: no room")
    assert said["carried_refusal_final"].endswith("its subscriber defines the topic in another way")


@given(st.binary(max_size=40), st.integers(0, 255))
def test_no_message_of_a_carried_topic_raises(message: bytes, source: int) -> None:
    sync = bytes((0xB8, 0, 1, 0, 0, 0))
    frame = sync + bytes((0xAB, 1, 0)) + message
    for items in (
        FrameDecoder(carried_table()).decode(frame, source=source, unicast=True),
        FrameDecoder(TABLE).decode(frame, source=source),
    ):
        assert items
