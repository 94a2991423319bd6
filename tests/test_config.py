"""The configuration: what a section means, and that each mistake in it is one line that helps."""

import copy
import json
import re
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zacoustic.config import Config, config_from_mapping, read_config
from zacoustic.config.later import LATER_VALUES
from zacoustic.config.sections import ALLOWED, RECORDS, ServiceEntry, TopicEntry
from zacoustic.core.qos import Priority, Reliability, Stamp
from zacoustic.core.streamspecs import ServiceSpec, TopicSpec
from zacoustic.core.types import Bounds, FieldSpec
from zacoustic.errors import ConfigError

SECTION: dict[str, Any] = {
    "__required__": False,
    "address": 2,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
    "links": [{"locator": "sim/127.0.0.1:7000#mtu=64"}],
    "types": [
        {
            "name": "Nav",
            "fields": [
                {"name": "lat", "type": "float64", "range": [-90, 90], "step": 1e-6},
                {"name": "mode", "type": "enum", "values": ["idle", "survey"]},
                {"name": "at", "type": "Point", "optional": True},
            ],
        },
        {"name": "Point", "fields": [{"name": "x", "type": "float32", "unit": "m"}]},
        {"name": "Arm", "fields": []},
    ],
    "streams": [
        {
            "id": 10,
            "topic": "auv1/nav",
            "type": "Nav",
            "publishers": [2],
            "subscribers": [1],
            "priority": "real_time",
            "depth": 3,
            "lifespan_s": 60,
            "deadline_s": 90,
            "min_interval_s": 0.5,
            "linger_s": 2,
            "stamp": "age",
            "encoding": "application/json",
            "codec": "cbor",
            "reliability": "best_effort",
            "durability": "volatile",
            "forward": "always",
        },
        {
            "id": 11,
            "topic": "fleet/{node}/{sensor}",
            "wildcards": [{"name": "sensor", "values": ["ctd", "usbl"]}],
        },
        {
            "id": 20,
            "service": "auv1/arm",
            "request": "Arm",
            "response": "Arm",
            "server": 2,
            "timeout_s": 90,
            "priority": "interactive_high",
        },
    ],
    "ranging": [{"by": 2, "to": 1, "every_s": 30}],
}


def changed(path: str, value: object) -> dict[str, Any]:
    """The section with one value changed, added or (`...`) taken out."""
    section = copy.deepcopy(SECTION)
    steps: list[Any] = [int(step) if step.isdigit() else step for step in path.split(".")]
    target: Any = section
    for step in steps[:-1]:
        target = target[step]
    if value is ...:
        del target[steps[-1]]
    elif isinstance(target, list) and steps[-1] == len(target):
        target.append(value)
    else:
        target[steps[-1]] = value
    return section


def message_of(section: object, **given: Any) -> str:
    with pytest.raises(ConfigError) as caught:
        config_from_mapping(section, source="fleet.json5", **given)
    return str(caught.value)


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
    section = changed("links.1", {"locator": "sim/other:7000"})
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
    ("audience", "expected"),
    [
        ({"subscribers": None}, "subscribers: is missing, and so is nodes: nobody is known to ack"),
        ({"subscribers": [2]}, "subscribers: nobody but the publisher; allowed: at least one node"),
        ({"subscribers": [1]}, ""),
        ({"subscribers": [1, 2]}, ""),
    ],
)
def test_reliable_topic_needs_somebody_who_acknowledges(
    audience: dict[str, object], expected: str
) -> None:
    entry = {"id": 1, "topic": "a", "publishers": [2], "reliability": "reliable"}
    entry |= {key: value for key, value in audience.items() if value is not None}
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
    tuned = config_from_mapping(section, source="-")
    assert [stream.spec.journal for stream in usual.table] == [False, False, True]
    assert [stream.spec.journal for stream in tuned.table] == [True, False, False]
    assert tuned.table.digest == usual.table.digest


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


