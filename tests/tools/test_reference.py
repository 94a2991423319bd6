"""`zacoustic config schema` prints what a file takes; docs/reference.md is its output."""

import copy
import json
import re
from pathlib import Path
from typing import Any, Final

import jsonschema
import msgspec
import pytest

from tests.config.section import RECORDS
from zacoustic.app.cli import main
from zacoustic.app.tools.design.reference import json_schema, table_named, tables
from zacoustic.config import config_from_mapping, read_config
from zacoustic.errors import ConfigError
from zacoustic.json5 import read_json5

ROOT: Final = Path(__file__).parents[2]
FILES: Final = [
    ROOT / "zacoustic/app/tools/demo/fleet.json5",
    ROOT / "examples/04_fleet.json5",
    ROOT / "examples/07_reliable.json5",
    ROOT / "examples/08_fleet.json5",
    ROOT / "examples/09_rmw_desert.json5",
]


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.__name__)
def test_every_key_of_every_record_is_in_a_table_and_has_a_meaning(
    record: type[msgspec.Struct],
) -> None:
    rows = {row.key: row for table in tables() for row in table.rows}
    assert set(record.__struct_encode_fields__) <= set(rows)
    assert all(row.meaning for row in rows.values())


def test_a_key_that_must_be_there_is_said_to() -> None:
    defaults = {row.key: row.default for row in table_named("links.access (tdma)").rows}
    assert defaults["clock_error_s"] is None
    assert defaults["clock"] == ""
    assert defaults["drift_ppm"] == "50.0"


def test_a_table_that_is_not_there() -> None:
    with pytest.raises(ConfigError, match=r'no table is called "link"; there are: .*nodes'):
        table_named("link")


def test_the_page_is_what_the_verb_prints(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "schema", "--markdown"]) == 0
    page = (ROOT / "docs/reference.md").read_text(encoding="utf-8")
    assert capsys.readouterr().out == page, "zacoustic config schema --markdown > docs/reference.md"


def test_the_verb_lists_and_shows(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "schema"]) == 0
    assert re.search(r"^streams \(topic\) +A topic\.$", capsys.readouterr().out, re.MULTILINE)
    assert main(["config", "schema", "nodes"]) == 0
    assert "address  (number; required)\n" in capsys.readouterr().out
    assert main(["config", "schema", "node"]) == 2
    assert 'did you mean "nodes"?' in capsys.readouterr().err


# The schema for editors


@pytest.fixture(scope="module")
def validator() -> jsonschema.Draft202012Validator:
    schema = json.loads(json.dumps(json_schema()))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def written(path: Path) -> Any:
    return read_json5(path)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_files_that_are_read_fit_the_schema(
    path: Path, validator: jsonschema.Draft202012Validator
) -> None:
    read_config(path, address=1)
    validator.validate(written(path))


@pytest.mark.parametrize(
    "section",
    [
        {"adress": 1},
        {"address": "one"},
        {"streams": [{"id": 1, "topic": "a", "durabilty": "volatile"}]},
        {"streams": [{"id": 1}]},
        {"links": [{"locator": "sim/x:1", "access": {"method": "tdma"}}]},
        {"links": [{"locator": "sim/x:1", "access": {"method": "tmda"}}]},
        {"types": [{"name": "T", "fields": [{"name": "x"}]}]},
    ],
)
def test_what_is_wrong_in_itself_does_not_fit(
    section: dict[str, object], validator: jsonschema.Draft202012Validator
) -> None:
    assert not validator.is_valid({"plugins": {"acoustic": section}})
    assert validator.is_valid({"plugins": {"acoustic": {"address": 1}}, "mode": "router"})


WHOLE: Final[dict[str, Any]] = {
    "address": 1,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
    "links": [
        {"locator": "sim/127.0.0.1:7000",
         "access": {"method": "polling", "poller": 1, "nodes": [2], "turn_s": 5.0}}
    ],
    "types": [
        {"name": "Nav", "fields": [
            {"name": "lat", "type": "float64", "range": [-90, 90], "step": "1/60000",
             "outside": "clamp"},
            {"name": "beams", "type": "uint8", "max_length": 4},
        ]}
    ],
    "streams": [
        {"id": 10, "topic": "nav", "type": "Nav", "codec": "dense", "stamp": "age",
         "priority": "data_low", "depth": 3, "max_airtime": 0.5, "publishers": [2],
         "durability": "transient_local", "forward": "on_demand", "reliability": "best_effort"},
        {"id": 20, "service": "arm", "server": 2, "request": "Nav", "response": "Nav",
         "codec": "packed", "timeout_s": 5},
    ],
    "ranging": [{"to": 2, "every_s": 60}],
    "lost_contact": [
        {"name": "up", "lost_after_s": 300, "of": [2], "call": "up", "value": {"depth": 0}},
        {"name": "slow", "lost_after_s": 120, "publish": "slow", "encoding": "application/json"},
    ],
    "quiet": [{"from": "22:00", "to": "06:00"}],
    "objects": {"max_waiting": 8},
    "heartbeat_s": 60,
    "agreement": "tag",
    "commands_from": [1],
}  # fmt: skip
WRONG: Final[list[tuple[str, Any]]] = [
    ("address", 0),
    ("address", 255),
    ("nodes.0.address", 999),
    ("links.0.access.poller", 0),
    ("links.0.access.nodes", [255]),
    ("links.0.access.turn_s", 6),
    ("links.0.wire", "nativ"),
    ("types.0.fields.0.step", 0),
    ("types.0.fields.0.step", "1/0"),
    ("types.0.fields.0.step", "a/b"),
    ("types.0.fields.0.outside", "cut"),
    ("types.0.fields.1.max_length", 0),
    ("streams.0.id", 176),
    ("streams.0.codec", "dens"),
    ("streams.1.codec", "dense"),
    ("streams.0.stamp", "ages"),
    ("streams.0.priority", "urgent"),
    ("streams.0.depth", 0),
    ("streams.0.max_airtime", 1.5),
    ("streams.0.publishers", [0]),
    ("streams.0.durability", "transient"),
    ("streams.0.forward", "ondemand"),
    ("streams.0.reliability", "best"),
    ("streams.0.lifespan_s", 0),
    ("streams.0.min_interval_s", -1),
    ("streams.1.timeout_s", 0),
    ("ranging.0.every_s", 0),
    ("quiet.0.from", "24:00"),
    ("objects.max_waiting", 65),
    ("heartbeat_s", 0),
    ("agreement", "tags"),
    ("commands_from", [300]),
]


def test_a_whole_file_fits(validator: jsonschema.Draft202012Validator) -> None:
    validator.validate({"plugins": {"acoustic": WHOLE}})
    config_from_mapping(WHOLE, source="test")


@pytest.mark.parametrize(("path", "value"), WRONG, ids=[f"{path}={each}" for path, each in WRONG])
def test_limits_and_words_are_in_the_schema(
    path: str, value: object, validator: jsonschema.Draft202012Validator
) -> None:
    section = copy.deepcopy(WHOLE)
    *steps, key = path.split(".")
    place: Any = section
    for step in steps:
        place = place[int(step) if step.isdigit() else step]
    place[key] = value
    assert not validator.is_valid({"plugins": {"acoustic": section}})
    with pytest.raises(ConfigError):  # the schema allows nothing less than reading does
        config_from_mapping(section, source="test")
