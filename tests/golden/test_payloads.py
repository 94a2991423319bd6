"""The vectors of payloads are complete, and say the same as the codecs."""

import json

import pytest

from tests.golden.payloads import CODECS, FOLDER, REFUSED, refused, text


@pytest.mark.parametrize("name", CODECS)
def test_file_is_written_as_the_script_writes_it(name: str) -> None:
    assert (FOLDER / name).read_text(encoding="utf-8") == text(name)


@pytest.mark.parametrize("name", CODECS)
def test_names_are_different(name: str) -> None:
    vectors = json.loads((FOLDER / name).read_text(encoding="utf-8"))["vectors"]
    names = [each["name"] for each in vectors]
    assert sorted(names) == sorted(set(names))


def test_file_of_refused_payloads_is_written_as_the_script_writes_it() -> None:
    """The script stops if a codec reads one."""
    assert REFUSED.read_text(encoding="utf-8") == refused()
