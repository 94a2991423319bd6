"""Frames of routes, floods and bonds: the file is what the engine makes, and has the page's."""

import json
import re
from typing import Any

from tests.golden.relayed import VECTORS, text
from tests.golden.test_wire import page_section

FILE: list[dict[str, Any]] = json.loads(VECTORS.read_text(encoding="utf-8"))


def test_file_is_written_as_the_script_writes_it() -> None:
    assert VECTORS.read_text(encoding="utf-8") == text()


def test_vectors_on_the_page_are_those_of_the_file() -> None:
    rows = re.findall(
        r"^\| `(b[f2] [0-9a-f ]+)` \| (.+) \|$", page_section(16) + page_section(17), re.MULTILINE
    )
    shown = [(octets.replace(" ", ""), meaning) for octets, meaning in rows]
    made = [(one["hex"], one["meaning"]) for one in FILE]
    assert len(shown) == 11
    assert [each for each in shown if each not in made] == []