ROOT = "fleet.json5: plugins.acoustic"
PRIORITIES = "real_time, interactive_high, interactive_low, data_high, data, data_low, background"
LATER = "(a later version will have it)"

MISTAKES: list[tuple[str, object, str]] = [
    # keys
    ("adress", 2, ".adress: unknown key; allowed: address, nodes, links, types, journal, streams"),
    ("adress", 2, '(did you mean "address"?)'),
    ("zzz", 2, ".zzz: unknown key; allowed: address, nodes, links, types, journal, streams"),
    ("journal", 3, ".journal: 3; allowed: a text, the folder of the journal"),
    ("journal", "", '.journal: ""; allowed: a text, the folder of the journal'),
    ("journal", "a\0b", "allowed: a text, the folder of the journal"),
    ("journal", "~nobody-at-all/j", "(write the folder out)"),
    ("streams.0.journal", "yes", '.streams[0].journal: "yes"; allowed: true, false'),
    ("streams.2.journal", 1, ".streams[2].journal: 1; allowed: true, false"),
    (
        "nodes.0.nmae",
        2,
        ".nodes[0].nmae: unknown key; allowed: address, name, heartbeat_s, lost_after_s (did",
    ),
    (
        "links.0.locater",
        2,
        ".links[0].locater: unknown key; allowed: locator, wire, allowed_topics, access (did ",
    ),
    ("types.0.feilds", 2, ".types[0].feilds: unknown key; allowed: name, fields, python (did you"),
    (
        "types.0.fields.0.rnage",
        2,
        ".types[0].fields[0].rnage: unknown key; allowed: name, type, ra",
    ),
    ("streams.0.prioritty", 2, ".streams[0].prioritty: unknown key; allowed: id, priority"),
    ("streams.0.prioritty", 2, '(did you mean "priority"?)'),
    ("streams.2.depth", 2, ".streams[2].depth: unknown key; allowed: id, priority, linger_s, enc"),
    (
        "streams.1.wildcards.0.valeus",
        2,
        ".streams[1].wildcards[0].valeus: unknown key; allowed: na",
    ),
    # missing keys
    ("nodes.0.address", ..., ".nodes[0].address: is missing; allowed: an address, 1..254"),
    ("links.0.locator", ..., ".links[0].locator: is missing; allowed: a text, NAME/ADDRESS"),
    ("types.0.name", ..., ".types[0].name: is missing; allowed: a text"),
    (
        "types.0.fields",
        ...,
        ".types[0].fields: is missing; allowed: a list of { name, type, … }, o",
    ),
    ("types.0.fields.0.type", ..., ".types[0].fields[0].type: is missing; allowed: bool, int8"),
    ("streams.0.id", ..., ".streams[0].id: is missing; allowed: a number, 1..175"),
    (
        "streams.0.topic",
        ...,
        ".streams[0]: none of topic, service, action; allowed: one of topic, service, action",
    ),
    (
        "streams.2.topic",
        "a",
        ".streams[2]: topic and service; allowed: one of topic, service, action",
    ),
    ("streams.2.server", ..., ".streams[2].server: is missing; allowed: the address of a node"),
    (
        "address",
        ...,
        ".address: is missing; allowed: 1 (shore), 2 (auv1) (add it, or give --address)",
    ),
    # wrong kinds
    ("address", "two", '.address: "two"; allowed: an address, 1..254'),
    ("address", 2.5, ".address: 2.5; allowed: an address, 1..254"),
    ("nodes", {"1": "shore"}, '.nodes: {"1": "shore"}; allowed: a list of { address, name }'),
    ("nodes.0", "shore", '.nodes[0]: "shore"; allowed: a list of { address, name }'),
    ("nodes.0.name", 4, ".nodes[0].name: 4; allowed: a text"),
    ("links.0", None, ".links[0]: null; allowed: a list with one { locator }"),
    (
        "types.0.fields.0.range",
        [1, 2, 3],
        ".types[0].fields[0].range: [1, 2, 3]; allowed: a list of",
    ),
    (
        "types.0.fields.0.range",
        ["a", 2],
        '.types[0].fields[0].range[0]: "a"; allowed: a list of two',
    ),
    ("types.0.fields.0.step", "1/0", '.types[0].fields[0].step: "1/0"; allowed: a number above 0'),
    ("types.0.fields.0.step", "x", '.types[0].fields[0].step: "x"; allowed: a number above 0'),
    ("types.0.fields.1.values", "a", '.types[0].fields[1].values: "a"; allowed: a list of texts'),
    (
        "streams",
        {},
        ".streams: {}; allowed: a list of { id, topic, … }, { id, service, … } or { id, action",
    ),
    ("streams.0", 3, ".streams[0]: 3; allowed: a list of { id, topic, … }, {"),
    ("streams.0.id", "10", '.streams[0].id: "10"; allowed: a number, 1..175'),
    ("streams.0.publishers", 2, ".streams[0].publishers: 2; allowed: a list of addresses of nodes"),
    ("streams.0.publishers", ["x"], '.streams[0].publishers[0]: "x"; allowed: a list of addresses'),
    ("streams.0.lifespan_s", "1", '.streams[0].lifespan_s: "1"; allowed: seconds, above 0'),
    ("streams.0.topic", None, ".streams[0].topic: null; allowed: a text, a key expression"),
    ("streams.0.depth", 1.5, ".streams[0].depth: 1.5; allowed: a number, 1..65535"),
    # nodes and links
    ("nodes.0.address", 0, ".nodes[0].address: 0; allowed: 1..254"),
    ("nodes.0.address", 255, ".nodes[0].address: 255; allowed: 1..254"),
    ("nodes.1.address", 1, ".nodes[1].address: 1 is the address of shore; allowed: an address of"),
    ("nodes.1.name", "shore", '.nodes[1].name: "shore" a second time; allowed: a name of its own'),
    ("nodes.1.name", "a/b", '.nodes[1].name: "a/b"; allowed: one chunk of a key, without /'),
    ("nodes.1.name", "", '.nodes[1].name: ""; allowed: one chunk of a key'),
    ("nodes.1.name", "{x}", '.nodes[1].name: "{x}"; allowed: one chunk of a key'),
    ("address", 3, ".address: 3; allowed: 1 (shore), 2 (auv1)"),
    ("address", 0, ".address: 0; allowed: 1 (shore), 2 (auv1)"),
    ("links.0.locator", "modem", '.links[0].locator: "modem"; allowed: NAME/ADDRESS, such as "sim'),
    ("links.0.locator", "/dev", '.links[0].locator: "/dev"; allowed: NAME/ADDRESS'),
    ("links.0.wire", "rmw", '.links[0].wire: "rmw"; allowed: native'),
    # types
    (
        "types.0.fields.0.range",
        [90, -90],
        ".types[0].fields[0].range: [90, -90]; allowed: low < high",
    ),
    (
        "types.0.fields.0.type",
        "flaot64",
        '.types[0].fields[0].type: "flaot64" is not built in, and',
    ),
    ("types.0.fields.0.type", "flaot64", '(did you mean "float64"?)'),
    (
        "types.0.fields.1.type",
        "emun",
        '.types[0].fields[1].type: "emun" is not built in, and has v',
    ),
    (
        "types.1.fields.0.type",
        "flaot32",
        '.types[1].fields[0].type: "flaot32" is not known; allowed',
    ),
    ("types.1.fields.0.type", "flaot32", '(did you mean "float32"?)'),
    (
        "types.1.fields.0.type",
        "Nav",
        ".types[1].fields[0].type: a cycle, Nav → Point → Nav; allowed",
    ),
    ("types.1.name", "Nav", '.types[1].name: "Nav" a second time; allowed: once'),
    ("types.1.name", "bool", '.types[1].name: "bool"; allowed: a name that is not a built-in type'),
    ("types.1.fields.0.default", "x", ".types[1].fields[0].default: Point.x is 'x'; allowed: a"),
    ("types.1.fields.0.name", "1", '.types[1].fields[0].name: "1"; allowed: letters, digits'),
    ("types.1.python", "nowhere", '.types[1].python: "nowhere"; allowed: "module:Class"'),
    ("types.1.python", ":C", '.types[1].python: ":C"; allowed: "module:Class"'),
    (
        "types.1.python",
        "nowhere.at_all:Nav",
        '.types[1].python: "nowhere.at_all:Nav" cannot be imported: ModuleNotFoundError: No module',
    ),
    ("types.1.python", "nowhere.at_all:Nav", "(is its folder on PYTHONPATH?)"),
    (
        "types.1.python",
        "json:loads",
        '.types[1].python: "json:loads" is no msgspec.Struct; allowed',
    ),
    (
        "types.1.python",
        "json:nothing.at.all",
        '.types[1].python: "json:nothing.at.all" is no msgsp',
    ),
    # streams
    (
        "streams.1.id",
        10,
        ".streams[1].id: 10 is taken by auv1/nav (give each stream an id of its own)",
    ),
    ("streams.0.id", 0, ".streams[0].id: 0; allowed: 1..175"),
    ("streams.0.id", 176, ".streams[0].id: 176; allowed: 1..175"),
    (
        "streams.2.service",
        "auv1/nav",
        '.streams[2].service: "auv1/nav" is taken by stream 10 (give',
    ),
    (
        "streams.1",
        {"id": 11, "topic": "auv1/nav"},
        '.streams[1].topic: "auv1/nav" is taken by stream',
    ),
    (
        "streams.0.type",
        "Nva",
        '.streams[0].type: "Nva" is not known; allowed: Nav, Point, Arm (did',
    ),
    (
        "streams.2.request",
        "Amr",
        '.streams[2].request: "Amr" is not known; allowed: Nav, Point, Arm',
    ),
    ("streams.2.response", "X", '.streams[2].response: "X" is not known; allowed: Nav, Point, Arm'),
    (
        "streams.0.publishers",
        [3],
        ".streams[0].publishers[0]: 3 is no node; allowed: 1 (shore), 2 (",
    ),
    ("streams.0.publishers", [3], "(add it to nodes)"),
    ("streams.0.subscribers", [1, 1], ".streams[0].subscribers[1]: 1 a second time; allowed: each"),
    (
        "streams.0.publishers",
        [],
        ".streams[0].publishers: []; allowed: at least one address (leave",
    ),
    ("streams.2.server", 9, ".streams[2].server: 9 is no node; allowed: 1 (shore), 2 (auv1)"),
    (
        "streams.0.topic",
        "/auv1/nav",
        '.streams[0].topic: "/auv1/nav" starts with "/"; allowed: Zenoh',
    ),
    ("streams.0.topic", "/auv1/nav", 'which do not: "auv1/nav"'),
    (
        "streams.0.topic",
        "auv1/*",
        '.streams[0].topic: "auv1/*" contains "*"; allowed: no wildcards',
    ),
    ("streams.0.topic", "a/{sensor}", '.streams[0].topic: "a/{sensor}" has {sensor}, which is not'),
    ("streams.0.topic", "a/{sensor}", '(add wildcards: [{ name: "sensor", values: […] }])'),
    ("streams.0.topic", "", '.streams[0].topic: "" is empty; allowed: a key expression'),
    ("streams.0.topic", "a//b", '.streams[0].topic: "a//b" has an empty chunk; allowed: chunks'),
    ("streams.0.topic", "@x", '.streams[0].topic: "@x" starts with "@", which'),
    (
        "streams.2.service",
        "a/{node}",
        '.streams[2].service: "a/{node}" has a placeholder; allowed in',
    ),
    (
        "streams.1.wildcards.0.values",
        [],
        ".streams[1].wildcards[0].values: 0 values; allowed: 1..255",
    ),
    ("streams.1.wildcards.0.name", "x", ".streams[1].topic: "),
    ("streams.0.priority", "urgent", f'.streams[0].priority: "urgent"; allowed: {PRIORITIES}'),
    ("streams.0.depth", 0, ".streams[0].depth: 0; allowed: 1..65535"),
    ("streams.0.lifespan_s", 0, ".streams[0].lifespan_s: 0; allowed: above 0"),
    ("streams.0.min_interval_s", -1, ".streams[0].min_interval_s: -1; allowed: 0 or more"),
    ("streams.0.deadline_s", 0, ".streams[0].deadline_s: 0; allowed: 0.1 or more"),
    (
        "streams.0.deadline_s",
        0.5,
        ".streams[0].deadline_s: 0.5; allowed: above min_interval_s, which is 0.5",
    ),
    ("streams.2.deadline_s", 9, ".streams[2].deadline_s: unknown key"),
    ("streams.2.linger_s", -1, ".streams[2].linger_s: -1; allowed: 0 or more"),
    ("ranging", {}, ".ranging: {}; allowed: a list of { to, every_s }"),
    ("ranging.0.to", "auv1", '.ranging[0].to: "auv1"; allowed: the address of another node'),
    ("ranging.0.to", 9, ".ranging[0].to: 9 is no node; allowed: 1 (shore), 2 (auv1)"),
    ("ranging.0.to", 2, ".ranging[0].to: 2 is the node that measures; allowed: another node"),
    (
        "ranging.0",
        {"to": 2, "every_s": 3},
        "(say by whom, so that one file serves a fleet: by: ADDRESS)",
    ),
    ("ranging.0.to", ..., ".ranging[0].to: is missing; allowed: the address of another node"),
    ("ranging.0.by", 1, ".ranging[0].to: 1 is the node that measures; allowed: another node"),
    ("ranging.0.by", 9, ".ranging[0].by: 9 is no node; allowed: 1 (shore), 2 (auv1)"),
    ("ranging.0.every_s", 0.5, ".ranging[0].every_s: 0.5; allowed: seconds, 1..86400"),
    ("ranging.0.every_s", -1, ".ranging[0].every_s: -1; allowed: seconds, 1..86400"),
    ("ranging.0.every_s", "5", '.ranging[0].every_s: "5"; allowed: seconds, 1..86400'),
    ("ranging.0.every_s", ..., ".ranging[0].every_s: is missing; allowed: seconds, 1..86400"),
    ("ranging.0.rate", 1, ".ranging[0].rate: unknown key; allowed: to, every_s, by"),
    ("ranging.1", {"to": 1, "every_s": 9}, ".ranging[1].to: 1 a second time; allowed: each"),
    ("streams.2.timeout_s", 0, ".streams[2].timeout_s: 0.0; allowed: above 0"),
    ("streams.0.stamp", "clock", '.streams[0].stamp: "clock"; allowed: none, age'),
    (
        "streams.0.encoding",
        "text/plain",
        '.streams[0].encoding: "text/plain"; allowed: for a typed',
    ),
    ("streams.1.encoding", "", '.streams[1].encoding: ""; allowed: 1..255 bytes of text'),
    (
        "streams.1.codec",
        "cbor",
        '.streams[1].codec: "cbor" for opaque bytes; allowed: typed streams; here packed',
    ),
    (
        "streams.0.reliability",
        "no",
        '.streams[0].reliability: "no"; allowed: best_effort, reliable',
    ),
    (
        "streams.0.journal",
        True,
        ".streams[0].journal: true for a best-effort topic, of which nothing is promised; allowed: "
        "with reliability: reliable (say reliability, or leave journal out)",
    ),
    (
        "streams.0.forward",
        "never",
        'streams[0].forward: "never"; allowed: always, on_demand',
    ),
    ("heartbeat_s", 0.5, ".heartbeat_s: 0.5; allowed: seconds, 1 or more"),
    ("lost_after_s", 0, ".lost_after_s: 0; allowed: seconds, above 0"),
    ("nodes.0.heartbeat_s", 0, ".nodes[0].heartbeat_s: 0; allowed: seconds, 1 or more"),
    ("nodes.1.lost_after_s", -3, ".nodes[1].lost_after_s: -3; allowed: seconds, above 0"),
    ("nodes.1.lost_after_s", "5m", '.nodes[1].lost_after_s: "5m"; allowed: seconds, above 0'),
    # later
    ("ros", {"domain": 233}, ".ros.domain: 233; allowed: a number, 0..232"),
    ("ros", {"distro": "jezzy"}, '.ros.distro: "jezzy"; allowed: humble, iron, jazzy'),
    ("ros", {"namspace": "a"}, ".ros.namspace: unknown key; allowed: distro, domain, namespace"),
    ("ros", {"namespace": "a b"}, '.ros.namespace: "a b"; allowed: a ROS namespace'),
    ("ros", {"packages": "nowhere"}, '.ros.packages: "nowhere" is no folder; allowed: a folder'),
    ("overlays", [{"type": "a"}], ".overlays[0].fields: is missing; allowed: a list of"),
    (
        "overlays",
        [{"type": "std_msgs/msg/Bool", "fields": [{"field": "dat"}]}],
        '.overlays[0].fields[0].field: "dat" names no member of std_msgs/msg/Bool; allowed: ',
    ),
    (
        "overlays",
        [{"type": "std_msgs/msg/Bool", "fields": [{"feld": "dat"}]}],
        ".overlays[0].fields[0].feld: unknown key; allowed: field, range, step, unit, wraps",
    ),
    ("overlays", [{"type": "Nav", "fields": []}], '.overlays[0].type: "Nav" is no interface of'),
    ("links.0.wire", "rmw", '.links[0].wire: "rmw"; allowed: native, rmw_desert'),
    (
        "links.1",
        {"locator": "a/b"},
        ".links: 2 links; more than one is not available yet; allowed: ",
    ),
    (
        "streams.0.durability",
        "for_ever",
        'durability: "for_ever"; allowed: volatile, transient_local',
    ),
    (
        "streams.0.codec",
        "zip",
        '.streams[0].codec: "zip"; allowed: cbor, packed, dense',
    ),
    (
        "streams.0.stamp",
        "time",
        '.streams[0].stamp: "time" is not available yet; allowed: none, age',
    ),
    (
        "streams.0.ros",
        {},
        '.streams[0].type: "Nav"; allowed: a ROS type, such as "geometry_msgs/msg/Twist"',
    ),
    ("streams.0.ros", {"stmp": 1}, ".streams[0].ros.stmp: unknown key; allowed: stamp"),
    (
        "streams.3",
        {"id": 30, "action": "auv1/goto", "goal": "Nav"},
        ".streams[3].server: is missing; allowed: the address of a node",
    ),
    (
        "streams.3",
        {"id": 30, "action": "auv1/goto", "goal": "Nov", "server": 2},
        '.streams[3].goal: "Nov" is not known; allowed: ',
    ),
    (
        "streams.3",
        {"id": 30, "action": "auv1/goto", "feedback": "Nov", "server": 2},
        '.streams[3].feedback: "Nov" is not known; allowed: ',
    ),
    (
        "streams.3",
        {"id": 30, "action": "auv1/goto", "server": 9},
        ".streams[3].server: 9 is no node; allowed: 1",
    ),
    (
        "streams.3",
        {"id": 30, "action": "auv1/{node}", "server": 2},
        '.streams[3].action: "auv1/{node}" has a placeholder; allowed in topics only',
    ),
    (
        "streams.3",
        {"id": 30, "action": "auv1/goto", "server": 2, "result_timeout_s": 0},
        ".streams[3].result_timeout_s: 0",
    ),
    (
        "streams.3",
        {"id": 30, "action": "auv1/goto", "server": 2, "depth": 3},
        ".streams[3].depth: unknown key; allowed: id, priority",
    ),
]


