"""The map of the core names every room that is there, and none that is not."""

import re
from pathlib import Path

import zacoustic.core

ROOT = Path(zacoustic.core.__file__).parent
_ROW = re.compile(r"^`(\w+)`( .*(?:\n {16}.*)*)", re.MULTILINE)


def modules_of(folder: Path) -> set[str]:
    """Return the names of the modules and packages of a folder."""
    files = {each.stem for each in folder.glob("*.py")} - {"__init__"}
    return files | {each.parent.name for each in folder.glob("*/__init__.py")}


def test_each_layer_and_each_of_its_rooms_stands_in_the_map() -> None:
    text = zacoustic.core.__doc__ or ""
    rows = dict(_ROW.findall(text.split("=\n", 2)[1]))
    assert rows.keys() | {"clock", "linktypes"} == modules_of(ROOT)
    named = {layer: set(re.findall(r"`(\w+)`", row)) for layer, row in rows.items()}
    assert {layer: modules_of(ROOT / layer) for layer in rows} == named
