"""The list `routes` and the table `relay` of a file."""

import json
from pathlib import Path
from typing import Any

import pytest

from zacoustic.app.tools.design.check.report import report_of
from zacoustic.app.tools.design.sim.simulation import simulate
from zacoustic.config import config_from_mapping
from zacoustic.core.relay.relay import RelayRules
from zacoustic.core.relay.route import Route
from zacoustic.errors import ConfigError


def section(address: int = 1, **changes: Any) -> dict[str, Any]:
    """Return a section with a route from 1 to 3."""
    return {
        "address": address,
        "nodes": [{"address": each, "name": f"n{each}"} for each in (1, 2, 3)],
        "links": [{"name": "acoustic", "locator": "sim/127.0.0.1:7000"}],
        "routes": [{"id": 1, "name": "far", "path": [1, 2, 3]}],
        "streams": [
            {"id": 1, "topic": "n3/nav", "publishers": [3], "subscribers": [1], "link": "far"},
            {"id": 2, "topic": "{node}/near"},
        ],
        **changes,
    }


def read(*, locator: str | None = None, **changes: Any) -> Any:
    """Return the rules of a section."""
    return config_from_mapping(section(**changes), source="fleet.json5", locator=locator).rules


def test_streams_go_by_a_route_at_its_ends_alone() -> None:
    assert read(address=1).links_of_streams == {1: "far"}
    assert read(address=3).links_of_streams == {1: "far"}
    assert read(address=2).links_of_streams == {}
    assert read(address=2).routes == (
        Route(route_id=1, name="far", path=(1, 2, 3), link="acoustic"),
    )


def test_another_link_by_argument_is_that_of_the_route() -> None:
    rules = read(locator="udp/127.0.0.1:0#peers=127.0.0.1:9")
    assert rules.links_of_streams == {1: "far"}
    assert [each.link for each in rules.routes] == ["link"]
    assert [each.name for each in rules.of_links] == ["link"]


def test_a_link_without_a_name_is_enough() -> None:
    rules = read(links=[{"locator": "sim/127.0.0.1:7000"}])
    assert [each.link for each in rules.routes] == ["link"]
    assert [each.name for each in rules.of_links] == ["link"]


def test_how_much_a_node_does_for_others() -> None:
    assert read().relay == RelayRules(max_airtime=0.2, queue=16)
    assert read(relay={"max_airtime": 0.5, "queue": 3}).relay == RelayRules(
        max_airtime=0.5, queue=3
    )


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"routes": [{"id": 0, "name": "far", "path": [1, 2]}]},
            "routes[0].id: 0; allowed: a number, 1..31",
        ),
        (
            {"routes": [{"id": 1, "name": name, "path": [1, 2, 3]} for name in ("far", "b")]},
            "routes[1].id: 1 a second time",
        ),
        ({"routes": [{"id": 1, "name": "a/b", "path": [1, 2]}]}, "routes[0].name"),
        (
            {"routes": [{"id": 1, "name": "acoustic", "path": [1, 2]}]},
            'routes[0].name: "acoustic" a second time',
        ),
        (
            {"routes": [{"id": 1, "name": "far", "path": [1]}]},
            "routes[0].path: [1]; allowed: 2..16",
        ),
        ({"routes": [{"id": 1, "name": "far", "path": [1, 9]}]}, "path[1]: 9 is no node"),
        (
            {"routes": [{"id": 1, "name": "far", "path": [1, 2, 1]}]},
            "routes[0].path[2]: 1 a second time",
        ),
        (
            {"routes": [{"id": 1, "name": "far", "path": [1, 2], "link": "radio"}]},
            'routes[0].link: "radio"; allowed: acoustic',
        ),
        (
            {"routes": [{"id": 1, "name": "far", "path": [1, 2, 3], "lifetime_s": -1}]},
            "routes[0].lifetime_s: -1",
        ),
        ({"routes": []}, 'streams[0].link: "far"; allowed: acoustic'),
        ({"relay": {"max_airtime": 0}}, "relay.max_airtime: 0"),
        ({"relay": {"queue": 0}}, "relay.queue: 0; allowed: a number, 1..256"),
        (
            {"links": [{"name": "acoustic", "locator": "sim/127.0.0.1:7000", "port": 97}]},
            "links[0].port: 97; allowed: 0..96",
        ),
        (
            {"links": [{"locator": "desert/127.0.0.1:1", "wire": "rmw_desert"}], "streams": []},
            "routes: ",
        ),
    ],
)
def test_mistakes_are_named(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read(**changes)
    assert said in str(caught.value)


def test_check_says_where_routes_go() -> None:
    said = {each: _notes(each) for each in (1, 2, 3)}
    assert "route far: n1 - n2 - n3, 2 hops over acoustic; streams: n3/nav" in said[1]
    assert "route far: n1 - n2 - n3, 2 hops over acoustic; node 2 is a relay of it" in said[2]
    assert said[3][-1].startswith("zacoustic config plan counts a stream of a route once")


def _notes(address: int) -> tuple[str, ...]:
    config = config_from_mapping(section(address), source="fleet.json5")
    return report_of(config, None).notes


def test_a_scenario_runs_the_routes_of_its_config(tmp_path: Path) -> None:
    (tmp_path / "fleet.json5").write_text(
        json.dumps({"plugins": {"acoustic": section()}}), encoding="utf-8"
    )
    scenario = {
        "config": "fleet.json5",
        "nodes": [{"address": each, "position": [1500 * each, 0, 10]} for each in (1, 2, 3)],
        "links": [{"from": 1, "to": 3, "gain_db": -100}, {"from": 3, "to": 1, "gain_db": -100}],
        "traffic": [{"node": 3, "topic": "n3/nav", "every_s": 60, "size_bytes": 20}],
    }
    path = tmp_path / "sea.json5"
    path.write_text(json.dumps(scenario), encoding="utf-8")
    report = simulate(path)
    (stream,) = [each for each in report.streams if each.name == "n3/nav"]
    assert stream.delivered >= 57
