"""Frames that must not be read: the file is what engines do today."""

import json

from tests.golden.refusals import REFUSALS, text


def test_file_is_written_as_the_script_writes_it() -> None:
    """The script gives each frame to an engine, and stops if that does something else."""
    assert REFUSALS.read_text(encoding="utf-8") == text()


def test_names_are_different_and_the_lost_bytes_are_in_the_frame() -> None:
    refusals = json.loads(REFUSALS.read_text(encoding="utf-8"))
    names = [each["name"] for each in refusals]
    assert sorted(names) == sorted(set(names))
    plain = [each for each in refusals if "key" not in each]
    assert all(each["lost"] in each["hex"] for each in plain)
