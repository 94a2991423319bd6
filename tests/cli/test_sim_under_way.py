"""What is under way when a simulation ends is not lost."""

import json
from pathlib import Path

import pytest

from zacoustic.app.cli import main

SCENARIO = """{
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, position: [1400, 0, 10] } ],
  config: "fleet.json5",
  traffic: [
    { node: 2, topic: "photo", every_s: 9000, first_s: 10, size_bytes: 20000 },
    { node: 2, topic: "nav", every_s: 50, first_s: 49.5, size_bytes: 8 } ] }"""
FLEET = """{ plugins: { acoustic: { address: 1,
  nodes: [ { address: 1, name: "shore" }, { address: 2, name: "auv1" } ],
  streams: [
    { id: 1, topic: "photo", publishers: [2], subscribers: [1], reliability: "reliable",
      priority: "background" },
    { id: 2, topic: "nav", publishers: [2], subscribers: [1] } ] } } }"""


def test_a_large_and_a_new_sample_are_under_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "water.json5").write_text(SCENARIO)
    (tmp_path / "fleet.json5").write_text(FLEET)
    assert main(["sim", str(tmp_path / "water.json5"), "--until", "100", "--json"]) == 0
    photo, nav = json.loads(capsys.readouterr().out)["streams"]
    assert (photo["expected"], photo["delivered"], photo["under_way"]) == (1, 0, 1)
    assert (nav["expected"], nav["delivered"], nav["under_way"]) == (2, 1, 1)
