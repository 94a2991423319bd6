"""`zacoustic config plan` honours what a table says of links, routes, carriers and seals."""

import json
from pathlib import Path
from typing import Any

import pytest

from zacoustic.app.cli import main
from zacoustic.app.tools.design.plan import report
from zacoustic.app.tools.design.plan.report import PlanReport, plan
from zacoustic.app.tools.design.sim.simulation import simulate

HOURS = 0.3
UNHEARD = [
    {"from": 1, "to": 3, "loss": {"frame": 1}},
    {"from": 3, "to": 1, "loss": {"frame": 1}},
]


def write(
    folder: Path, section: dict[str, Any], traffic: list[dict[str, Any]], **more: Any
) -> Path:
    """Write a config and a scenario, with nodes 1 km apart in a row; returns the latter."""
    count = more.pop("count", 2)
    nodes = [{"address": each, "name": f"n{each}"} for each in range(1, count + 1)]
    config = {"plugins": {"acoustic": {"nodes": nodes, **section}}}
    (folder / "fleet.json5").write_text(json.dumps(config), encoding="utf-8")
    placed = [
        {**node, "position": [1000 * place, 0, 10]} for place, node in enumerate(nodes, start=1)
    ]
    scenario = {"config": "fleet.json5", "channel": "none", "nodes": placed, "traffic": traffic}
    path = folder / "water.json5"
    path.write_text(json.dumps({**scenario, **more}), encoding="utf-8")
    return path


def said(node: int, topic: str, every_s: float, size_bytes: int = 12) -> dict[str, Any]:
    """Return an entry of the traffic."""
    return {"node": node, "topic": topic, "every_s": every_s, "size_bytes": size_bytes}


def arrived(found: PlanReport, name: str) -> bool:
    """Return whether samples of a topic have arrived."""
    return next(each for each in found.streams if each.name == name).expected_s is not None


TWO_LINKS: dict[str, Any] = {
    "links": [
        {"locator": "sim/127.0.0.1:7000", "name": "sound"},
        {"locator": "sim/127.0.0.1:7001", "name": "radio", "cost": "free"},
    ],
    "streams": [
        {"id": 10, "topic": "nav", "publishers": [2], "link": "sound"},
        {"id": 11, "topic": "photo", "publishers": [2], "link": "radio"},
        {"id": 12, "topic": "log", "publishers": [2], "links": ["radio", "sound"]},
    ],
}
RADIO: dict[str, Any] = {"link": "radio", "profile": "ideal", "channel": "none", "delay_s": 0.02}


def test_each_stream_goes_by_its_link_and_each_link_has_its_channel(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report, "changes_that_fit", lambda *arguments: ())  # it takes long
    traffic = [said(2, "nav", 10), said(2, "photo", 10, 40), said(2, "log", 15)]
    path = write(tmp_path, TWO_LINKS, traffic, media=[RADIO])
    found = plan(path, hours=HOURS)
    assert all(arrived(found, name) for name in ("nav", "photo", "log"))
    assert [each.name for each in found.links] == ["sound", "radio"]
    assert [each.profile for each in found.links] == ["evologics_s2c_18_34", "ideal"]
    sound, radio = (each.utilisation for each in found.links)
    assert sound + radio == pytest.approx(found.utilisation)
    assert 0 < radio < sound / 10
    # Where nothing passes by radio, its streams wait, and the list goes by sound.
    away = {**RADIO, "blackouts": [{"node": 2, "from_s": 0, "to_s": 1e6}]}
    deep = plan(write(tmp_path, TWO_LINKS, traffic, media=[away]), hours=HOURS)
    assert arrived(deep, "log")
    assert not arrived(deep, "photo")
    assert deep.links[0].utilisation > 1.3 * sound
    main(["config", "plan", str(path), "--hours", "0.1"])
    assert "by link: sound " in capsys.readouterr().out


