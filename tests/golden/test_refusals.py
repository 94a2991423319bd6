"""Frames that must not be read: the file is what engines do today."""

import json

from tests.golden.refusals import ENDS, REFUSALS, texts


def test_files_are_written_as_the_script_writes_them() -> None:
    """The script gives each frame to an engine, and stops if that does something else."""
    made = texts()
    assert {path: path.read_text(encoding="utf-8") for path in made} == made


def test_names_are_different_and_the_lost_bytes_are_in_the_frame() -> None:
    refusals = [
        each for path in (REFUSALS, ENDS) for each in json.loads(path.read_text(encoding="utf-8"))
    ]
    names = [each["name"] for each in refusals]
    assert sorted(names) == sorted(set(names))
    plain = [each for each in refusals if "key" not in each]
    assert all(each["lost"] in each["hex"] for each in plain)