@pytest.mark.parametrize(("path", "value", "expected"), MISTAKES)
def test_mistake_is_one_line_with_file_key_value_and_what_is_allowed(
    path: str, value: object, expected: str
) -> None:
    message = message_of(changed(path, value))
    assert message.startswith(f"{ROOT}.")
    assert expected in message
    assert "\n" not in message
    assert len(message) < 400


@pytest.mark.parametrize("section", [None, [], 3, "text"])
def test_section_that_is_no_table_is_refused(section: object) -> None:
    assert message_of(section).startswith(f"{ROOT}: ")
    assert message_of(section).endswith(
        "{ address, nodes, links, types, journal, streams, ranging }"
    )


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
        f"{ROOT}.address: is missing; allowed: 1..254 (add it, or give --address)"
    )


def test_without_a_list_of_nodes_any_address_may_publish_but_nobody_has_a_name() -> None:
    stream = {"id": 1, "topic": "a", "publishers": [200]}
    config_from_mapping({"address": 1, "streams": [stream]}, source="-")
    stream["publishers"] = [255]
    message = message_of({"address": 1, "streams": [stream]})
    assert ".streams[0].publishers[0]: 255; allowed: an address, 1..254" in message
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
    assert len(message_of({"k" * 10000: 1})) < 300


# Types in Python


