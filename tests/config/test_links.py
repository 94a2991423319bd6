"""Several links in one file, and which of them each stream goes by."""

from typing import Any

import pytest

from zacoustic.config import config_from_mapping
from zacoustic.core.profiles.rules import LinkRules
from zacoustic.core.schedule.access.spec import TdmaSpec
from zacoustic.errors import ConfigError


def section(**changes: Any) -> dict[str, Any]:
    """Return a section with sound and a radio."""
    return {
        "address": 1,
        "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
        "max_airtime": 0.5,
        "links": [
            {
                "name": "acoustic",
                "locator": "sim/127.0.0.1:7000",
                "access": {
                    "method": "tdma",
                    "slots": [1, 2],
                    "slot_s": 4,
                    "guard_s": 1,
                    "clock_error_s": 0,
                },
            },
            {"name": "radio", "locator": "udp/239.1.2.3:7000", "max_airtime": 0.9},
        ],
        "streams": [
            {"id": 1, "topic": "{node}/nav"},
            {"id": 2, "topic": "{node}/video", "link": "radio"},
            {"id": 3, "service": "arm", "server": 2, "link": "acoustic"},
            {"id": 4, "action": "dock", "server": 2, "link": "radio"},
        ],
        **changes,
    }


def refused(**changes: Any) -> str:
    """Return why a section is refused."""
    with pytest.raises(ConfigError) as caught:
        config_from_mapping(section(**changes), source="fleet.json5")
    return str(caught.value)


def test_streams_go_by_the_link_that_they_name() -> None:
    config = config_from_mapping(section(), source="fleet.json5")
    rules = config.rules
    assert [each.locator for each in config.links] == ["sim/127.0.0.1:7000", "udp/239.1.2.3:7000"]
    assert [each.name for each in rules.of_links] == ["acoustic", "radio"]
    assert rules.links_of_streams == {2: "radio", 3: "acoustic", 4: "radio"}
    first, second = rules.of_links
    assert isinstance(first.access, TdmaSpec)
    assert first.max_airtime == 0.5
    assert second == LinkRules(name="radio", max_airtime=0.9)
    assert rules.schedule is first.access


def test_link_does_not_change_what_both_ends_must_agree_on() -> None:
    streams = [{**each, "link": "radio"} for each in section()["streams"]]
    one, other = (
        config_from_mapping(section(**changes), source="fleet.json5")
        for changes in ({}, {"streams": streams})
    )
    assert one.table.digest == other.table.digest
    assert one.rules.links_of_streams != other.rules.links_of_streams


def test_link_that_is_given_beside_the_file_stands_for_all() -> None:
    config = config_from_mapping(section(), source="fleet.json5", locator="sim/127.0.0.1:7001")
    assert [each.locator for each in config.links] == ["sim/127.0.0.1:7001"]
    assert config.rules.links_of_streams == {}
    assert len(config.rules.of_links) == 1
    assert isinstance(config.rules.access, TdmaSpec)


def test_one_link_may_have_a_name() -> None:
    links = [{"name": "radio", "locator": "udp/239.1.2.3:7000"}]
    streams = [{"id": 2, "topic": "{node}/video", "link": "radio"}]
    config = config_from_mapping(section(links=links, streams=streams), source="fleet.json5")
    assert [each.name for each in config.rules.of_links] == ["radio"]


@pytest.mark.parametrize(
    ("index", "change", "message"),
    [
        (1, {"name": "acoustic"}, '.links[1].name: "acoustic" a second time; allowed: a name of'),
        (1, {"name": "a@b"}, '.links[1].name: "a@b"; allowed: one chunk of a key'),
        (1, {"wire": "rmw_desert"}, '.links[1].wire: "rmw_desert" with 2 links; allowed: "native"'),
        (1, {"access": {"method": "sing"}}, '.links[1].access.method: "sing"'),
    ],
)
def test_links_that_cannot_work_are_refused(
    index: int, change: dict[str, Any], message: str
) -> None:
    links = section()["links"]
    links[index] = {**links[index], **change}
    assert message in refused(links=links)


def test_stream_of_a_link_that_is_not_there_is_refused() -> None:
    streams = [{"id": 2, "topic": "{node}/video", "link": "optical"}]
    assert '.streams[0].link: "optical"; allowed: acoustic, radio' in refused(streams=streams)
