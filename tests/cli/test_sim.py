"""`zacoustic sim`: one seed, one trace; the result as a table and as JSON."""

import json
import re
from pathlib import Path
from typing import Any

import msgspec
import pytest

from zacoustic.app.cli import main
from zacoustic.channel.faults.blackout import BlackoutSpec
from zacoustic.channel.faults.faults import FaultSpec
from zacoustic.channel.faults.loss import LossSpec
from zacoustic.channel.faults.nodefaults import ClockSpec, CrashSpec, JournalSpec
from zacoustic.channel.scenario import Scenario
from zacoustic.channel.traffic import TrafficSpec

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
        (["--until", "0"], "--until 0; allowed: above 0"),
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
        ('channel: "none"', "plugins: {}", "it looks like the config of a node"),
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
    recording = scenario.parent / "trial.mcap"
    assert main(["sim", str(scenario), "--record", str(recording)]) == 2
    error = capsys.readouterr().err
    assert "water.json5" in error
    assert expected in error
    assert error.count("\n") == 1
    assert not recording.exists()


FAULTS = """{ channel: "none", seed: 3,
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, position: [1500, 0, 10] } ],
  faults: { duplicate: 0.2, duplicate_after_s: [0, 2], jitter_s: 0.2,
            blackouts: [ { node: 1, from_s: 100, to_s: 200, every_s: 1000 } ],
            crashes: [ { node: 2, at_s: [900], restart_after_s: 60 },
                       { node: 1, every_s: 600 } ] },
  traffic: [ { node: 2, topic: "a/b", every_s: 10, size_bytes: [10, 20], late_after_s: 0.5 },
             { node: 1, topic: "c", every_s: 60, pattern: "random", burst: 2, size_bytes: 4,
               until_s: 1800 } ] }"""


def test_what_goes_wrong_is_in_the_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.json5"
    path.write_text(FAULTS, encoding="utf-8")
    assert main(["sim", str(path), "--until", "3600", "--json"]) == 0
    told = result(capsys)
    assert told["crashes"]["2"] == 1
    assert told["crashes"]["1"] > 1
    assert {"blackout", "node_down"} <= set(told["losses"])
    ab, c = told["streams"]
    # 6 of them while its node was down.
    assert (ab["published"], ab["refused"], ab["expected"]) == (361, 6, 355)
    assert 250 < ab["delivered"] < 345
    assert ab["duplicate"] > 20
    assert ab["late"] == ab["delivered"]  # 1 s under way
    assert 1.0 < ab["p50_s"] <= ab["p95_s"] <= ab["p99_s"]
    assert 30 < c["published"] < 100
    by_cause = told["airtime_by_cause_s"]
    assert sum(by_cause.values()) == pytest.approx(told["airtime_s"])
    assert {"payload", "header", "hello"} <= set(by_cause)
    assert main(["sim", str(path)]) == 0
    text = capsys.readouterr().out
    assert "sound by cause: " in text
    assert "crashes: " in text


def test_a_config_is_used_with_its_types_and_calls_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "fleet.json5").write_text(
        """{ plugins: { acoustic: { nodes: [ { address: 1, name: "a" }, { address: 2, name: "b" } ],
             types: [ { name: "Nav", fields: [ { name: "depth", type: "float32", range: [0, 100],
                                                 step: 0.1 } ] } ],
             streams: [ { id: 1, topic: "{node}/nav", type: "Nav", lifespan_s: 60 },
                        { id: 2, service: "arm", server: 1 } ] } } }""",
        encoding="utf-8",
    )
    path = tmp_path / "water.json5"
    path.write_text(
        """{ channel: "none", config: "fleet.json5",
          nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, position: [150, 0, 10] } ],
          traffic: [ { node: 2, topic: "b/nav", every_s: 20, value: {}, vary: { depth: [5, 90] } },
                     { node: 2, service: "arm", every_s: 60, first_s: 10, size_bytes: 3 } ] }""",
        encoding="utf-8",
    )
    assert main(["sim", str(path), "--until", "599", "--json"]) == 0
    nav, arm = result(capsys)["streams"]
    assert (nav["published"], nav["delivered"], nav["late"], nav["duplicate"]) == (30, 30, 0, 0)
    assert (arm["published"], arm["expected"], arm["delivered"]) == (10, 10, 10)


