"""`zacoustic codec bench`: the bytes of every codec, and a decode that differs is a failure."""

import json
from pathlib import Path
from typing import Any

import msgspec
import pytest

from tests.cli.dive import dive, write, write_config
from zacoustic.app.cli import main
from zacoustic.core.values.dense import Decoded, Listener


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return write(tmp_path / "dive.jsonl.gz", dive(3, 80))


def bench(capsys: pytest.CaptureFixture[str], *arguments: Path | str) -> tuple[int, str, str]:
    code = main(["codec", "bench", *map(str, arguments)])
    written = capsys.readouterr()
    return code, written.out, written.err


def test_every_codec_is_measured_and_verified(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet = write_config(tmp_path / "fleet.json5")
    code, out, err = bench(capsys, recording, "--config", fleet, "--json")
    assert (code, err) == (0, "")
    report = json.loads(out)
    assert report["different"] == 0
    assert report["decoded"] > 800
    nav, status, log = report["streams"]
    assert [nav["frames"], status["frames"], log["frames"]] == [80, 16, 8]
    # id and payload: 18 + 11 + 12 + 9 bits; id, age and payload: 2 + 1 + 7 bits
    assert nav["records"]["packed"] == 8
    assert status["records"]["packed"] == 4
    for row in report["streams"]:
        records = row["records"]
        assert records["json"] > records["cbor"] >= records["packed"]
        assert "dense_fitted" not in row or row["dense_fitted"] is None
    acknowledged = nav["dense"]["acknowledged"]
    assert acknowledged["0"] <= acknowledged["10"] <= acknowledged["30"]
    assert acknowledged["0"] < 0.85 * nav["records"]["packed"]
    window = report["window"]
    assert window["frames"] == 40
    assert window["dense"]["alone"] < window["records"]["packed"]


def test_all_typed_topics_are_measured_whatever_their_codec(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    figures = []
    for codec in ("dense", "packed", "cbor"):
        fleet = write_config(tmp_path / f"{codec}.json5", codec=codec)
        code, out, _ = bench(capsys, recording, "--config", fleet, "--json")
        assert code == 0
        figures.append(json.loads(out)["streams"])
    assert figures[0] == figures[1] == figures[2]


def test_the_model_of_the_configuration_is_measured_beside(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet, model = write_config(tmp_path / "fleet.json5"), tmp_path / "m.json"
    known = write(tmp_path / "known.jsonl", dive(1))
    assert main(["codec", "fit", str(known), "--config", str(fleet), "--output", str(model)]) == 0
    write_config(fleet, model="m.json")
    capsys.readouterr()
    new = write(tmp_path / "new.jsonl", dive(2, 100))
    code, out, _ = bench(capsys, new, "--config", fleet, "--json")
    assert code == 0
    report = json.loads(out)
    log = report["streams"][2]
    assert log["dense_fitted"]["alone"] < log["dense"]["alone"]
    assert report["window"]["dense_fitted"]["alone"] < report["window"]["dense"]["alone"]
    code, out, _ = bench(capsys, new, "--config", fleet)
    assert code == 0
    assert out.count("with the model") == 4
    assert "different from what was sent: 0" in out


def test_a_decode_that_differs_is_a_failure(
    recording: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    decode = Listener.decode

    def altered(listener: Listener, frame: bytes) -> Decoded:
        decoded = decode(listener, frame)
        samples = [(each, dict(value)) for each, value in decoded.samples]
        for _, value in samples:
            if value.get("depth") is not None and value["depth"] > 20:
                value["depth"] += 0.1
        return msgspec.structs.replace(decoded, samples=tuple(samples))

    monkeypatch.setattr(Listener, "decode", altered)
    fleet = write_config(tmp_path / "fleet.json5")
    code, out, err = bench(capsys, recording, "--config", fleet)
    assert code == 1
    assert "frames were decoded to something else" in err
    assert "different from what was sent: 0" not in out


def test_losses_follow_from_the_seed(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet = write_config(tmp_path / "fleet.json5")
    found: list[Any] = []
    for seed in ("1", "1", "2"):
        _, out, _ = bench(capsys, recording, "--config", fleet, "--seed", seed, "--json")
        found.append(json.loads(out)["streams"][0]["dense"])
    assert found[0] == found[1] != found[2]


def test_wrong_arguments_are_one_line(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet = write_config(tmp_path / "fleet.json5")
    broken = write(tmp_path / "broken.jsonl", ["{"])
    for arguments, expected in (
        ([recording], "--config"),
        ([recording, "--config", fleet, "--window", "-1"], "--window -1; allowed"),
        ([broken, "--config", fleet], "broken.jsonl: line 1: no JSON"),
        ([recording, "--config", tmp_path / "none.json5"], "none.json5"),
    ):
        code, out, err = bench(capsys, *arguments)
        assert (code, out) == (2, "")
        assert expected in err
        assert err.count("\n") == 1


def test_what_is_larger_than_a_frame_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(**extra: object) -> tuple[int, str, str]:
        text = {"name": "Text", "fields": [{"name": "t", "type": "string", "max_length": 400}]}
        stream = {"id": 10, "topic": "log", "type": "Text", **extra}
        nodes = [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}]
        section = {"address": 1, "nodes": nodes, "types": [text], "streams": [stream]}
        fleet = tmp_path / "fleet.json5"
        fleet.write_text(json.dumps({"plugins": {"acoustic": section}}), encoding="utf-8")
        lines = [json.dumps({"t": i, "s": "log", "v": {"t": "x" * (20 * i)}}) for i in range(6)]
        log = tmp_path / "log.jsonl"
        log.write_text("\n".join(lines), encoding="utf-8")
        return bench(capsys, log, "--config", fleet, "--json")

    code, out, err = run()
    assert code == 1
    assert json.loads(out)["streams"][0]["too_large"] == 3
    assert "log: 3 of 6 samples are larger than a frame" in err
    assert 'reliability: "reliable"' in err
    assert run(reliability="reliable")[0] == 0
