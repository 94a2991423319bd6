"""What the configuration says of transmitting: access, quiet windows, airtime, permit log."""

from pathlib import Path
from typing import Any

import pytest

from zacoustic.config import config_from_mapping, read_config
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access import (
    AlohaSpec,
    CarrierSenseSpec,
    DelegatedSpec,
    PollingSpec,
    TdmaSpec,
)
from zacoustic.core.schedule.access.spec import AccessSpec
from zacoustic.core.schedule.silence import QuietWindow
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.transport.objects.limits import ObjectLimits
from zacoustic.errors import ConfigError

ACCESS: dict[str, Any] = {
    "method": "tdma", "slots": [1, 2], "slot_s": 3, "max_range_m": 1500, "clock_error_s": 0.01,
}  # fmt: skip


def _rules(**section: object) -> TransmitRules:
    nodes = [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}]
    whole = {"address": 1, "nodes": nodes, **section}
    return config_from_mapping(whole, source="test").rules


def _access(access: object) -> AccessSpec | None:
    return _rules(links=[{"locator": "sim/h:1", "access": access}]).access


def test_each_access_is_read() -> None:
    assert _access(ACCESS) == TdmaSpec(
        slots=(1, 2), slot_s=3.0, max_range_m=1500.0, clock_error_s=0.01
    )
    assert _access({"method": "aloha", "back_off": False}) == AlohaSpec(back_off=False)
    assert _access({"method": "carrier_sense"}) == CarrierSenseSpec()
    assert _access({"method": "delegated"}) == DelegatedSpec()
    polling = {"method": "polling", "poller": 1, "nodes": [2]}
    assert _access(polling) == PollingSpec(poller=1, nodes=(2,))
    assert _rules().access is None


def test_who_gives_commands_is_read() -> None:
    assert _rules().commands_from is None
    assert _rules(commands_from=[]).commands_from == frozenset()
    assert _rules(commands_from=[1]).commands_from == frozenset({1})
    strangers = config_from_mapping({"address": 1, "commands_from": [7]}, source="test")
    assert strangers.rules.commands_from == frozenset({7})


