"""`zacoustic schema` prints what reading a file takes, and docs/reference.md is its output."""

import json
import re
from pathlib import Path
from typing import Any, Final

import jsonschema
import msgspec
import pytest

from zacoustic.cli import main
from zacoustic.config import read_config
from zacoustic.config.sections import RECORDS, ActionEntry, ServiceEntry, TopicEntry
from zacoustic.core.access.spec import METHODS
from zacoustic.errors import ConfigError
from zacoustic.json5 import read_json5
from zacoustic.tools.reference import json_schema, table_named, tables

ROOT: Final = Path(__file__).parents[2]
FILES: Final = [
    ROOT / "zacoustic/tools/demo/fleet.json5",
    ROOT / "examples/04_fleet.json5",
    ROOT / "examples/07_reliable.json5",
    ROOT / "examples/08_fleet.json5",
    ROOT / "examples/09_rmw_desert.json5",
]
KEYS_OF_A_RECORD: Final = [
    *RECORDS.values(), TopicEntry, ServiceEntry, ActionEntry, *METHODS.values(),
]  # fmt: skip


@pytest.mark.parametrize("record", KEYS_OF_A_RECORD, ids=lambda record: record.__name__)
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
    assert main(["schema", "--markdown"]) == 0
    page = (ROOT / "docs/reference.md").read_text(encoding="utf-8")
    assert capsys.readouterr().out == page, "zacoustic schema --markdown > docs/reference.md"


def test_the_verb_lists_and_shows(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema"]) == 0
    assert re.search(r"^streams \(topic\) +A topic\.$", capsys.readouterr().out, re.MULTILINE)
    assert main(["schema", "nodes"]) == 0
    assert "address  (number; required)\n" in capsys.readouterr().out
    assert main(["schema", "node"]) == 2
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
