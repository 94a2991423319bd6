"""Recordings in MCAP where JSON lines are read: fit and bench."""

import json
import random
from pathlib import Path

import pytest

from tests.recording.test_exact import survey
from tests.virtual.fleet import line
from zacoustic.app.tools.design.sim.recorder import recorded_to
from zacoustic.app.tools.design.telemetry.recording import Recordings, read_recordings
from zacoustic.run.recording.channels import value_channel
from zacoustic.run.recording.writing import RecordingFile
from zacoustic.testing.virtual import VirtualNetwork


def read(path: Path) -> Recordings:
    return read_recordings([str(path)], survey(), only_dense=True, window_s=10.0)


def test_a_simulation_is_read_as_its_telemetry_in_json_lines(tmp_path: Path) -> None:
    rng = random.Random(3)
    rows = [
        {
            "depth": round(rng.uniform(0, 90), 2),
            "heading": rng.uniform(0, 360),
            "mode": rng.choice(("idle", "survey")),
            "note": rng.choice((None, b"abc")),
        }
        for _ in range(50)
    ]
    with recorded_to(tmp_path / "a.mcap") as recorder:
        assert recorder is not None
        network = VirtualNetwork(line(0, 500), survey(), build=recorder.make)
        for number, row in enumerate(rows):
            network.at(5.0 * number, lambda row=row: network.publish(2, 1, row))  # type: ignore[misc]
        network.run(until_s=300)
    lines = [
        {"t": 5.0 * number, "s": "auv/nav", "v": {**row, "note": "YWJj" if row["note"] else None}}
        for number, row in enumerate(rows)
    ]
    (tmp_path / "a.jsonl").write_text("\n".join(map(json.dumps, lines)), encoding="utf-8")
    found, expected = read(tmp_path / "a.mcap"), read(tmp_path / "a.jsonl")
    assert [mission.samples for mission in found.missions] == [
        mission.samples for mission in expected.missions
    ]
    assert found.counts[1].samples == 50
    assert found.notes == []


def test_a_recording_of_the_shore_alone_has_what_arrived(tmp_path: Path) -> None:
    file = RecordingFile(tmp_path / "a.mcap", waits=True)
    stream = survey().by_id(1)
    for topic in ("/1/received/auv/nav", "/3/received/auv/nav"):
        for number in range(3):
            value = {"depth": float(number), "heading": 1.0, "mode": "idle"}
            file.put(value_channel(topic, stream), number * 10**9, json.dumps(value).encode())
    file.close()
    found = read(tmp_path / "a.mcap")
    assert found.counts[1].samples == 3
    assert [value["depth"] for _, _, value in found.missions[0].samples] == [0.0, 1.0, 2.0]


@pytest.mark.parametrize("topic", ["/auv/nav", "auv/nav", "nav"])
def test_topics_of_other_programs_are_found_by_their_names(tmp_path: Path, topic: str) -> None:
    file = RecordingFile(tmp_path / "a.mcap", waits=True)
    for number in range(4):
        value = {"depth": 1, "heading": 2, "mode": 1, "note": None}
        file.put(value_channel(topic, survey().by_id(1)), number, json.dumps(value).encode())
    file.put(value_channel("/2/frames", survey().by_id(1)), 5, b'{"x": 1}')
    file.close()
    found = read(tmp_path / "a.mcap")
    assert found.counts[1].samples == 4
    assert found.notes == []