def test_what_the_config_says_of_transmitting_holds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    access = '{ method: "tdma", slots: [1, 2], slot_s: 5, max_range_m: 1500, clock_error_s: 0.01 }'
    (tmp_path / "fleet.json5").write_text(
        """{ plugins: { acoustic: { address: 1, quiet: [ { from: "00:05", to: "00:10" } ],
          links: [ { locator: "sim/127.0.0.1:7000", access: ACCESS } ],
          nodes: [ { address: 1, name: "shore" }, { address: 2, name: "auv" } ],
          streams: [ { id: 1, topic: "a/b", publishers: [2] } ] } } }""".replace("ACCESS", access),
        encoding="utf-8",
    )
    path = tmp_path / "water.json5"
    path.write_text(SCENARIO.replace("traffic:", 'config: "fleet.json5", traffic:'), "utf-8")
    trace = tmp_path / "trace.jsonl"
    assert main(["sim", str(path), "--until", "900", "--json", "--trace", str(trace)]) == 0
    capsys.readouterr()
    records = [json.loads(line) for line in trace.read_text(encoding="utf-8").splitlines()]
    instants = [each["at"] / 1e9 for each in records if each["what"] == "transmit"]
    assert len(instants) > 20
    assert not [at_s for at_s in instants if 300 <= at_s < 600]
    # Two slots of 5 s each, from midnight on: node 2 has the second one.
    turns = [each for each in records if each["what"] == "transmit" and each["node"] == 2]
    assert all(each["at"] / 1e9 % 10 >= 5 for each in turns)


def test_somebody_looks_at_on_demand_topics_and_heartbeats_are_sent(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "fleet.json5").write_text(
        """{ plugins: { acoustic: { address: 1, heartbeat_s: 30,
          nodes: [ { address: 1, name: "shore" }, { address: 2, name: "auv" } ],
          streams: [ { id: 1, topic: "a/b", publishers: [2], forward: "on_demand" } ] } } }""",
        encoding="utf-8",
    )
    path = tmp_path / "water.json5"
    crashes = "faults: { crashes: [ { node: 1, at_s: [100], restart_after_s: 10 } ] },"
    path.write_text(
        SCENARIO.replace("traffic:", f'config: "fleet.json5", {crashes} traffic:'), encoding="utf-8"
    )
    trace = tmp_path / "trace.jsonl"
    assert main(["sim", str(path), "--until", "600", "--json", "--trace", str(trace)]) == 0
    (stream,) = result(capsys)["streams"]
    assert stream["delivered"] >= 50
    records = [json.loads(line) for line in trace.read_text(encoding="utf-8").splitlines()]
    sent = [each["frame"] for each in records if each["what"] == "transmit" and each["node"] == 1]
    assert sent.count("00") >= 10


def test_a_scenario_is_told_again_by_its_seed(capsys: pytest.CaptureFixture[str]) -> None:
    told = []
    for seed in ("2", "2", "3"):
        main(["sim", "--random", seed, "--json"])
        told.append(result(capsys))
    assert told[0] == told[1] != told[2]
    assert told[0]["simulation"]["seed"] == 2
    assert main(["sim", "--random", "2"]) == (1 if told[0]["violations"] else 0)
    assert "of calm" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], "SCENARIO --random is required"),
        (["--random", "1", "--seed", "2"], "--seed with --random"),
        (["--random", "1", "--until", "2"], "--until with --random"),
    ],
)
def test_a_scenario_has_its_own_seed_and_length(
    arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sim", *arguments]) == 2
    assert expected in capsys.readouterr().err


DOCS = Path(__file__).parents[2] / "docs"


def test_the_scenario_of_the_page_runs_with_the_config_of_its_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for page, name in (("config.md", "fleet.json5"), ("sim.md", "water.json5")):
        text = (DOCS / page).read_text(encoding="utf-8")
        block = text.partition("```json5\n")[2].partition("```")[0]
        (tmp_path / name).write_text(block, encoding="utf-8")
    assert main(["sim", str(tmp_path / "water.json5"), "--json"]) == 0
    told = result(capsys)
    assert [stream["name"] for stream in told["streams"]] == ["auv1/nav", "auv1/arm"]
    assert told["crashes"]["2"] == 2


@pytest.mark.parametrize(
    "record",
    [Scenario, FaultSpec, BlackoutSpec, CrashSpec, ClockSpec, JournalSpec, TrafficSpec, LossSpec],
)
def test_the_page_names_every_key(record: type[msgspec.Struct]) -> None:
    text = (DOCS / "sim.md").read_text(encoding="utf-8")
    keys = [field.encode_name for field in msgspec.structs.fields(record)]
    assert [key for key in keys if not re.search(rf"\b{key}\b", text)] == []
