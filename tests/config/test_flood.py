"""Flooded streams in a file."""

from typing import Any

import pytest

from zacoustic.config import config_from_mapping
from zacoustic.core.base.linktypes import ONE_LINK
from zacoustic.core.relay.flood import FLOOD_NAME, Flood
from zacoustic.errors import ConfigError

ABORT: dict[str, Any] = {"id": 2, "topic": "abort", "publishers": [1], "flood": True}


def read(abort: dict[str, Any] | None = None, **changes: Any) -> Any:
    """Return the config of a section with a flooded topic."""
    section = {
        "address": 1,
        "nodes": [{"address": each, "name": f"n{each}"} for each in (1, 2, 3)],
        "streams": [{**ABORT, **(abort or {})}, {"id": 3, "topic": "plain"}],
        **changes,
    }
    return config_from_mapping(section, source="fleet.json5")


def test_flooded_stream_has_a_link_of_its_own() -> None:
    rules = read().rules
    assert rules.flood == Flood(link=ONE_LINK)
    assert rules.links_of_streams == {2: FLOOD_NAME}
    two = [
        {"name": "radio", "locator": "udp/239.1.2.3:7400"},
        {"name": "sound", "locator": "sim/h:1"},
    ]
    rules = read(links=two, flood={"link": "sound", "hops": 4, "max_airtime": 0.1}).rules
    assert rules.flood == Flood(link="sound", hops=4, max_airtime=0.1)
    assert rules.on_one_link().flood == Flood(link=ONE_LINK, hops=4, max_airtime=0.1)
    assert rules.on_one_link().links_of_streams == {2: FLOOD_NAME}


def test_nothing_is_flooded_without_such_a_stream() -> None:
    assert read({"flood": False}).rules.flood is None
    assert read({"flood": False}, flood={}).rules.flood == Flood(link=ONE_LINK)


@pytest.mark.parametrize(
    ("abort", "changes", "words"),
    [
        ({}, {"flood": {"hops": 5}}, "flood.hops: 5; allowed: a number, 1..4"),
        ({}, {"flood": {"max_airtime": 0}}, "flood.max_airtime: 0"),
        ({}, {"flood": {"link": "radio"}}, 'flood.link: "radio"; allowed: none'),
        (
            {"link": "radio"},
            {"links": [{"name": "radio", "locator": "sim/h:1"}]},
            "streams[0].flood: beside link; allowed: one of the two",
        ),
        ({"link": "flood"}, {}, 'streams[0].link: "flood"; allowed: none, no link has a name'),
        ({"flood": 1}, {}, "streams[0].flood: 1"),
        ({}, {"routes": [{"id": 1, "name": "flood", "path": [1, 2]}]}, 'routes[0].name: "flood"'),
        ({}, {"links": [{"locator": "sim/h:1", "port": 96}]}, "links[0].port: 96"),
        ({}, {"wire": "rmw_desert"}, "flood"),
    ],
)  # fmt: skip
def test_wrong_values_are_named(abort: dict[str, Any], changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read(abort, **changes)
    assert words in str(caught.value)
