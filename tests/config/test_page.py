"""The page of the configuration: every key is on it, and its examples are read."""

import re
from pathlib import Path

import msgspec
import pytest

from tests.config.section import RECORDS
from zacoustic.config import Config, read_config
from zacoustic.config.problems import LATER_VALUES
from zacoustic.text.allowed import allowed, table_of

DOCUMENT = (Path(__file__).parents[2] / "docs" / "config.md").read_text(encoding="utf-8")


ROWS = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \|(.*)\|$", DOCUMENT, re.MULTILINE)
RANGE = re.compile(r"\b[0-9]+\.\.[0-9]+\b")


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.__name__)
def test_every_key_is_in_the_reference(record: type[msgspec.Struct]) -> None:
    documented = {key for keys, _ in ROWS for key in re.findall(r"\w+", keys)}
    # The price is one value of `cost`, which the page shows as a whole.
    assert set(record.__struct_encode_fields__) <= {*documented, "per_byte", "quantum"}
    assert all(allowed(field.type) for field in table_of(record).fields)


@pytest.mark.parametrize(("keys", "text"), [row for row in ROWS if RANGE.search(row[1])])
def test_ranges_of_the_reference_are_those_that_keys_declare(keys: str, text: str) -> None:
    declared = [
        allowed(field.type)
        for record in RECORDS
        for field in table_of(record).fields
        if field.encode_name in keys
    ]
    for written in RANGE.findall(text):
        assert any(re.search(rf"\b{re.escape(written)}\b", words) for words in declared), written


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
