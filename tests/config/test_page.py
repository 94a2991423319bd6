"""The page of the configuration: every key is on it, and its examples are read."""

import re
from pathlib import Path

import msgspec
import pytest

from zacoustic.config import Config, read_config
from zacoustic.config.later import LATER_VALUES
from zacoustic.config.sections import ALLOWED, RECORDS, ServiceEntry, TopicEntry
from zacoustic.core.values.types import FieldSpec

DOCUMENT = (Path(__file__).parents[2] / "docs" / "config.md").read_text(encoding="utf-8")


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
