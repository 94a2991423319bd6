"""The verbs, and what they say of files that are none."""

import json
from pathlib import Path

import pytest

from tests.gateway.islands import free_port, zenoh_router
from zacoustic.cli import main
from zacoustic.recording.writing import RecordingFile


def said(capsys: pytest.CaptureFixture[str]) -> str:
    captured = capsys.readouterr()
    return captured.out + captured.err


@pytest.mark.parametrize("verb", [["replay"], ["replay", "--check"], ["report"]])
def test_what_is_no_recording_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], verb: list[str]
) -> None:
    text = tmp_path / "a.json"
    text.write_text("{}")
    assert main([*verb, str(text)]) == 2
    assert "no MCAP file" in said(capsys)
    assert main([*verb, str(tmp_path / "none.mcap")]) == 2
    assert "No such file" in said(capsys)


def test_a_recording_without_engines_cannot_be_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    RecordingFile(tmp_path / "a.mcap").close()
    assert main(["replay", str(tmp_path / "a.mcap"), "--check"]) == 2
    assert "no engine was recorded" in said(capsys)


def test_record_ends_after_its_time_and_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with zenoh_router() as port:
        place = ["--connect", f"tcp/127.0.0.1:{port}", "--key", "a/**", "--for", "0.05", "--json"]
        assert main(["record", "-o", str(tmp_path / "a.mcap"), *place]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out) == {
        "file": str(tmp_path / "a.mcap"), "messages": {}, "dropped": 0, "failure": "",
    }  # fmt: skip
    assert "a/**, @acoustic/** into" in captured.err


def test_record_without_a_router_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nowhere = f"tcp/127.0.0.1:{free_port()}"
    path = str(tmp_path / "a.mcap")
    assert main(["record", "-o", path, "--connect", nowhere, "--for", "1"]) == 1
    assert nowhere in said(capsys)
    assert main(["record", "-o", path, "--for", "-1"]) == 2
    assert "--for" in said(capsys)
