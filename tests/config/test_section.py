"""What a section means."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.config.section import ROOT, SECTION, changed, message_of
from zacoustic.config import config_from_mapping, read_config
from zacoustic.core.base.qos import Priority, Reliability, Stamp
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.errors import ConfigError


def test_section_is_read() -> None:
    config = config_from_mapping(SECTION, source="fleet.json5")
    assert config.address == 2
    assert config.name == "auv1"
    assert config.nodes == {1: "shore", 2: "auv1"}
    assert config.address_of("shore") == 1
    assert [link.locator for link in config.links] == ["sim/127.0.0.1:7000#mtu=64"]
    assert [spec.name for spec in config.types] == ["Nav", "Point", "Arm"]
    assert config.zenoh_config is None
    topic = config.table.by_id(10).spec
    assert isinstance(topic, TopicSpec)
    assert (topic.publishers, topic.subscribers) == ((2,), (1,))
    assert topic.encoding == "application/json"
    qos = topic.qos
    assert (qos.priority, qos.stamp, qos.depth) == (Priority.REAL_TIME, Stamp.AGE, 3)
    assert (qos.lifespan_s, qos.min_interval_s, qos.linger_s) == (60, 0.5, 2)
    assert qos.deadline_s == 90
    assert config.table.by_id(11).keys.key(1, (1,)) == "fleet/shore/usbl"
    service = config.table.by_id(20).spec
    assert isinstance(service, ServiceSpec)
    assert (service.server, service.timeout_s) == (2, 90)
    assert (service.request_type, service.response_type) == ("Arm", "Arm")
    assert service.qos.priority is Priority.INTERACTIVE_HIGH


def test_least_section_is_an_address() -> None:
    config = config_from_mapping({"address": 1}, source="-")
    assert (config.nodes, config.links, len(config.table), config.name) == ({}, (), 0, None)
    assert config_from_mapping({}, source="-", address=7).address == 7


def test_address_and_locator_beside_the_file_win() -> None:
    section = changed(
        "links", [{"name": name, "locator": "sim/other:7000"} for name in ("sound", "radio")]
    )
    config = config_from_mapping(section, source="-", address=1, locator="desert/host:4000")
    assert config.address == 1
    assert [link.locator for link in config.links] == ["desert/host:4000"]
    assert (
        config_from_mapping({}, source="-", address=1, locator="sim/h:1").links[0].wire == "native"
    )


def test_order_of_keys_does_not_change_the_digest() -> None:
    def turned(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: turned(value[key]) for key in reversed(value)}
        return [turned(each) for each in value] if isinstance(value, list) else value

    one = config_from_mapping(SECTION, source="-")
    other = config_from_mapping(turned(SECTION), source="-")
    assert one.table.digest == other.table.digest


def test_nodes_share_a_digest_whatever_their_address() -> None:
    one = config_from_mapping(SECTION, source="-", address=1)
    assert one.table.digest == config_from_mapping(SECTION, source="-", address=2).table.digest


def test_reliable_topic_is_one_for_both_ends_with_its_depth() -> None:
    usual = config_from_mapping(SECTION, source="-").table
    reliable = config_from_mapping(changed("streams.0.reliability", "reliable"), source="-").table
    assert reliable.by_id(10).qos.reliability is Reliability.RELIABLE
    section = changed("streams.0.reliability", "reliable")
    section["streams"][0]["depth"] = 4
    deeper = config_from_mapping(section, source="-").table
    assert len({usual.digest, reliable.digest, deeper.digest}) == 3


@pytest.mark.parametrize(
    ("ends", "expected"),
    [
        ({"subscribers": None}, "subscribers: is missing, and so is nodes: nobody is known to ack"),
        ({"subscribers": [2]}, "subscribers: nobody but the publisher; allowed: at least one node"),
        ({"subscribers": [1]}, ""),
        ({"subscribers": [1, 2]}, ""),
    ],
)
def test_reliable_topic_needs_somebody_who_acknowledges(
    ends: dict[str, object], expected: str
) -> None:
    entry = {"id": 1, "topic": "a", "publishers": [2], "reliability": "reliable"}
    entry |= {key: value for key, value in ends.items() if value is not None}
    section = {"address": 2, "streams": [entry]}
    if not expected:
        assert config_from_mapping(section, source="-").table.by_id(1)
        return
    with pytest.raises(ConfigError, match=re.escape(expected)):
        config_from_mapping(section, source="-")


def test_what_a_node_keeps_in_its_journal_is_its_own_affair() -> None:
    section = changed("streams.0.reliability", "reliable")
    usual = config_from_mapping(section, source="-")
    section = changed("streams.0.reliability", "reliable")
    section["streams"][0]["journal"] = True
    section["streams"][2]["journal"] = False
    other = config_from_mapping(section, source="-")
    assert [stream.spec.journal for stream in usual.table] == [False, False, True]
    assert [stream.spec.journal for stream in other.table] == [True, False, False]
    assert other.table.digest == usual.table.digest


def test_folder_of_the_journal_is_relative_to_that_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "fleet.json5"
    for written, expected in (
        ("state/acoustic", tmp_path / "state" / "acoustic"),
        (str(tmp_path.parent), tmp_path.parent),
        ("~/acoustic", Path.home() / "acoustic"),
    ):
        section = {**SECTION, "journal": written}
        path.write_text(json.dumps({"plugins": {"acoustic": section}}), encoding="utf-8")
        assert read_config(path).journal == expected
    assert config_from_mapping(SECTION, source="-").journal is None


def test_ranges_are_those_that_this_node_measures() -> None:
    section = changed(
        "ranging", [{"by": 2, "to": 1, "every_s": 30}, {"by": 1, "to": 2, "every_s": 9.5}]
    )
    for address, expected in ((1, {2: 9.5}), (2, {1: 30.0})):
        config = config_from_mapping(section, source="fleet.json5", address=address)
        assert config.ranges_to() == expected
    assert config_from_mapping(SECTION, source="fleet.json5").ranges_to() == {1: 30.0}
    alone = {"address": 7, "ranging": [{"to": 3, "every_s": 1}]}
    assert config_from_mapping(alone, source="fleet.json5").ranges_to() == {3: 1.0}


def test_address_given_beside_the_file_is_checked() -> None:
    message = message_of(SECTION, address=9)
    assert message == f"{ROOT}.address: 9, given beside the file; allowed: 1 (shore), 2 (auv1)"
    assert message_of({}) == (
        f"{ROOT}.address: is missing; allowed: an address, 1..254 (add it, or give --address)"
    )


def test_without_a_list_of_nodes_any_address_may_publish_but_nobody_has_a_name() -> None:
    stream = {"id": 1, "topic": "a", "publishers": [200]}
    config_from_mapping({"address": 1, "streams": [stream]}, source="-")
    stream["publishers"] = [255]
    message = message_of({"address": 1, "streams": [stream]})
    assert ".streams[0].publishers[0]: 255; allowed: the address of a node, 1..254" in message
    message = message_of({"address": 1, "streams": [{"id": 1, "topic": "{node}/a"}]})
    assert '.streams[0].topic: "{node}/a" has {node}, and nodes is empty' in message


def test_unknown_node_name_lists_the_names() -> None:
    config = config_from_mapping(SECTION, source="fleet.json5")
    with pytest.raises(ConfigError, match='no node is called "auv2"; allowed: shore, auv1'):
        config.address_of("auv2")
    with pytest.raises(ConfigError, match="allowed: none, nodes is empty"):
        config_from_mapping({"address": 1}, source="-").address_of("x")


@pytest.mark.parametrize(
    ("section", "expected"),
    [
        ({1: 2}, ".1: unknown key; allowed: address, nodes"),
        ({"address": 1, "streams": [{1: 2}]}, ".streams[0]"),
        ({"address": 1, "nodes": [{1: 2}]}, ".nodes[0]"),
        ({"address": object()}, '.address: "object"; allowed: an address'),
        ({"address": {(1, 2): 3}}, ".address: dict; allowed: an address"),
        ({"address": 10**400}, ".address: 1000"),
        ({"address": 1, "streams": [{"id": 1, "topic": "a", "lifespan_s": 10**400}]}, "lifespan_s"),
        ({"address": 1, "streams": [{"id": 1, "topic": "a", "linger_s": float("nan")}]}, ": NaN;"),
    ],
)
def test_section_that_no_file_can_hold_is_refused_too(section: object, expected: str) -> None:
    message = message_of(section)
    assert expected in message
    assert "\n" not in message


def test_huge_and_odd_values_are_shown_on_one_short_line() -> None:
    odd: list[object] = ["x" * 10000, "line\nbreak\x1b", list(range(1000)), {"a": {"b": []}}]
    for value in odd:
        message = message_of(changed("streams.0.id", value))
        assert "\n" not in message
        assert "\x1b" not in message
        assert len(message) < 200
    assert len(message_of({"k" * 10000: 1})) < 400


def test_a_step_may_be_a_ratio_and_is_meant_exactly() -> None:
    fields = SECTION["types"][0]["fields"]
    section = changed("types.0.fields", [{**fields[0], "step": "1/60000"}, *fields[1:]])
    spec = config_from_mapping(section, source="test").types.by_name("Nav")
    lat = spec.fields[0]
    assert lat.step == 1 / 60000
    assert lat.quantiser is not None
    for count in (0, 1, 7, 2_591_234, -5_400_000):
        assert lat.quantiser.value(count) == count / 60000
        assert lat.quantiser.count(count / 60000 + 0.4 / 60000) == count


def test_reference_to_a_node_shows_the_fleet_on_one_line() -> None:
    section = changed("nodes.0.name", "a\nb")
    section["streams"][2]["server"] = 300
    message = message_of(section)
    assert message.endswith(
        ".streams[2].server: 300; allowed: 1 (a\N{REPLACEMENT CHARACTER}b), 2 (auv1)"
    )
    section["nodes"], section["streams"] = [], section["streams"][2:]
    assert message_of(section).endswith(".server: 300; allowed: the address of a node, 1..254")
