"""`zacoustic sim`: one seed, one trace; the result as a table and as JSON."""

import json
from pathlib import Path
from typing import Any

import pytest

from zacoustic.cli import main

SCENARIO = """{ channel: "none",
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, position: [1500, 0, 10] } ],
  traffic: [ { node: 2, topic: "a/b", every_s: 10, size_bytes: 20, jitter_s: 2 } ] }"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "water.json5"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


def result(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    return told


def test_one_seed_gives_one_trace(
    scenario: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    digests = []
    for seed in ("7", "7", "8"):
        assert main(["sim", str(scenario), "--seed", seed, "--until", "300", "--json"]) == 0
        digests.append(result(capsys)["digest"])
    assert digests[0] == digests[1] != digests[2]


def test_the_trace_is_lines_that_decode_reads(
    scenario: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    trace = tmp_path / "trace.jsonl"
    assert main(["sim", str(scenario), "--until", "60", "--trace", str(trace)]) == 0
    assert "a/b" in capsys.readouterr().out
    records = [json.loads(line) for line in trace.read_text(encoding="utf-8").splitlines()]
    assert {"transmit", "receive"} <= {record["what"] for record in records}
    with trace.open(encoding="utf-8") as lines:
        monkeypatch.setattr("sys.stdin", lines)
        assert main(["decode"]) == 0
    assert "HELLO" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--until", "0"], "--until 0; allowed: seconds, above 0"),
        (["--until", "nan"], "--until nan; allowed"),
        (["--trace", "/nowhere/at/all"], "--trace /nowhere/at/all: "),
        (["--seed", "x"], "--seed"),
    ],
)
def test_a_wrong_argument_is_one_line(
    arguments: list[str], expected: str, scenario: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", str(scenario), *arguments]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("written", "instead", "expected"),
    [
        ("traffic:", "trafic:", "trafic"),
        ("node: 2", "node: 9", "allowed: 1, 2"),
        ("every_s: 10", "every_s: 0", "every_s"),
        ('channel: "none"', 'channel: "tea"', "sea"),
    ],
)
def test_a_wrong_scenario_is_one_line_with_file_and_what_is_allowed(
    written: str,
    instead: str,
    expected: str,
    scenario: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    scenario.write_text(SCENARIO.replace(written, instead), encoding="utf-8")
    assert main(["sim", str(scenario)]) == 2
    error = capsys.readouterr().err
    assert "water.json5" in error
    assert expected in error
    assert error.count("\n") == 1
