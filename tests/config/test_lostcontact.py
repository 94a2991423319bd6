"""`lost_contact`: what of it is for this node, and what is refused since it would act too soon."""

from typing import Any

import cbor2

from tests.config.section import changed, message_of
from zacoustic.config import config_from_mapping
from zacoustic.core.peers.lostcontact import LostContactRule

UP: dict[str, Any] = {"name": "up", "lost_after_s": 300, "of": [1], "call": "up", "by": 2}


def test_entries_of_this_node_are_its_rules_and_actions() -> None:
    other = {"name": "alarm", "lost_after_s": 60, "publish": "alarm", "by": 1, "value": "gone"}
    section = changed("lost_contact", [UP | {"of": [1], "value": {"depth": 0}}, other])
    config = config_from_mapping(section, source="f")
    (action,) = config.lost_contact
    rule = LostContactRule(name="up", nodes=(1,), lost_after_s=300)
    assert (action.rule, action.key, action.is_call) == (rule, "up", True)
    assert cbor2.loads(action.payload) == {"depth": 0}
    assert config.rules.contact.lost_contact == (rule,)
    shore = config_from_mapping(section, source="f", address=1)
    (action,) = shore.lost_contact
    assert (action.rule.nodes, action.is_call, action.payload) == ((), False, b"\x64gone")
    assert action.heard_every_s is None


def test_service_of_the_table_has_its_own_type_and_an_opaque_one_has_not() -> None:
    section = changed("lost_contact", [UP | {"call": "auv1/arm"}])
    (action,) = config_from_mapping(section, source="f").lost_contact
    assert (action.stream_id, action.value, action.is_ros) == (20, {}, False)
    section["streams"].append({"id": 21, "service": "auv1/raw", "server": 2})
    section["lost_contact"][0] |= {"call": "auv1/raw", "value": {"up": True}}
    (action,) = config_from_mapping(section, source="f").lost_contact
    assert (action.stream_id, cbor2.loads(action.payload)) == (None, {"up": True})


def test_time_is_twice_the_shortest_heartbeat_of_the_nodes_that_are_contact() -> None:
    section = changed("lost_contact", [UP | {"lost_after_s": 100}])
    section["nodes"].append({"address": 3, "name": "boat", "heartbeat_s": 40})
    section["heartbeat_s"] = 60
    message = message_of(section)
    assert ".lost_contact[0].lost_after_s: 100 with heartbeat_s 60; allowed: 120 or" in message
    section["lost_contact"][0]["of"] = [1, 3]
    (action,) = config_from_mapping(section, source="f").lost_contact
    assert action.heard_every_s == 40
    section["lost_contact"][0]["lost_after_s"] = 79
    assert "79 with heartbeat_s 40; allowed: 80 or more" in message_of(section)


def test_name_is_unique() -> None:
    section = changed("lost_contact", [UP, UP | {"by": 1, "of": [2]}])
    assert (
        '.lost_contact[1].name: "up" a second time, as lost_contact[0].name; allowed'
        in message_of(section)
    )
