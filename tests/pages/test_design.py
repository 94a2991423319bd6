"""Maps of the project name what is there, and nothing else."""

import re
from pathlib import Path

import zacoustic

SOURCE = Path(zacoustic.__file__).parent
ROOT = SOURCE.parent
_FIRST_CELL = re.compile(r"^\| `(\w+)` \|", re.MULTILINE)
_DOTTED = re.compile(r"`(?:zacoustic\.)?((?:\w+\.)+\w+)`")
_PRIVATE = {"__init__", "__main__"}


def rooms(folder: Path) -> set[str]:
    """Return the names of the modules and packages of a folder."""
    files = {each.stem for each in folder.glob("*.py")} - _PRIVATE
    return files | {each.parent.name for each in folder.glob("*/__init__.py")}


def test_the_design_names_each_top_room() -> None:
    page = (ROOT / "docs" / "design.md").read_text()
    sentence = page[: page.index("are public names for")].rpartition("\n\n")[2]
    assert set(_FIRST_CELL.findall(page)) | set(re.findall(r"`(\w+)`", sentence)) == rooms(SOURCE)


def test_each_room_that_the_design_names_is_there() -> None:
    page = (ROOT / "docs" / "design.md").read_text()
    for name in _DOTTED.findall(page):
        first = name.split(".")[0]
        if first not in rooms(SOURCE):
            continue  # of another package, or a file
        path = SOURCE
        for part in name.split("."):
            if (path / part).is_dir():
                path /= part
            else:
                held = path.with_suffix(".py") if path.suffix != ".py" else path
                path = path / f"{part}.py" if (path / f"{part}.py").exists() else held
                assert path.exists(), name
                assert path.stem == part or part in path.read_text(), name


def test_the_page_of_the_tests_names_each_folder() -> None:
    page = (ROOT / "tests" / "README.md").read_text()
    folders = {each.name for each in (ROOT / "tests").iterdir() if each.is_dir()}
    assert set(_FIRST_CELL.findall(page)) == folders - {"__pycache__"}
