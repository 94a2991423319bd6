"""The verbs, and what they say of files that are none."""

import json
from pathlib import Path

import msgspec
import pytest

from tests.gateway.networks import free_port, zenoh_router
from tests.recording.memory import BEGAN_NS
from zacoustic.app.cli import main
from zacoustic.run.recording.channels import SENT, FrameRecord, frames_channel
from zacoustic.run.recording.writing import RecordingFile


def said(capsys: pytest.CaptureFixture[str]) -> str:
    captured = capsys.readouterr()
    return captured.out + captured.err


@pytest.mark.parametrize(
    "verb", [["replay"], ["replay", "--check"], ["replay", "--what-if"], ["report"], ["decode"]]
)
def test_what_is_no_recording_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], verb: list[str]
) -> None:
    text = tmp_path / "a.json"
    text.write_text("{}")
    assert main([*verb, str(text)]) == 2
    assert "no MCAP file" in said(capsys)
    assert main([*verb, str(tmp_path / "none.mcap")]) == 2
    assert "No such file" in said(capsys)


@pytest.mark.parametrize(
    ("verb", "why"),
    [
        (["replay", "--check"], "no engine was recorded"),
        (["replay", "--what-if"], "nothing of a gateway or an engine is in it"),
        (["report"], "nothing of a gateway or an engine is in it"),
        (["decode"], "no frames in it"),
    ],
)
def test_of_a_recording_with_nothing_in_it_nothing_can_be_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], verb: list[str], why: str
) -> None:
    empty = RecordingFile(tmp_path / "a.mcap")
    empty.close()
    assert main([*verb, str(empty.path)]) == 2
    assert why in said(capsys)
    (tmp_path / "b.mcap").write_bytes(empty.path.read_bytes()[:20])
    assert main([*verb, str(tmp_path / "b.mcap")]) == 2
    assert why in said(capsys)


def test_a_recorded_network_has_no_engines_to_ask_what_if(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = frames_only(tmp_path)
    assert main(["replay", "--what-if", str(path)]) == 2
    assert "no engine was recorded in it" in said(capsys)


def test_a_recording_that_ends_early_is_read_as_far_as_it_goes_and_that_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    path = frames_only(tmp_path)
    path.write_bytes(path.read_bytes()[:-40])
    assert main(["decode", str(path)]) == 0
    assert "TAG epoch 7" in said(capsys)
    assert [record.message for record in caplog.records] == [f"{path} ends early: it is cut off"]
    assert main(["report", str(path)]) == 0
    assert f"{path} ends early" in said(capsys)


def test_decode_takes_one_recording_and_knows_a_file_from_a_frame(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = frames_only(tmp_path)
    assert main(["decode", str(path), "b10007"]) == 2
    assert "allowed: one recording, or frames" in said(capsys)
    assert main(["decode", str(path), "--source", "2"]) == 2
    assert "no frames of node 2 in it" in said(capsys)
    assert main(["decode", "trial.mcap"]) == 2
    assert "trial.mcap: No such file" in said(capsys)


def frames_only(folder: Path) -> Path:
    """Make a recording of a network: it has a frame of node 1, and no engine."""
    file = RecordingFile(folder / "frames.mcap")
    frame = FrameRecord(
        direction=SENT, node=1, source=1, destination=255, size_bytes=3,
        frame=bytes.fromhex("b10007"), at=0,
    )  # fmt: skip
    file.put(frames_channel(1), BEGAN_NS, msgspec.json.encode(frame))
    file.close()
    return file.path


def test_record_ends_after_its_time_and_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with zenoh_router() as port:
        place = ["--connect", f"tcp/127.0.0.1:{port}", "--key", "a/**", "--for", "0.05", "--json"]
        assert main(["record", "-o", str(tmp_path / "a.mcap"), *place]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out) == {
        "file": str(tmp_path / "a.mcap"), "messages": {}, "dropped": 0, "failure": "", "gaps": 0,
    }  # fmt: skip
    assert "a/**, @acoustic/** into" in captured.err


def test_record_without_a_router_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nowhere = f"tcp/127.0.0.1:{free_port()}"
    path = str(tmp_path / "a.mcap")
    assert main(["record", "-o", path, "--connect", nowhere, "--for", "1"]) == 1
    assert nowhere in said(capsys)
    assert main(["record", "-o", path, "--for", "-1"]) == 2
    assert "--for" in said(capsys)