class Nav(msgspec.Struct):
    lat: Annotated[float, Bounds(-90, 90, step=1e-6)]
    mode: Literal["idle", "survey"]


class Unbounded(msgspec.Struct):
    values: list[int]


@pytest.fixture
def mission(monkeypatch: pytest.MonkeyPatch) -> None:
    module = type(sys)("mission_of_test")
    module.Nav = Nav  # type: ignore[attr-defined]
    module.Unbounded = Unbounded  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "mission_of_test", module)


def with_type(**keys: Any) -> dict[str, Any]:
    return {"address": 1, "types": [{"name": "N", **keys}]}


FIELDS: list[dict[str, Any]] = [
    {"name": "lat", "type": "float64", "range": [-90, 90], "step": 1e-6},
    {"name": "mode", "type": "enum", "values": ["idle", "survey"]},
]


@pytest.mark.usefixtures("mission")
def test_type_comes_from_python_or_the_file_or_both() -> None:
    written = config_from_mapping(with_type(fields=FIELDS), source="-")
    both = config_from_mapping(with_type(fields=FIELDS, python="mission_of_test:Nav"), source="-")
    python = config_from_mapping(with_type(python="mission_of_test:Nav"), source="-")
    assert python.types["N"].name == "N"
    assert python.python_types == both.python_types == {"N": Nav}
    assert written.python_types == {}
    described = {config.types["N"].canonical() for config in (written, both, python)}
    assert len(described) == 1


