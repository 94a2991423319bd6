"""Types of a configuration that are classes in Python."""

import copy
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import pytest

from tests.config.section import ROOT, message_of
from zacoustic.config import config_from_mapping
from zacoustic.core.values.types import Bounds


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
