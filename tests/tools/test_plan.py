"""`zacoustic config plan`: near what `sim` measures; names what does not fit, and why."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.pages.blocks import ROOT, files_of
from tests.tools.planned import ALLOWED, CASES, HOURS, Case, compare
from zacoustic.app.cli import main
from zacoustic.app.tools.design.plan import report, sampling
from zacoustic.app.tools.design.plan.fleet import AssumedChannel
from zacoustic.app.tools.design.plan.report import plan, transmit_power_w
from zacoustic.app.tools.design.plan.verdict import MOST_ARRIVALS
from zacoustic.channel.profiles import PROFILES
from zacoustic.errors import ConfigError

_SHORT_ALLOWED = 0.15

NAV = {
    "name": "Nav",
    "fields": [
        {"name": "lat", "type": "float64", "range": [-90, 90], "step": 1e-6},
        {"name": "depth", "type": "float32", "range": [0, 1000], "step": 0.1},
    ],
}


def fleet(folder: Path, *streams: dict[str, Any]) -> Path:
    path = folder / "fleet.json5"
    nodes = [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}]
    section = {"nodes": nodes, "types": [NAV], "streams": streams}
    path.write_text(json.dumps({"plugins": {"acoustic": section}}), encoding="utf-8")
    return path


def channel(folder: Path, *traffic: dict[str, Any], **more: object) -> Path:
    path = folder / "water.json5"
    scenario = {
        "config": "fleet.json5",
        "channel": "none",
        "nodes": [
            {"address": 1, "position": [0, 0, 10]},
            {"address": 2, "position": [1000, 0, 50]},
        ],
        "traffic": traffic,
        **more,
    }
    path.write_text(json.dumps(scenario), encoding="utf-8")
    return path


# Both run the engines: one case shows that they are asked the same thing.
FIRST, *OTHERS = CASES


@pytest.mark.parametrize(
    "case",
    [FIRST, *(pytest.param(case, marks=pytest.mark.soak) for case in OTHERS)],
    ids=lambda case: case.name,
)
def test_a_plan_is_near_what_sim_measures(
    case: Case, tmp_path: Path, count: Callable[[int], int]
) -> None:
    is_full = count(100) == 100
    compared = compare(case, tmp_path, HOURS if is_full else case.short_hours)
    assert abs(compared.off) <= (ALLOWED if is_full else _SHORT_ALLOWED), compared
    assert compared.measured > 0.03


def test_airtime_of_lone_frames_is_exact(tmp_path: Path) -> None:
    fleet(tmp_path, {"id": 10, "topic": "log", "publishers": [2]})
    path = channel(tmp_path, {"node": 2, "topic": "log", "every_s": 10, "size_bytes": 20})
    (stream,) = plan(path, hours=1).streams
    # One frame in ten seconds: id and payload; HELLO, TAG and CONFIRM of the first minute on top.
    airtime_s = PROFILES["evologics_s2c_18_34"].airtime_s(21)
    assert stream.airtime_s_per_h == pytest.approx(360 * airtime_s, rel=0.01)
    assert stream.went == 1.0
    # A sample of a steady period lingers for up to a quarter of it, and for up to four of the
    # longest frames, so that the nodes of a fleet do not meet.
    least_s = airtime_s + 1000.8 / 1500
    assert stream.expected_s is not None
    assert stream.worst_s is not None
    assert least_s < stream.expected_s < stream.worst_s < least_s + 10 / 4 + 0.02


def test_agreement_is_compared_and_the_policy_that_takes_less_is_proposed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hours = 0.2
    for nodes, proposed in ((2, "confirm"), (12, "tag")):
        section = {
            "nodes": [{"address": each, "name": f"n{each}"} for each in range(1, nodes + 1)],
            "streams": [{"id": 1, "topic": "{node}/report", "min_interval_s": 120}],
        }
        for method in ("confirm", "tag"):
            path = tmp_path / f"{nodes}-{method}.json5"
            written = {**section, "address": 1, "agreement": method}
            path.write_text(json.dumps({"plugins": {"acoustic": written}}))
            found = plan(path, hours=hours).agreement
            assert found is not None
            assert (found.method, found.proposed) == (method, proposed)
            assert main(["config", "plan", str(path), "--hours", str(hours)]) == 0
            advice = (
                "as the file has it" if method == proposed else f'agreement: "{proposed}" is better'
            )
            assert advice in capsys.readouterr().out
            assert main(["config", "check", str(path)]) == 0
            assert f'agreement "{method}", {nodes} nodes' in capsys.readouterr().out


def test_a_long_list_of_nodes_is_planned_for_a_shorter_time(
    tmp_path: Path, sized: Callable[..., int], monkeypatch: pytest.MonkeyPatch
) -> None:
    parts = sized(1, share=5)  # a fifth of the arrivals takes a fifth of the time
    monkeypatch.setattr(report, "MOST_ARRIVALS", MOST_ARRIVALS // parts)
    nodes = [{"address": each, "name": f"n{each}"} for each in range(1, 61)]
    streams = [{"id": 1, "topic": "{node}/report", "min_interval_s": 60}]
    section = {"address": 1, "nodes": nodes, "streams": streams, "agreement": "tag"}
    path = tmp_path / "fleet.json5"
    path.write_text(json.dumps({"plugins": {"acoustic": section}}))
    assert plan(path).hours < 0.5 / parts


def large_fleet(folder: Path, count: int, **more: object) -> Path:
    nodes = [{"address": each, "name": f"n{each}"} for each in range(1, count + 1)]
    streams = [
        {"id": 1, "topic": "{node}/report", "type": "Flag", "min_interval_s": 300},
        {"id": 2, "topic": "stop", "type": "Flag", "publishers": [1], "reliability": "reliable",
         "min_interval_s": 600},
    ]  # fmt: skip
    types = [{"name": "Flag", "fields": [{"name": "on", "type": "bool"}]}]
    path = folder / "fleet.json5"
    section = {"nodes": nodes, "types": types, "streams": streams, "agreement": "tag", **more}
    path.write_text(json.dumps({"plugins": {"acoustic": section}}))
    return path


@pytest.mark.soak
def test_some_nodes_of_a_large_fleet_speak_for_the_equal_ones(
    tmp_path: Path, sized: Callable[..., int], monkeypatch: pytest.MonkeyPatch
) -> None:
    count = sized(48, share=36)
    monkeypatch.setattr(report, "agreement_of", lambda *arguments: None)
    path = large_fleet(tmp_path, count)
    sampled = plan(path, hours=0.5)
    # The same fleet at the same instants, walked whole.
    monkeypatch.setattr(sampling, "MOST_WALKED", count)
    whole = plan(path, hours=0.5)

    assert any(f"20 of {count} nodes were walked" in each for each in sampled.notes)
    assert not any("walked" in each for each in whole.notes)
    assert [each.address for each in sampled.nodes] == list(range(1, count + 1))
    by_id = {each.stream_id: each for each in whole.streams}
    for stream, allowed in ((1, 0.1), (2, 0.25)):
        one = next(each for each in sampled.streams if each.stream_id == stream)
        assert one.went == by_id[stream].went == 1.0
        airtime_s = by_id[stream].airtime_s_per_h / by_id[stream].per_h
        assert one.airtime_s_per_h / one.per_h == pytest.approx(airtime_s, rel=allowed)
    assert sampled.utilisation == pytest.approx(whole.utilisation, rel=0.1)
    assert sampled.fits == whole.fits


def test_a_node_with_settings_of_its_own_is_not_spoken_for(tmp_path: Path) -> None:
    path = large_fleet(tmp_path, 48)
    config = json.loads(path.read_text())
    config["plugins"]["acoustic"]["nodes"][41]["heartbeat_s"] = 20
    path.write_text(json.dumps(config))
    airtime = {each.address: each.utilisation for each in plan(path, hours=0.25).nodes}
    del airtime[1]  # it commands the others
    assert max(airtime, key=lambda each: airtime[each]) == 42
    assert airtime[42] > 2.5 * airtime[43]


def test_a_table_of_many_nodes_is_planned_in_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sized: Callable[..., int]
) -> None:
    path = large_fleet(tmp_path, sized(254, share=120), agreement="confirm")
    assert main(["config", "plan", str(path), "--hours", "0.1"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) < 40
    assert any("agreement on tables alone takes" in each for each in lines)
    assert any('agreement: "tag" is better' in each for each in lines)


def test_what_does_not_fit_is_named_and_what_would_make_it_fit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet(
        tmp_path,
        {"id": 10, "topic": "status", "type": "Nav", "publishers": [2]},
        {"id": 11, "topic": "cmd", "publishers": [1]},
    )
    path = channel(
        tmp_path,
        {"node": 2, "topic": "status", "every_s": 1.5, "value": {"lat": 54, "depth": 3}},
        {"node": 1, "topic": "cmd", "every_s": 60, "size_bytes": 6},
        profile="whoi_micromodem_fsk",
    )
    found = plan(path, hours=0.1)
    assert not found.fits
    assert 1 > found.demand > found.utilisation  # the pauses between frames are not in it
    assert found.streams[0].name == "status"
    assert "status alone takes" in found.misfits[0]
    assert any(change.what.startswith("status: min_interval_s: ") for change in found.changes)
    # Whoever follows the advice has a plan that fits.
    every_s = next(
        float(change.what.split()[2])
        for change in found.changes
        if change.what.startswith("status: min_interval_s: ")
    )
    slower = channel(
        tmp_path,
        {"node": 2, "topic": "status", "every_s": every_s, "value": {"lat": 54, "depth": 3}},
        {"node": 1, "topic": "cmd", "every_s": 60, "size_bytes": 6},
        profile="whoi_micromodem_fsk",
    )
    assert main(["config", "plan", str(slower), "--hours", "0.1"]) == 0
    assert "it fits" in capsys.readouterr().out


def test_what_comes_too_late_does_not_fit(tmp_path: Path) -> None:
    fleet(tmp_path, {"id": 10, "topic": "log", "publishers": [2], "lifespan_s": 0.5})
    path = channel(tmp_path, {"node": 2, "topic": "log", "every_s": 10, "size_bytes": 40})
    found = plan(path, hours=0.2)
    assert not found.fits
    assert "worth nothing after 0.5 s" in " ".join(found.misfits)


def test_aloha_carries_less(tmp_path: Path) -> None:
    path = fleet(tmp_path, {"id": 10, "topic": "log", "min_interval_s": 5})
    section = json.loads(path.read_text(encoding="utf-8"))
    for method, fits in (("carrier_sense", True), ("aloha", False)):
        section["plugins"]["acoustic"]["links"] = [
            {"locator": "sim/127.0.0.1:7000", "access": {"method": method}}
        ]
        path.write_text(json.dumps(section), encoding="utf-8")
        assert plan(path, hours=0.5).fits is fits, method


def test_a_cap_on_the_airtime_holds(tmp_path: Path) -> None:
    fleet(tmp_path, {"id": 10, "topic": "log", "publishers": [2], "max_airtime": 0.05})
    path = channel(tmp_path, {"node": 2, "topic": "log", "every_s": 2, "size_bytes": 40})
    found = plan(path, hours=4)
    assert found.utilisation == pytest.approx(0.05, rel=0.1)
    assert not found.fits


def test_a_config_says_how_often_by_its_intervals(tmp_path: Path) -> None:
    path = fleet(
        tmp_path,
        {"id": 10, "topic": "nav", "type": "Nav", "publishers": [2], "min_interval_s": 10},
        {"id": 11, "topic": "log", "publishers": [2], "deadline_s": 60},
        {"id": 12, "topic": "cmd", "publishers": [1]},
    )
    found = plan(path, hours=1)
    assert {row.name: round(row.per_h) for row in found.streams} == {"nav": 360, "log": 60}
    assert any(note.startswith("cmd: nothing says how often") for note in found.notes)
    assert any(note.startswith("log: reckoned with its largest sample") for note in found.notes)


def test_loss_costs_what_is_reliable(tmp_path: Path) -> None:
    orders = {"id": 10, "topic": "orders", "publishers": [1], "subscribers": [2],
              "reliability": "reliable", "depth": 2}  # fmt: skip
    fleet(tmp_path, orders)
    said = {"node": 1, "topic": "orders", "every_s": 30, "size_bytes": 12}
    calm, rough = (
        plan(channel(tmp_path, said, loss={"frame": loss}), hours=2) for loss in (0.0, 0.3)
    )
    # Sample and answer again until both have arrived: 1 / 0.7² samples, 1 / 0.7 answers.
    assert rough.utilisation / calm.utilisation == pytest.approx(1.85, rel=0.15)
    assert rough.fits


def test_a_minimum_interval_as_long_as_the_period_leaves_room_for_repetitions(
    tmp_path: Path,
) -> None:
    orders = {"id": 10, "topic": "orders", "type": "Nav", "publishers": [1], "subscribers": [2],
              "reliability": "reliable", "min_interval_s": 30}  # fmt: skip
    found = plan(fleet(tmp_path, {**orders, "depth": 8}), channel=AssumedChannel(loss=0.3), hours=2)
    assert found.fits
    # With nobody who hears it, each sample is pushed out by the next one.
    unheard = {"from": 1, "to": 2, "loss": {"frame": 0.97}}
    fleet(tmp_path, {**orders, "depth": 1, "min_interval_s": 0})
    said = {"node": 1, "topic": "orders", "every_s": 5, "value": {"lat": 54, "depth": 3}}
    lost = plan(channel(tmp_path, said, links=[unheard]), hours=0.5)
    assert not lost.fits
    assert "never arrives although it is repeated" in lost.streams[0].misfit


def test_a_recording_says_how_often_and_how_large(tmp_path: Path) -> None:
    path = fleet(
        tmp_path,
        {"id": 10, "topic": "nav", "type": "Nav", "publishers": [2]},
        {"id": 11, "topic": "log", "publishers": [2]},
    )
    recording = tmp_path / "monday.jsonl"
    recording.write_text(
        "\n".join(
            json.dumps({"t": 4.0 * i, "s": "nav", "v": {"lat": 54 + i / 1e4, "depth": 30 + i % 40}})
            for i in range(200)
        )
    )
    found = plan(path, recordings=[str(recording)], hours=1)
    (row,) = found.streams
    assert row.per_h == pytest.approx(900, rel=0.01)
    assert "log: not in the recording: left out" in found.notes
    # id, latitude in steps of 1e-6 (five bytes), depth in steps of 0.1 (three).
    airtime_s = PROFILES["evologics_s2c_18_34"].airtime_s(9)
    assert row.airtime_s_per_h == pytest.approx(900 * airtime_s, rel=0.02)


def test_the_same_plan_twice_is_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = CASES[0].write(tmp_path)
    told = []
    for _ in range(2):
        assert main(["config", "plan", str(path), "--hours", "0.2", "--json"]) == 0
        told.append(json.loads(capsys.readouterr().out))
    assert told[0] == told[1]
    assert told[0]["fits"] is True
    assert math.isclose(
        sum(row["airtime_s_per_h"] for row in told[0]["streams"]),
        told[0]["utilisation"] * 3600,
        rel_tol=0.02,
    )


def test_energy_is_that_of_transmitting(tmp_path: Path) -> None:
    path = CASES[0].write(tmp_path)
    found = plan(path, hours=0.2, transmit_w=35)
    for node in found.nodes:
        assert node.energy_wh_per_day == pytest.approx(node.utilisation * 35 * 24)
    # 184 dB are 20.9 W of sound.
    assert transmit_power_w(PROFILES["evologics_s2c_18_34"]) == pytest.approx(41.8, rel=0.01)


def test_what_is_wrong_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    silent = fleet(tmp_path, {"id": 10, "topic": "log"})
    with pytest.raises(ConfigError, match="no traffic rates"):
        plan(silent)
    assert main(["config", "plan", str(silent), "--loss", "2"]) == 2
    assert "--loss 2; allowed: 0..0.9" in capsys.readouterr().err
    stranger = channel(tmp_path, {"node": 2, "topic": "no", "every_s": 1, "size_bytes": 1})
    assert main(["config", "plan", str(stranger)]) == 2
    assert '"no" of node 2; allowed: log' in capsys.readouterr().err


def test_the_example_of_the_page_is_as_the_page_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, text in files_of("docs/plan.md").items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert main(["config", "plan", str(tmp_path / "water.json5"), "--hours", "0.5"]) == 1
    told = capsys.readouterr().out
    assert "auv1/status alone takes" in told
    assert 'it would fit with: auv1/status: codec: "packed"' in told
    assert "it would fit with: auv1/status: min_interval_s: 0.825 " in told
    # Line by line what the page shows, but for figures: here it is simulated for less long.
    page = (ROOT / "docs/plan.md").read_text(encoding="utf-8")
    (shown,) = (each for each in page.split("```\n") if each.startswith("id  stream"))
    assert _without_figures(told, tmp_path) == _without_figures(shown, tmp_path)


def _without_figures(text: str, folder: Path) -> list[str]:
    lines = text.replace(f"{folder}/", "").strip().splitlines()
    return [" ".join(re.sub(r"\d+(\.\d+)?", "#", each).split()) for each in lines]


@pytest.mark.parametrize("size_bytes", [400, 9000])
def test_what_fits_no_frame_does_not_fit_and_the_key_that_mends_it_is_named(
    size_bytes: int, tmp_path: Path
) -> None:
    def write(**extra: object) -> Path:
        fleet(tmp_path, {"id": 10, "topic": "log", "publishers": [2], **extra})
        said = {"node": 2, "topic": "log", "every_s": 3600, "size_bytes": size_bytes}
        # At another instant: of two at once, the depth of 1 keeps the newer one.
        small = {"node": 2, "topic": "log", "every_s": 600, "first_s": 300, "size_bytes": 20}
        return channel(tmp_path, said, small)

    found = plan(write(), hours=4)
    assert not found.fits
    assert found.streams[0].refused == pytest.approx(1 / 7, abs=0.05)
    assert "are refused: larger than a frame" in " ".join(found.misfits)
    assert 'log: reliability: "reliable"' in [change.what for change in found.changes]
    mended = plan(write(reliability="reliable"), hours=4)
    assert mended.fits
    assert mended.streams[0].refused == 0


def test_what_the_type_refuses_of_a_recording_is_counted(tmp_path: Path) -> None:
    path = fleet(tmp_path, {"id": 10, "topic": "nav", "type": "Nav", "publishers": [2]})
    depths = [30.0, 2000.0, 31.0, 32.0] * 20
    recording = tmp_path / "monday.jsonl"
    recording.write_text(
        "\n".join(
            json.dumps({"t": 10.0 * i, "s": "nav", "v": {"lat": 54.0, "depth": depth}})
            for i, depth in enumerate(depths)
        )
    )
    found = plan(path, recordings=[str(recording)], hours=1)
    assert found.streams[0].refused == pytest.approx(0.25)
    assert not found.fits
    assert "nav: 25% of its samples are refused: " in " ".join(found.misfits)


def test_half_of_the_samples_are_never_later_than_nearly_all_of_them(tmp_path: Path) -> None:
    """A mean can be: the rare outage of a reliable topic outweighs all else."""
    fleet(tmp_path, {"id": 10, "topic": "log", "publishers": [2], "reliability": "reliable",
                     "depth": 8})  # fmt: skip
    for loss in (0.0, 0.4, 0.7):
        said = {"node": 2, "topic": "log", "every_s": 40, "size_bytes": 20}
        for row in plan(channel(tmp_path, said, loss={"frame": loss}), hours=0.3).streams:
            assert row.expected_s is not None
            assert row.worst_s is not None
            assert row.expected_s <= row.worst_s


def test_advice_names_keys_and_values_in_three_digits(tmp_path: Path) -> None:
    fleet(tmp_path, {"id": 10, "topic": "a", "publishers": [2]},
          {"id": 11, "topic": "b", "publishers": [2]})  # fmt: skip
    traffic = [
        {"node": 2, "topic": name, "every_s": every_s, "size_bytes": 40}
        for name, every_s in (("a", 0.6789), ("b", 23.4567))
    ]
    path = channel(tmp_path, *traffic, profile="ahoi")
    changes = plan(path, hours=0.2).changes
    assert changes
    for change in changes:
        for part in change.what.split("; "):
            assert re.fullmatch(r'(\w+, )*\w+: (\w+: "?[\w.]+"?)(, with depth: 8)?', part), (
                change.what
            )
        for number in re.findall(r"\d+\.?\d*", change.what):
            assert len(number.replace(".", "").strip("0")) <= 3