@pytest.mark.usefixtures("mission")
def test_file_and_python_that_differ_are_an_error_at_the_field() -> None:
    fields = copy.deepcopy(FIELDS)
    fields[0]["step"] = 1e-5
    message = message_of(with_type(fields=fields, python="mission_of_test:Nav"))
    assert message == (
        f"{ROOT}.types[0].fields[0].step: 1e-05; allowed: 1e-06, as the Python class says"
    )


@pytest.mark.usefixtures("mission")
def test_class_without_a_meaning_on_the_wire_names_class_and_field() -> None:
    message = message_of(with_type(python="mission_of_test:Unbounded"))
    assert (
        f'{ROOT}.types[0].python: "mission_of_test:Unbounded": N.values: max_length: a' in message
    )


def test_module_that_fails_while_it_is_imported_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "failing_of_test.py").write_text("raise OSError('no\\nway')\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    message = message_of(with_type(python="failing_of_test:Nav"))
    assert '"failing_of_test:Nav" cannot be imported: OSError: no way; allowed' in message


# Files


def test_file_is_read_with_the_rest_of_zenoh_s_settings(tmp_path: Path) -> None:
    path = tmp_path / "router.json5"
    path.write_text(
        """{ mode: "router",  // ordinary Zenoh
             plugins_loading: { enabled: false },
             plugins: { acoustic: { __required__: false, address: 1,
               streams: [ { id: 10, topic: "auv1/nav", }, ] } } }""",
        encoding="utf-8",
    )
    config = read_config(path)
    assert config.source == str(path)
    assert config.table.by_id(10).name == "auv1/nav"
    assert config.zenoh_config is not None
    assert config.zenoh_config.get_json("mode") == '"router"'
    assert read_config(path, address=5, locator="sim/h:1").address == 5


def test_file_without_router_settings_is_enough(tmp_path: Path) -> None:
    path = tmp_path / "direct.json5"
    path.write_text("{ plugins: { acoustic: { address: 1 } } }", encoding="utf-8")
    assert read_config(path).address == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{ mode: ", r"router\.json5:\d+:\d+: "),
        ("{}", r"router\.json5: no section plugins\.acoustic"),
        ("{ plugins: { acoustic: 3 } }", r"router\.json5: plugins\.acoustic must be object"),
        (
            "{ plugins: { acoustic: { address: 0 } } }",
            r"router\.json5: plugins\.acoustic\.address: 0; allowed: 1\.\.254",
        ),
    ],
)
def test_bad_file_is_one_line_with_its_name(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "router.json5"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message) as caught:
        read_config(path)
    assert "\n" not in str(caught.value)


