"""`zacoustic codec fit`: a model out of recordings, whether it helps, and wrong lines."""

import json
import random
from pathlib import Path
from typing import Any

import pytest

from tests.cli.dive import LAT, dive, write, write_config
from zacoustic.app.cli import main
from zacoustic.config import read_config

META = '{"meta": {"vehicle": "made up"}}'


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    return write_config(tmp_path / "fleet.json5")


def fit(capsys: pytest.CaptureFixture[str], *arguments: Path | str) -> tuple[int, Any, str]:
    code = main(["codec", "fit", *map(str, arguments)])
    written = capsys.readouterr()
    return code, written.out, written.err


def test_a_model_is_written_helps_and_is_read_by_the_configuration(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recordings = [write(tmp_path / f"{seed}.jsonl.gz", [META, *dive(seed)]) for seed in (1, 2)]
    model = tmp_path / "dive.model.json"
    code, out, err = fit(
        capsys, *recordings, "--config", fleet, "--output", model, "--json"
    )  # fmt: skip
    assert (code, err) == (0, "")
    report = json.loads(out)
    assert report["helps"] is True
    assert report["notes"] == []
    nav, status, log = report["streams"]
    assert (nav["name"], nav["samples"], nav["measured"]) == ("{node}/nav", 400, 200)
    assert (status["samples"], log["samples"]) == (80, 40)
    assert log["first_bits"]["after"] < 0.7 * log["first_bits"]["before"]
    assert nav["first_bits"]["after"] < nav["first_bits"]["before"]
    assert nav["next_bits"]["before"] < nav["packed_bits"]
    alone = report["alone_bytes"]
    assert alone["after"] < alone["before"]
    read = read_config(write_config(fleet, model=model.name))
    assert read.table.model is not None
    assert read.table.model.digest.hex() == report["digest"]
    assert read.typical_bits[10] == pytest.approx(nav["next_bits"]["after"], abs=0.1)


def test_the_configuration_may_name_a_model_that_is_yet_to_come(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet = write_config(tmp_path / "fleet.json5", model="later.json")
    recording = write(tmp_path / "a.jsonl", dive(1, 60))
    code, out, _ = fit(capsys, recording, "--config", fleet, "--output", tmp_path / "later.json")
    assert code in (0, 1)
    assert "later.json: written" in out
    assert read_config(fleet).table.model is not None


def test_a_model_that_does_not_help_is_said_to(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = list(dive(1, 150))
    for line in lines[len(lines) // 2 :]:  # another vehicle, elsewhere, that stands still
        if line["s"] == "nav":
            line["v"] = [LAT + 0.09, 190, 10, -0.9]
        elif line["s"] == "status":
            line["v"] = [2, 1, 3]
        else:
            line["v"] = "WRN disk nearly full: 97 %"
    code, out, err = fit(capsys, write(tmp_path / "a.jsonl", lines), "--config", fleet)
    assert code == 1
    assert err == "zacoustic codec fit: the model does not help: do without it\n"
    assert "frames of 10 s" in out


def test_values_out_of_bounds_are_counted_and_left_out(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = list(dive(1, 40))
    lines[0] = {"t": 0, "s": "nav", "v": {"lat": LAT, "depth": 999, "heading": 1, "speed": 1}}
    lines[1] = {"t": 0, "s": "status", "v": [0, False, 150]}
    lines += [{"t": 9, "s": "sonar", "v": [1]}] * 3
    recording = write(tmp_path / "a.jsonl", lines)
    _, out, _ = fit(capsys, recording, "--config", fleet, "--json")
    report = json.loads(out)
    assert [each["samples"] for each in report["streams"]] == [39, 8, 4]
    unknown, refused, clamped = report["notes"]
    assert unknown == '"sonar", 3 samples: no dense topic of that name'
    assert "1 of 40 samples would be refused and are left out; the first: Nav.depth" in refused
    assert clamped == "auv1/status: 1 numbers outside of their range"


def test_a_dense_topic_without_a_type_is_said_to_have_nothing_of_a_fit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    streams = [
        {"id": 10, "topic": "{node}/nav", "type": "Nav", "codec": "dense"},
        {"id": 12, "topic": "auv1/log", "codec": "dense", "publishers": [2]},
    ]
    fleet = write_config(tmp_path / "fleet.json5", streams=streams)
    lines = [line for line in dive(1, 40) if line["s"] != "status"]
    _, out, _ = fit(capsys, write(tmp_path / "a.jsonl", lines), "--config", fleet)
    assert 'note: "auv1/log", 4 samples: a topic without a type\n' in out
    assert "note: auv1/log: dense but without a type, so nothing is fitted to it" in out


def test_a_recording_of_another_place_is_read_as_if_the_bounds_were_there(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recordings = [write(tmp_path / f"{lat}.jsonl", dive(1, 40, lat)) for lat in (LAT, -12.3456789)]
    _, out, _ = fit(capsys, *recordings, "--config", fleet, "--json")
    report = json.loads(out)
    assert report["streams"][0]["samples"] == 80
    (note,) = report["notes"]
    assert "-12.3457.jsonl" not in note
    assert "read as if the range were -12.4457..-12.2457, of another place" in note


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("{", "no JSON: "),
        ("7", 'int; allowed: one sample a line: {"t": seconds, "s": stream, "v": value}'),
        ('{"s": "nav", "v": [1]}', '"t" is missing; allowed: one sample a line'),
        ('{"t": 1, "s": "nav"}', '"v" is missing; allowed: '),
        ('{"t": "now", "s": "nav", "v": []}', "t: 'now'; allowed: seconds, a number"),
        ('{"t": true, "s": "nav", "v": []}', "t: True; allowed: seconds, a number"),
        ('{"t": 1, "s": null, "v": []}', "s: None; allowed: name or id of a stream"),
        (
            '{"t": 1, "s": "nav", "v": [1, 2]}',
            "v: 2 values; allowed: 4 of Nav: lat, depth, heading, speed",
        ),
        ('{"t": 1, "s": 10, "v": {"lon": 1}}', 'v: unknown field "lon"; allowed: lat, depth'),
    ],
)
def test_a_bad_line_is_named_with_what_is_allowed(
    line: str,
    expected: str,
    fleet: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    recording = write(tmp_path / "a.jsonl", [META, *dive(1, 2), line, "{"])
    code, out, err = fit(capsys, recording, "--config", fleet)
    number = 2 + len(list(dive(1, 2)))
    assert (code, out) == (2, "")
    assert f"a.jsonl: line {number}: {expected}" in err
    assert err.count("\n") == 1


def test_what_is_no_recording_is_refused(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {
        "a.mcap": (b"\x89MCAP0\r\n", "no samples of any dense topic"),
        "b.mcap": (b"{}", "b.mcap: no MCAP file"),
        "c.jsonl.gz": (b"\x1f\x8b\x08\x00damaged", "c.jsonl.gz: damaged: "),
        "d.jsonl": (b'{"t": 1, "s": "sonar", "v": 1}', "no samples of any dense topic of the"),
        "e.jsonl": (b"", "no samples of any dense topic"),
        "f.jsonl": (b'{"t": 1, "s": "nav", "v": [43.1, 1, 1, 1]}', "1 samples of dense topics"),
    }
    for name, (content, expected) in files.items():
        (tmp_path / name).write_bytes(content)
        code, _, err = fit(capsys, tmp_path / name, "--config", fleet)
        assert code == 2
        assert expected in err
        assert err.count("\n") == 1
    code, _, err = fit(capsys, tmp_path / "absent.jsonl", "--config", fleet)
    assert (code, err.count("\n")) == (2, 1)
    assert "absent.jsonl: No such file" in err


def test_wrong_arguments_are_one_line(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = write(tmp_path / "a.jsonl", dive(1, 20))
    packed = write_config(tmp_path / "packed.json5", codec="packed")
    cases: tuple[tuple[list[Path | str], str], ...] = (
        (["--config", fleet, "--window", "0"], "--window 0; allowed: above 0, 1e-06..1e+09 s"),
        (["--config", packed], "no stream is dense; allowed: topics with a type"),
        (["--config", fleet, "--output", tmp_path / "no" / "m"], "--output "),
    )
    for arguments, expected in cases:
        code, _, err = fit(capsys, recording, *arguments)
        assert code == 2
        assert expected in err
        assert err.count("\n") == 1


def test_a_name_that_may_mean_several_topics_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    streams = [{"id": n, "topic": f"auv{n}/nav", "type": "Nav", "codec": "dense"} for n in (1, 2)]
    fleet = write_config(tmp_path / "two.json5", streams=streams)
    recording = write(tmp_path / "a.jsonl", dive(1, 2))
    code, _, err = fit(capsys, recording, "--config", fleet)
    assert code == 2
    assert 'line 1: "nav" may mean auv1/nav, auv2/nav; allowed: a whole name, or an id' in err


WILD = {
    "address": 1,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv"}],
    "types": [
        {
            "name": "Wild",
            "fields": [
                {"name": "nonce", "type": "uint32"},
                {"name": "stamp", "type": "uint64"},
                {"name": "lat", "type": "float64", "range": [-90, 90], "step": 1e-6},
                {"name": "lon", "type": "float64", "range": [-180, 180], "step": 1e-6},
                {
                    "name": "level", "type": "float32", "range": [0, 10], "step": 0.1,
                    "outside": "clamp",
                },
            ],
        }
    ],
    "streams": [
        {"id": 10, "topic": "wild", "type": "Wild", "codec": "dense", "publishers": [2],
         "subscribers": [1]}
    ],
}  # fmt: skip


def test_numbers_that_jump_over_all_their_range_are_fitted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng, lines = random.Random(5), []
    stamp, place = 1_700_000_000_000_000_000, [43.0, 15.0]
    for number in range(300):
        stamp += 10**9 + round(rng.gauss(0, 1e6))
        place = [each + rng.gauss(1e-5, 1e-6) for each in place]
        if rng.random() < 0.05:  # a fix after dead reckoning, or none at all
            place = [rng.uniform(-80, 80), rng.uniform(-170, 170)]
        value = {
            "nonce": rng.getrandbits(32), "stamp": stamp, "lat": place[0], "lon": place[1],
            "level": rng.choice((5.0, 50.0, 1e300, -1e300)),
        }  # fmt: skip
        lines.append(json.dumps({"t": number, "s": "wild", "v": value}))
    recording, model = tmp_path / "wild.jsonl", tmp_path / "wild.model.json"
    recording.write_text("\n".join(lines) + "\n", encoding="utf-8")
    fleet = tmp_path / "fleet.json5"
    section = WILD | {"links": []}
    fleet.write_text(json.dumps({"plugins": {"acoustic": section}}), encoding="utf-8")
    code, out, err = fit(capsys, recording, "--config", fleet, "--output", model, "--json")
    assert code in (0, 1), err
    report = json.loads(out)
    assert report["streams"][0]["samples"] == 300, report
    section = WILD | {"links": [], "model": model.name}
    fleet.write_text(json.dumps({"plugins": {"acoustic": section}}), encoding="utf-8")
    assert read_config(fleet).table.model is not None