def test_a_config_alone_has_a_modem_for_each_link(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    streams = [{**each, "min_interval_s": 20} for each in TWO_LINKS["streams"]]
    write(tmp_path, {**TWO_LINKS, "streams": streams}, [said(2, "nav", 10)])
    verb = ("config", "plan", str(tmp_path / "fleet.json5"), "--hours", "0.1")
    assert main([*verb, "--link-profile", "radio=ideal", "--json"]) == 0
    links = json.loads(capsys.readouterr().out)["links"]
    assert [each["profile"] for each in links] == ["evologics_s2c_18_34", "ideal"]
    for wrong, told in (("radio", "allowed: LINK=NAME"), ("air=ideal", "allowed: radio")):
        assert main([*verb, "--link-profile", wrong]) == 2
        assert told in capsys.readouterr().err


def test_a_link_of_some_nodes_alone_is_theirs(tmp_path: Path) -> None:
    links = [
        {"locator": "sim/127.0.0.1:7000", "name": "sound", "owners": [1, 2]},
        {"locator": "sim/127.0.0.1:7001", "name": "radio", "owners": [1, 3]},
    ]
    streams = [
        {"id": 10, "topic": "nav", "publishers": [2], "subscribers": [1], "link": "sound"},
        {"id": 11, "topic": "ship", "publishers": [3], "subscribers": [1], "link": "radio"},
    ]
    path = write(
        tmp_path,
        {"links": links, "streams": streams},
        [said(2, "nav", 10), said(3, "ship", 10)],
        count=3,
        media=[RADIO],
    )
    found = plan(path, hours=HOURS)
    assert found.fits
    assert arrived(found, "nav")
    assert arrived(found, "ship")
    share = {each.address: each.utilisation for each in found.nodes}
    assert 0 < share[3] < share[2] / 10


def test_a_relay_transmits_what_others_say(tmp_path: Path) -> None:
    section = {
        "routes": [{"id": 1, "name": "far", "path": [1, 2, 3]}],
        "streams": [
            {"id": 10, "topic": "nav", "publishers": [3], "subscribers": [1], "link": "far"},
            {"id": 11, "topic": "plan", "publishers": [1], "subscribers": [3], "link": "far",
             "reliability": "reliable", "depth": 4},
        ],
    }  # fmt: skip
    traffic = [said(3, "nav", 30), said(1, "plan", 60)]
    path = write(tmp_path, section, traffic, count=3, links=UNHEARD)
    found = plan(path, hours=HOURS)
    assert found.fits
    assert arrived(found, "nav")
    assert arrived(found, "plan")
    relay = found.nodes[1]
    assert relay.relayed == pytest.approx(relay.utilisation)
    assert relay.utilisation > 0.3 * (found.nodes[0].utilisation + found.nodes[2].utilisation)
    measured = simulate(path, until_s=HOURS * 3600)
    assert found.utilisation == pytest.approx(measured.airtime_s / measured.until_s, rel=0.05)


def test_flooded_frames_are_repeated_by_all(tmp_path: Path) -> None:
    section = {
        "flood": {"hops": 2},
        "streams": [{"id": 10, "topic": "nav", "publishers": [3], "flood": True}],
    }
    found = plan(
        write(tmp_path, section, [said(3, "nav", 60)], count=3, links=UNHEARD), hours=HOURS
    )
    assert found.fits
    assert found.nodes[1].relayed > 0


def test_carried_samples_arrive_by_a_third_node(tmp_path: Path) -> None:
    section = {
        "journal": "journals",
        "streams": [
            {"id": 10, "topic": "log", "publishers": [1], "subscribers": [3], "depth": 20,
             "reliability": "reliable", "journal": True, "carry": {"by": [2], "after_s": 60}}
        ],
    }  # fmt: skip
    traffic = [said(1, "log", 120)]
    path = write(tmp_path, section, traffic, count=3, links=UNHEARD)
    found = plan(path, hours=1)
    assert arrived(found, "log")
    assert found.nodes[1].utilisation > 0


def test_sealed_frames_are_larger_and_no_key_is_read(tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    streams = [{"id": 10, "topic": "nav", "publishers": [2]}]
    traffic = [said(2, "nav", 10)]
    plain = plan(write(tmp_path, {"streams": streams}, traffic), hours=HOURS)
    sealed = {"streams": streams, "security": {"key": "nowhere.key"}, "journal": "journals"}
    path = write(tmp_path, sealed, traffic)
    found = plan(path, hours=HOURS)
    assert arrived(found, "nav")
    assert found.utilisation > 1.05 * plain.utilisation
    assert simulate(path, until_s=600).airtime_s / 600 == pytest.approx(found.utilisation, rel=0.1)


def test_a_wrong_medium_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for medium, told in (
        ({"link": "radio", "profile": "no"}, "media[0].profile is 'no'"),
        ({"link": "radio", "links": UNHEARD}, "media[0].links[0].to is 3"),
        ({"link": ""}, "media[0].link is ''"),
    ):
        path = write(tmp_path, TWO_LINKS, [said(2, "nav", 10)], media=[medium])
        assert main(["config", "plan", str(path)]) == 2
        assert told in capsys.readouterr().err
