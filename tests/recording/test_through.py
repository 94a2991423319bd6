"""Yesterday's inputs into today's engines."""

import json
from pathlib import Path

import pytest

from tests.recording.smalltrial import FLEET
from zacoustic.app.cli import main
from zacoustic.app.tools.design.sim.recorder import recorded_to
from zacoustic.app.tools.inspect.recordings.replaying.otherwise import replay_through
from zacoustic.testing.scenarios import draw_scenario, run_scenario


def through(
    trial: Path, config: str, capsys: pytest.CaptureFixture[str]
) -> list[dict[str, object]]:
    file = trial.with_name("today.json5")
    file.write_text(config, encoding="utf-8")
    capsys.readouterr()
    assert main(["replay", str(trial), "--through", str(file), "--json"]) == 0
    found: list[dict[str, object]] = json.loads(capsys.readouterr().out)
    return found


def test_the_same_configuration_makes_the_same_frames(
    trial: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for life in through(trial, FLEET, capsys):
        assert life["first_difference"] == ""
        assert life["same_frames"] == life["frames_now"] == life["frames_then"]
        assert life["samples_now"] == life["samples_then"]
        assert life["same_table"]


def test_scenarios_through_their_own_configuration_make_the_same_frames(tmp_path: Path) -> None:
    for seed in (2, 7):
        path = tmp_path / f"{seed}.mcap"
        with recorded_to(path) as recorder:
            assert recorder is not None
            run_scenario(draw_scenario(seed), (), build=recorder.make)
        for life in replay_through(path, {}):
            assert life.first_difference == ""
            assert life.same_frames == life.frames_then == life.frames_now


def test_what_is_not_in_the_digest_changes_frames_and_not_what_arrives(
    trial: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slower = FLEET.replace('topic: "auv1/raw"', 'topic: "auv1/raw", min_interval_s: 200')
    shore, auv = through(trial, slower, capsys)
    assert shore["same_table"]
    assert auv["same_table"]
    assert shore["samples_now"] == shore["samples_then"], "the frames off the water are the same"
    assert auv["bytes_now"] < auv["bytes_then"]  # type: ignore[operator]
    assert "was" in str(auv["first_difference"])


def test_streams_that_differ_are_refused_and_the_others_arrive(
    trial: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    finer = FLEET.replace("step: 0.1", "step: 0.01")
    shore, _ = through(trial, finer, capsys)
    assert not shore["same_table"]
    assert shore["differing"] == ["auv1/nav"]
    then, now = shore["samples_then"], shore["samples_now"]
    assert isinstance(then, dict)
    assert isinstance(now, dict)
    assert then["auv1/nav"] > 20
    assert "auv1/nav" not in now
    # The recorded frames stay as they are: behind a record of the other stream nothing is read.
    assert then["auv1/raw"] / 2 < now["auv1/raw"] <= then["auv1/raw"]


def test_commands_that_make_no_sense_any_more_are_counted(
    trial: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    without = FLEET.replace('             { id: 11, topic: "auv1/raw" },\n', "")
    assert without != FLEET
    _, auv = through(trial, without, capsys)
    assert auv["refused"] == {"UnknownStreamError": 21}


def test_people_get_a_table(trial: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["replay", str(trial), "--through", str(trial.with_name("fleet.json5"))]) == 0
    said = capsys.readouterr().out
    assert "every frame is the same, byte for byte" in said
    assert "auv1/nav" in said
