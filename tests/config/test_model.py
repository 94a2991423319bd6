"""The key `model`: the file of a fit, and what is wrong with one."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.dive import section
from zacoustic.config import Config, config_from_mapping
from zacoustic.errors import ConfigError

EMPTY: dict[str, Any] = {"model": {}}


def read(folder: Path, content: object, **changed: Any) -> Config:
    written = content if isinstance(content, str) else json.dumps(content)
    (folder / "m.json").write_text(written, encoding="utf-8")
    return config_from_mapping(section(model="m.json", **changed), source="f", folder=folder)


def test_a_model_is_part_of_what_the_fleet_agrees_on(tmp_path: Path) -> None:
    without = config_from_mapping(section(), source="f").table
    empty = read(tmp_path, EMPTY).table
    other = read(tmp_path, {"model": {"single": 7}}).table
    assert len({without.digest, empty.digest, other.digest}) == 3
    assert without.model is None


def test_what_is_typical_is_not(tmp_path: Path) -> None:
    known = read(tmp_path, {**EMPTY, "typical_bits": {"10": 31.5, "11": 2, "nav": 1}})
    assert known.typical_bits == {10: 31.5, 11: 2}
    assert known.table.digest == read(tmp_path, EMPTY).table.digest


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("{", "m.json: no model: "),
        ("[" * 100_000, "m.json: no model: "),
        ({}, "m.json: no model: "),
        ({"model": {"streams": {"10": {}}}}, "m.json: no model: "),
        ({"model": {"streams": {"10": {"sizes": [1, 2]}}}}, "fitted to another type"),
        ({"model": {"streams": {"99": {"sizes": []}}}}, "has streams that are not dense here: 99"),
    ],
)
def test_a_file_that_is_no_model_of_these_streams_is_refused(
    content: object, expected: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError) as error:
        read(tmp_path, content)
    assert expected in str(error.value)
    assert "plugins.acoustic.model: " in str(error.value)
    assert "zacoustic codec fit" in str(error.value) or "fit the model again" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_and_a_model_for_nothing_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"f: plugins\.acoustic\.model: .*No such file.*codec fit"
    ):
        config_from_mapping(section(model="none.json"), source="f", folder=tmp_path)
    with pytest.raises(ConfigError, match="no stream is dense; allowed: streams with codec"):
        read(tmp_path, EMPTY, codec="packed")