def test_missing_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.json5"):
        read_config(tmp_path / "nowhere.json5")


# Documentation

DOCUMENT = (Path(__file__).parents[1] / "docs" / "config.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("record", [*RECORDS.values(), TopicEntry, ServiceEntry, FieldSpec])
def test_every_key_is_in_the_reference(record: type[msgspec.Struct]) -> None:
    documented = set(re.findall(r"^\| `(\w+)` \|", DOCUMENT, re.MULTILINE))
    assert set(record.__struct_encode_fields__) <= documented
    assert set(record.__struct_encode_fields__) <= set(ALLOWED)


def test_every_later_word_is_in_the_reference() -> None:
    for key, words in LATER_VALUES.items():
        for word in words:
            assert f'`{key}: "{word}"`' in DOCUMENT


def test_examples_of_the_reference_are_read(tmp_path: Path) -> None:
    examples = re.findall(r"```json5\n(\{.*?)```", DOCUMENT, re.DOTALL)
    assert examples
    for number, text in enumerate(examples):
        path = tmp_path / f"example{number}.json5"
        path.write_text(text, encoding="utf-8")
        assert isinstance(read_config(path), Config)


# Anything else

KEYS = st.sampled_from(sorted(ALLOWED)) | st.text(max_size=5)
JSON_VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**70), 2**70)
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from(["Nav", "enum", "float32", "best_effort", "a/{node}", "data"]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=4),
    max_leaves=12,
)


