"""Carried topics in a file."""

from typing import Any

import pytest

from zacoustic.config import config_from_mapping
from zacoustic.core.streams.carry import CARRY_STREAM_ID, DEFAULT_MAX_BYTES, Carry
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.errors import ConfigError

LOG: dict[str, Any] = {
    "id": 1, "topic": "mooring/log", "publishers": [1], "subscribers": [3],
    "reliability": "reliable", "journal": True, "depth": 100, "carry": {"by": [2]},
}  # fmt: skip


def section(log: dict[str, Any] | None = None, **changes: Any) -> dict[str, Any]:
    """Return a section with a carried topic."""
    return {
        "address": 1,
        "nodes": [{"address": each, "name": f"n{each}"} for each in (1, 2, 3, 4)],
        "journal": "journal",
        "streams": [{**LOG, **(log or {})}],
        **changes,
    }


def read(log: dict[str, Any] | None = None, **changes: Any) -> Any:
    """Return the config of a section."""
    return config_from_mapping(section(log, **changes), source="fleet.json5")


def test_who_carries_a_topic_and_how_much_a_node_carries() -> None:
    config = read({"carry": {"by": [4, 2], "after_s": 60, "expires_s": 7200}})
    spec = config.table.by_name("mooring/log").spec
    assert isinstance(spec, TopicSpec)
    assert spec.carry == Carry(by=(4, 2), after_s=60.0, expires_s=7200.0)
    assert config.rules.carry_bytes == DEFAULT_MAX_BYTES
    assert read(carry={"max_bytes": 1000}).rules.carry_bytes == 1000
    assert read(carry={"max_bytes": 0}).rules.carry_bytes == 0


def test_its_stream_is_there_only_where_a_topic_is_carried_and_in_no_digest() -> None:
    carried, plain = read(), _without_carry()
    assert carried.table.get(CARRY_STREAM_ID) is not None
    assert plain.table.get(CARRY_STREAM_ID) is None
    assert carried.table.digest == plain.table.digest
    assert [each.stream_id for each in carried.table] == [1]


def _without_carry() -> Any:
    log = {key: each for key, each in LOG.items() if key != "carry"}
    return config_from_mapping(section() | {"streams": [log]}, source="fleet.json5")


@pytest.mark.parametrize(
    ("log", "changes", "words"),
    [
        ({"carry": {"by": []}}, {}, "carry.by: []; allowed: 1..15 addresses"),
        ({"carry": {"by": [9]}}, {}, "9 is no node"),
        ({"carry": {"by": [2, 2]}}, {}, "2 a second time"),
        ({"carry": {"by": [3]}}, {}, "3, the only subscriber"),
        ({"carry": {"by": [2], "after_s": 0}}, {}, "carry.after_s: 0"),
        ({"carry": {"by": [2], "expires_s": 10}}, {}, "carry.expires_s: 10"),
        ({"carry": {"by": [2], "for_s": 10}}, {}, "for_s"),
        ({"journal": False}, {}, "not both reliable and journalled"),
        ({"reliability": "best_effort", "journal": False}, {}, "not both reliable and journalled"),
        ({"subscribers": None}, {}, "publishers and subscribers"),
        ({"stamp": "age"}, {}, 'stamp: "age"'),
        ({"forward": "on_demand"}, {}, 'forward: "on_demand"'),
        ({}, {"journal": None}, "journal: is missing, and node 1 has a part in mooring/log"),
        ({}, {"carry": {"max_bytes": -1}}, "carry.max_bytes"),
        ({"id": CARRY_STREAM_ID}, {}, "is that of carried samples"),
    ],
)  # fmt: skip
def test_mistakes_are_named(log: dict[str, Any], changes: dict[str, Any], words: str) -> None:
    written = section(log, **changes)
    written = {key: each for key, each in written.items() if each is not None}
    written["streams"] = [
        {key: each for key, each in stream.items() if each is not None}
        for stream in written["streams"]
    ]
    with pytest.raises(ConfigError) as refused:
        config_from_mapping(written, source="fleet.json5")
    assert words in str(refused.value)


def test_node_without_a_part_needs_no_journal() -> None:
    written = {key: each for key, each in section(address=4).items() if key != "journal"}
    assert config_from_mapping(written, source="fleet.json5").journal is None
