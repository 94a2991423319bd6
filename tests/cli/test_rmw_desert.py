"""`check` and `decode` for a link on which rmw_desert is spoken."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.core.rmw_desert.vectors import read_vectors
from zacoustic.app.cli import main
from zacoustic.app.tools.inspect.decode.decoder import FrameDecoder
from zacoustic.config import read_config
from zacoustic.core.streams.wireprofile import WireProfile

EXAMPLE = Path(__file__).parents[2] / "examples" / "09_rmw_desert.json5"
VECTORS = {vector.name: vector for vector in read_vectors()}
TWIST = VECTORS["twist_id4"].packet


def test_check_shows_the_packets_and_what_is_lost(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "check", str(EXAMPLE)]) == 0
    shown = capsys.readouterr().out
    assert "wire rmw_desert: sizes are those of its packets" in shown
    assert " 4  topic     turtle1/cmd_vel  geometry_msgs/msg/Twist" in shown
    assert "24–36" in shown
    assert "Twist.linear.x is a float64, and crosses in single precision" in shown
    assert "forgets" not in shown
    assert main(["config", "check", str(EXAMPLE), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["wire"] == "rmw_desert"
    rows = {(row["stream_id"], row["kind"]): row for row in report["streams"]}
    assert (rows[4, "topic"]["smallest_bytes"], rows[4, "topic"]["largest_bytes"]) == (24, 36)
    assert rows[5, "response"]["smallest_bytes"] == 10


def written(tmp_path: Path, *fields: dict[str, Any]) -> str:
    section = {
        "address": 1,
        "links": [{"locator": "desert/127.0.0.1:4000", "wire": "rmw_desert"}],
        "types": [{"name": "T", "fields": fields}],
        "streams": [{"id": 7, "topic": "t", "type": "T"}],
    }
    path = tmp_path / "t.json5"
    path.write_text(json.dumps({"plugins": {"acoustic": section}}), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize(
    ("field", "note"),
    [
        ({"type": "uint8", "max_length": 61}, ""),
        ({"type": "uint8", "max_length": 62}, "topic: what has more than 64 items or 255 bytes"),
        ({"type": "float32", "length": 63}, "even the smallest T is too large"),
        ({"type": "string"}, "topic: what has more than 64 items or 255 bytes"),
        ({"type": "bytes", "max_length": 70}, "topic: what has more than 64 items or 255 bytes"),
        ({"type": "bool", "max_length": 3}, "T.f is a sequence of booleans: it is read, and nev"),
    ],
)
def test_check_notes_what_its_receiver_cuts(
    field: dict[str, Any], note: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", "check", written(tmp_path, {"name": "f", **field})]) == 0
    notes = [line for line in capsys.readouterr().out.splitlines() if line.startswith("note:")]
    assert len(notes) == bool(note)
    assert all(note in line for line in notes)


def test_decode_reads_packets_by_the_configuration(capsys: pytest.CaptureFixture[str]) -> None:
    frames = [TWIST.hex(), VECTORS["req_setpen"].packet.hex(), "999902030555", "00", "9999"]
    assert main(["decode", "--config", str(EXAMPLE), *frames]) == 0
    lines = capsys.readouterr().out.splitlines()[1::2]
    assert lines[0].startswith('  stream 4 turtle1/cmd_vel: {"linear": {"x": 2.0, "y": 0.0')
    assert lines[1].startswith("  stream 5 turtle1/set_pen, request of call 500: ")
    assert lines[2].startswith("  STRAY 0305: the packet ends inside its head")
    assert lines[3].startswith("  STRAY 00: the packet ends")
    assert lines[4] == "  STRAY 2 bytes: the packet is not complete yet"


def test_decode_reads_packets_without_a_configuration(capsys: pytest.CaptureFixture[str]) -> None:
    beacon, request = VECTORS["discovery_beacon"], VECTORS["discovery_request"]
    frames = [TWIST.hex(), (beacon.packet + request.packet).hex()]
    assert main(["decode", "--wire", "rmw_desert", *frames]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "  stream 4: [2.0, 0.0, 0.0, 0.0, 0.0, 1.7999999523162842]"
    assert lines[3:5] == [
        "  /discovery: /talker: publisher /turtle1/pose turtlesim/msg/Pose",
        "  /discovery_request: who is there?",
    ]


def test_a_packet_in_pieces_is_put_together_by_sender() -> None:
    decoder = FrameDecoder(read_config(EXAMPLE).table)
    (first,) = decoder.decode(TWIST[:9], source=1)
    assert first.fault == "incomplete"
    (other,) = decoder.decode(VECTORS["turtlesim_pose"].packet, source=2)
    (second,) = decoder.decode(TWIST[9:], source=1)
    assert (other.stream_id, second.stream_id, second.name) == (3, 4, "turtle1/cmd_vel")
    (alone,) = decoder.decode(VECTORS["twist_id4"].payload)
    assert alone.value == second.value


@given(st.lists(st.binary(max_size=60), max_size=6))
def test_no_bytes_harm_the_words(frames: list[bytes]) -> None:
    for decoder in (
        FrameDecoder(read_config(EXAMPLE).table),
        FrameDecoder(wire=WireProfile.RMW_DESERT),
    ):
        for frame in frames:
            assert all(item.text for item in decoder.decode(frame))