def read_or_refuse(section: object) -> None:
    try:
        config = config_from_mapping(section, source="x")
    except ConfigError as error:
        message = str(error)
        if "\n" in message or not message.startswith("x: plugins.acoustic"):
            raise AssertionError(message) from error
    else:
        assert config.table.digest


@settings(deadline=None)
@given(JSON_VALUES | st.dictionaries(KEYS, JSON_VALUES, max_size=5))
def test_anything_is_a_config_or_a_config_error(section: object) -> None:
    read_or_refuse(section)


@settings(deadline=None, max_examples=300)
@given(st.data())
def test_any_change_of_a_section_is_a_config_or_a_config_error(data: st.DataObject) -> None:
    section: Any = copy.deepcopy(SECTION)
    for _ in range(data.draw(st.integers(1, 2))):
        target: Any = section
        while True:
            keys = list(target) if isinstance(target, dict) else list(range(len(target)))
            if not keys:
                break
            key = data.draw(st.sampled_from(keys))
            inner = target[key]
            if isinstance(inner, dict | list) and inner and data.draw(st.integers(0, 3)):
                target = inner
                continue
            target[key] = data.draw(JSON_VALUES)
            break
        if isinstance(target, dict) and data.draw(st.booleans()):
            target[data.draw(KEYS)] = data.draw(JSON_VALUES)
    read_or_refuse(section)


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
