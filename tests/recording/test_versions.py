"""Recordings of other versions: what needs no engine reads them, and errors name both versions."""

import json
import subprocess
from pathlib import Path
from typing import Final

import msgspec
import pytest

from tests.recording.makeversion import FOLDER
from zacoustic.app.cli import main
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.run.recording import life

KEPT: Final = sorted(FOLDER.glob("*.mcap"))
NEWER: Final = "98.7.6"


class OtherRules(msgspec.Struct, kw_only=True):
    """Rules of a version with a field that the recorded ones lack."""

    loudness: int


@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_report_and_decode_read_a_recording_of_each_version(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(path), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    delivered = {
        each["name"]: (each["delivered"], each["published"]) for each in figures["streams"]
    }
    assert delivered == {"auv1/nav": (6, 7), "auv1/raw": (4, 5), "auv1/arm": (2, 2)}
    assert main(["decode", str(path)]) == 0
    said = capsys.readouterr().out
    assert said.count("bytes:") >= 33  # 20 were sent, 18 of these heard
    assert "auv1/nav" in said


def test_each_released_version_has_its_recording() -> None:
    git = subprocess.run(
        ["git", "tag", "--list", "v*"], cwd=FOLDER, capture_output=True, text=True, check=False
    )
    released = {tag.removeprefix("v") for tag in git.stdout.split()}
    assert released <= {path.stem for path in KEPT}
    assert KEPT


def test_after_a_change_of_the_rules_only_an_engine_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = KEPT[-1]
    monkeypatch.setattr(life, "TransmitRules", OtherRules)
    monkeypatch.setattr("zacoustic.run.recording.version.metadata.version", lambda _: NEWER)
    test_report_and_decode_read_a_recording_of_each_version(path, capsys)
    assert main(["report", str(path)]) == 0
    recorder = life.decode_life(first_life(path)).program
    assert f"was recorded by zacoustic {recorder}, and is read by {NEWER}" in (
        " ".join(capsys.readouterr().out.split())
    )
    assert main(["replay", str(path), "--check"]) == 2
    said = capsys.readouterr().err
    assert f"recorded by zacoustic {recorder}, read by zacoustic {NEWER}: the engine of" in said
    assert "missing required field `loudness`" in said
    assert "zacoustic report and decode need no engine" in said


def test_after_a_change_of_the_streams_frames_are_still_read(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = KEPT[-1]

    class OtherTopic(TopicSpec, kw_only=True, frozen=True, tag="other"):
        """A topic that was never recorded."""

    class OtherTable(msgspec.Struct, kw_only=True):
        streams: tuple[OtherTopic, ...]

    class OtherLife(life.Life, kw_only=True, frozen=True):
        table: OtherTable  # type: ignore[assignment]

    monkeypatch.setattr(life, "Life", OtherLife)
    assert main(["decode", str(path)]) == 0
    assert capsys.readouterr().out.count("bytes:") >= 33
    assert main(["report", str(path), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert sum(each["frames"] for each in figures["nodes"]) == 20
    assert any("the parameters of an engine cannot be read" in each for each in figures["notes"])


def first_life(path: Path) -> bytes:
    """The parameters of the first engine in a file."""
    from zacoustic.run.recording.reading import RecordingReader

    for message in RecordingReader(path):
        if message.name == "engine":
            return bytes(msgspec.msgpack.decode(message.data, type=dict[str, msgspec.Raw])["life"])
    raise AssertionError("no engine")