@pytest.mark.parametrize(
    ("written", "problem"),
    [
        ([9], r"commands_from\[0\]: 9 is no node; allowed: 1 \(shore\), 2 \(auv1\)"),
        (["shore"], r'commands_from\[0\]: "shore"'),
        ("all", r'commands_from: "all"; allowed: a list of addresses of nodes; \[\] for nobody'),
    ],
)
def test_commands_from_nowhere_are_an_error(written: object, problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        _rules(commands_from=written)


def test_access_of_the_file_counts_beside_a_locator() -> None:
    section = {"address": 1, "links": [{"locator": "sim/h:1", "access": {"method": "aloha"}}]}
    config = config_from_mapping(section, source="test", locator="desert/h:2")
    assert config.links[0].locator == "desert/h:2"
    assert config.rules.access == AlohaSpec()


def _slot(**settings: object) -> dict[str, object]:
    """Return a schedule whose second slot has these settings."""
    first, second = ({"owners": [each], "for_s": 1, "range_m": 100} for each in (1, 2))
    return {"method": "schedule", "clock_error_s": 0.01, "slots": [first, second | settings]}


@pytest.mark.parametrize(
    ("access", "problem"),
    [
        ({}, ".method: is missing; allowed: aloha, carrier_sense, tdma, schedule"),
        ({"method": "tdam"}, '.method: "tdam"; allowed: aloha, '),
        ({"method": 3}, ".method: 3; allowed: aloha"),
        ("tdma", ': "tdma"; allowed: { method: '),
        ({"method": "carrier_sense", "x": 1}, ".x: unknown key"),
        (ACCESS | {"slotts": 1}, ".slotts: unknown key; allowed: clock_error_s, clock"),
        (ACCESS | {"slots": [1, 3]}, ".slots[1]: 3 is no node; allowed: 1 (shore), 2 (auv1)"),
        (ACCESS | {"clock": 3}, ".clock: 3 is no node"),
        (ACCESS | {"slot_s": "3"}, '.slot_s: "3"; allowed: seconds, above 0'),
        (ACCESS | {"slot_s": 1}, ".slot_s: 1 s is not more than its guard of 1.092 s"),
        (
            ACCESS | {"clock_error_s": None},
            ".clock_error_s: null; allowed: seconds, 0 or more, at most 1e+09 (how wrong may",
        ),
        (
            {each: ACCESS[each] for each in ACCESS if each != "clock_error_s"},
            ".clock_error_s: is missing; allowed: seconds, 0 or more",
        ),
        (_slot(owners=[3]), ".slots[1].owners[0]: 3 is no node; allowed: 1 (shore), 2 (auv1)"),
        (_slot(for_s=0), ".slots[1].for_s: 0; allowed: seconds, above 0"),
        (_slot(range_m=-1), ".slots[1].range_m: -1; allowed: metres, 0..100000"),
        (_slot(range=5), ".slots[1].range: unknown key; allowed: owners, for_s, range_m"),
        (
            _slot() | {"slots": []},
            ".slots: []; allowed: a list of { owners, for_s, range_m }, 1..1024",
        ),
        ({"method": "polling", "poller": 1, "nodes": [1]}, ".nodes: 1 is the poller; allowed"),
        ({"method": "polling", "poller": 3, "nodes": [2]}, ".poller: 3 is no node"),
        ({"method": "aloha", "slot_s": 0}, ".slot_s: 0; allowed: seconds, above 0"),
    ],
)
def test_access_that_is_wrong_says_what_and_why(access: object, problem: str) -> None:
    with pytest.raises(ConfigError) as caught:
        _access(access)
    assert f"test: plugins.acoustic.links[0].access{problem}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_quiet_windows_and_caps_are_read() -> None:
    rules = _rules(quiet=[{"from": "22:00", "to": "06:30"}], max_airtime=0.3)
    hour_ns = 3600 * 10**9
    assert rules.quiet == (QuietWindow(22 * hour_ns, 13 * hour_ns // 2),)
    assert rules.max_airtime == 0.3


@pytest.mark.parametrize(
    ("section", "problem"),
    [
        ({"quiet": [{"from": "24:00", "to": "06:00"}]}, '.quiet[0].from: "24:00"; allowed: a time'),
        ({"quiet": [{"from": "22:00"}]}, ".quiet[0].to: is missing; allowed: a time of day"),
        ({"quiet": [{"from": "6:00", "to": "07:00"}]}, '.quiet[0].from: "6:00"; allowed'),
        ({"quiet": [{"from": "06:00", "to": "06:00"}]}, '.quiet[0].to: "06:00", when it begins'),
        ({"quiet": [{"from": "06:00", "to": "07:00", "x": 1}]}, "unknown key; allowed: from, to"),
        ({"max_airtime": 0}, ".max_airtime: 0; allowed: a share, above 0, at most 1"),
        ({"max_airtime": 1.5}, ".max_airtime: 1.5; allowed: a share"),
        ({"permit_log": ""}, '.permit_log: ""; allowed: a text'),
        (
            {"streams": [{"id": 1, "topic": "a", "max_airtime": 0}]},
            ".streams[0].max_airtime: 0; allowed: a share, above 0, at most 1",
        ),
    ],
)
def test_rules_that_are_wrong_say_what(section: dict[str, object], problem: str) -> None:
    with pytest.raises(ConfigError) as caught:
        _rules(**section)
    assert problem in str(caught.value)


def test_permit_log_is_beside_the_file(tmp_path: Path) -> None:
    path = tmp_path / "fleet.json5"
    path.write_text('{ plugins: { acoustic: { address: 1, permit_log: "log/permit.jsonl" } } }')
    assert read_config(path).permit_log == tmp_path / "log" / "permit.jsonl"


def _contact(nodes: list[dict[str, Any]], **section: object) -> ContactRules:
    named = [{"name": f"n{each['address']}", **each} for each in nodes]
    whole = {"address": 1, "nodes": named, **section}
    return config_from_mapping(whole, source="test").rules.contact


def test_times_of_the_section_are_for_every_node_that_says_no_other() -> None:
    contact = _contact(
        [{"address": 1}, {"address": 2}, {"address": 3, "heartbeat_s": 600, "lost_after_s": 3600}],
        heartbeat_s=60,
        lost_after_s=300,
    )
    assert contact == ContactRules(
        announces=True, heartbeat_s=60, lost_after_s={2: 300, 3: 3600}, others_lost_after_s=300
    )
    assert _contact([{"address": 1, "heartbeat_s": 60}, {"address": 2}]) == ContactRules(
        announces=True, heartbeat_s=60
    )
    assert _contact([{"address": 1}, {"address": 2, "lost_after_s": 9}]) == ContactRules(
        announces=True, lost_after_s={2: 9}
    )
    assert _contact([{"address": 1}]) == ContactRules(announces=True)


@pytest.mark.parametrize(
    ("nodes", "section", "problem"),
    [
        (
            [{"address": 1}, {"address": 2, "heartbeat_s": 60, "lost_after_s": 90}],
            {},
            ".nodes[1].lost_after_s: 90 with heartbeat_s 60 of n2; allowed: 120 or more, twice "
            "heartbeat_s",
        ),
        (
            [{"address": 1}],
            {"heartbeat_s": 60, "lost_after_s": 60},
            "lost_after_s: 60 with heartbeat_s 60; allowed: 120 or more, twice heartbeat_s",
        ),
        (
            [{"address": 1}, {"address": 2, "heartbeat_s": 600}],
            {"lost_after_s": 300},
            "acoustic.lost_after_s: 300 with heartbeat_s 600 of n2; allowed: 1200 or more",
        ),
    ],
)
def test_node_that_would_be_lost_before_it_can_be_heard_is_refused(
    nodes: list[dict[str, Any]], section: dict[str, Any], problem: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        _contact(nodes, **section)
    assert problem in str(caught.value)


def test_on_demand_needs_somebody_who_could_be_asked() -> None:
    stream = {"id": 1, "topic": "a", "forward": "on_demand"}
    with pytest.raises(ConfigError, match=r"streams\[0\].publishers: is missing, and so is nodes"):
        config_from_mapping({"address": 1, "streams": [stream]}, source="test")
    table = config_from_mapping(
        {"address": 1, "streams": [stream | {"publishers": [2]}]}, source="test"
    ).table
    assert table.by_id(1).is_on_demand


# Samples larger than a frame

PHOTO: dict[str, Any] = {"id": 12, "topic": "photo", "reliability": "reliable"}


def _limits(objects: object, **photo: object) -> ObjectLimits:
    return _rules(objects=objects, streams=[PHOTO | photo]).objects


def test_limits_of_objects_are_read() -> None:
    assert _rules().objects == ObjectLimits()
    assert _limits({}) == ObjectLimits()
    assert _limits({"max_bytes": 50_000, "max_waiting": 3, "memory_bytes": 60_000}) == ObjectLimits(
        largest_bytes=50_000, most_outgoing=3, incoming_bytes=60_000
    )
    assert _limits({"max_bytes": 9 << 20}).incoming_bytes == 9 << 20


def test_what_a_topic_says_of_large_samples_is_read() -> None:
    nodes = [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}]
    streams = [PHOTO | {"max_bytes": 200_000, "exclusive": True}, PHOTO | {"id": 13, "topic": "x"}]
    section = {"address": 1, "nodes": nodes, "streams": streams}
    table = config_from_mapping(section, source="test").table
    specs = [table.by_id(stream_id).spec for stream_id in (12, 13)]
    assert [spec.qos.exclusive for spec in specs] == [True, False]
    assert [spec.max_bytes for spec in specs if isinstance(spec, TopicSpec)] == [200_000, None]
    changed = [PHOTO, streams[1]]
    other = config_from_mapping(section | {"streams": changed}, source="test").table
    assert table.digest == other.digest, "each end may tune it alone"


@pytest.mark.parametrize(
    ("objects", "photo", "problem"),
    [
        ({"max_bytes": 0}, {}, "objects.max_bytes: 0; allowed: a number of bytes, 1..268435455"),
        (
            {"max_bytes": 1 << 28},
            {},
            "objects.max_bytes: 268435456; allowed: a number of bytes, 1..268435455",
        ),
        ({"max_bytes": "1M"}, {}, 'objects.max_bytes: "1M"; allowed: a number of bytes'),
        ({"max_waiting": 65}, {}, "objects.max_waiting: 65; allowed: a number, 1..64"),
        (
            {"max_bytes": 1000, "memory_bytes": 999},
            {},
            "objects.memory_bytes: 999; allowed: 1000 or more, not less than max_bytes",
        ),
        ({"max_byte": 1}, {}, "objects.max_byte: unknown key; allowed: max_bytes, max_waiting"),
        ([], {}, "objects: []; allowed: { max_bytes, max_waiting, memory_bytes }"),
        (
            {"max_bytes": 1000},
            {"max_bytes": 1001},
            "streams[0].max_bytes: 1001; allowed: 1..1000 (objects.max_bytes is the most)",
        ),
        ({}, {"max_bytes": 0}, "streams[0].max_bytes: 0; allowed: a number of bytes, 1.."),
        (
            {},
            {"exclusive": True, "reliability": "best_effort"},
            "streams[0].exclusive: true for a best-effort topic, whose samples fit a frame; "
            "allowed: with reliability: reliable",
        ),
        (
            {},
            {"max_bytes": 5, "reliability": "best_effort"},
            "streams[0].max_bytes: 5 for a best-effort topic",
        ),
        ({}, {"exclusive": "yes"}, 'streams[0].exclusive: "yes"; allowed: true, false'),
    ],
)
def test_limits_that_are_wrong_say_what_and_why(
    objects: object, photo: dict[str, Any], problem: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        _limits(objects, **photo)
    assert f"test: plugins.acoustic.{problem}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_former_key_is_refused_with_its_new_name() -> None:
    with pytest.raises(ConfigError, match=r"\.orders_from: unknown key") as refused:
        config_from_mapping({"address": 1, "orders_from": [2]}, source="test")
    assert refused.value.hint == 'did you mean "commands_from"?'
