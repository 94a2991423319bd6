"""The lists of links of a file."""

from typing import Any

import pytest

from zacoustic.app.tools.design.check.report import report_of
from zacoustic.config import config_from_mapping
from zacoustic.core.bond.spec import Bond, BondLink, LinkCost, Tariff
from zacoustic.errors import ConfigError

RADIO = {"name": "radio", "locator": "udp/239.1.2.3:7000", "cost": "free"}
SOUND = {"name": "acoustic", "locator": "sim/127.0.0.1:7000"}


def section(address: int = 1, **changes: Any) -> dict[str, Any]:
    """Return a section with two links."""
    return {
        "address": address,
        "nodes": [{"address": each, "name": f"n{each}"} for each in (1, 2, 3)],
        "links": [SOUND, RADIO],
        "streams": [
            {"id": 1, "topic": "{node}/nav", "links": ["radio", "acoustic"]},
            {"id": 2, "topic": "{node}/near"},
            {"id": 3, "topic": "{node}/deep", "links": ["acoustic"]},
        ],
        **changes,
    }


def read(*, locator: str | None = None, **changes: Any) -> Any:
    """Return the rules of a section."""
    return config_from_mapping(section(**changes), source="fleet.json5", locator=locator).rules


def test_a_list_of_links_is_a_bond() -> None:
    rules = read()
    assert rules.bonds == (Bond(number=31, links=("radio", "acoustic")),)
    assert rules.links_of_streams == {1: "radio+acoustic", 3: "acoustic"}
    assert rules.default_link == ""
    assert [each.bonded for each in rules.of_links] == [BondLink(), BondLink(cost=LinkCost.FREE)]


def test_default_links_are_those_of_all_other_streams() -> None:
    rules = read(default_links=["acoustic", "radio"])
    assert rules.default_link == "acoustic+radio"
    assert [each.number for each in rules.bonds] == [31, 30]


def test_numbers_are_those_that_no_route_has() -> None:
    rules = read(routes=[{"id": 31, "name": "far", "path": [1, 2, 3]}])
    assert [each.number for each in rules.bonds] == [30]


def test_another_link_by_argument_has_no_lists() -> None:
    rules = read(locator="udp/127.0.0.1:0#peers=127.0.0.1:9", default_links=["radio"])
    assert (rules.bonds, rules.links_of_streams, rules.default_link) == ((), {}, "")


def test_nodes_may_lack_a_link_or_have_it_elsewhere() -> None:
    links = [
        SOUND,
        {**RADIO, "owners": [1]},
        {**RADIO, "owners": [2], "locator": "udp/239.1.2.4:7000"},
    ]
    rules = {each: read(links=links, address=each) for each in (1, 2, 3)}
    assert [[own.name for own in rules[each].of_links] for each in (1, 2, 3)] == [
        ["acoustic", "radio"],
        ["acoustic", "radio"],
        ["acoustic"],
    ]
    assert {each.bonds for each in rules.values()} == {rules[1].bonds}
    assert [own.port for own in rules[2].of_links] == [0, 1]
    config = config_from_mapping(section(2, links=links), source="fleet.json5")
    assert [each.locator for each in config.links] == [SOUND["locator"], "udp/239.1.2.4:7000"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"default_links": ["sat"]}, 'default_links[0]: "sat"; allowed: acoustic, radio'),
        ({"default_links": ["radio", "radio"]}, 'default_links[1]: "radio" a second time'),
        ({"links": [SOUND, {**RADIO, "cost": "cheap"}]}, 'links[1].cost: "cheap"; allowed: free'),
        (
            {"links": [SOUND, {**RADIO, "cost": {"quantum": 5}}]},
            "links[1].cost.per_byte: is missing",
        ),
        ({"links": [SOUND, {**RADIO, "cost": {"per_byte": 0}}]}, "links[1].cost.per_byte: 0"),
        (
            {"links": [SOUND, {**RADIO, "cost": {"per_byte": 1, "x": 1}}]},
            "links[1].cost.x: unknown key",
        ),
        ({"links": [SOUND, {**RADIO, "probe_s": 0}]}, "links[1].probe_s: 0; allowed: "),
        ({"links": [SOUND, {**RADIO, "down_after_s": 1e300}]}, "links[1].down_after_s: 1e+300"),
        (
            {"links": [SOUND, {**RADIO, "owners": [9]}]},
            "links[1].owners[0]: 9 is no node; ",
        ),
        ({"links": [{**SOUND, "owners": [2]}]}, "links: none is for node 1"),
        (
            {"links": [SOUND, RADIO, {**RADIO, "owners": [2]}]},
            'links[2].name: "radio" a second time',
        ),
        (
            {"streams": [{"id": 1, "topic": "a", "link": "radio", "links": ["radio"]}]},
            "streams[0].links: beside link; allowed: one of the two",
        ),
        ({"streams": [{"id": 1, "topic": "a", "links": []}]}, "streams[0].links: []; allowed: a"),
    ],
)
def test_mistakes(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read(**changes)
    assert f"fleet.json5: plugins.acoustic.{message}" in str(caught.value)


def test_check_says_which_links_a_stream_has() -> None:
    config = config_from_mapping(section(), source="fleet.json5")
    notes = report_of(config, None).notes
    assert "links radio (free), acoustic (airtime); streams: {node}/nav" in notes
    changed = section(links=[SOUND, {**RADIO, "cost": "airtime"}])
    notes = report_of(config_from_mapping(changed, source="fleet.json5"), None).notes
    assert any(each.startswith("nothing answers on radio") for each in notes)
    assert any(each.startswith("nobody answers {node}/nav") for each in notes)
    changed["heartbeat_s"] = 60
    notes = report_of(config_from_mapping(changed, source="fleet.json5"), None).notes
    assert not any(each.startswith("nobody answers") for each in notes)


def test_a_price_is_a_tariff() -> None:
    price = {"per_byte": 0.0032, "quantum": 50}
    links = read(links=[SOUND, {**RADIO, "cost": price}]).links
    assert links[1].bonded == BondLink(
        cost=LinkCost.MONEY, tariff=Tariff(per_byte=0.0032, quantum=50)
    )
