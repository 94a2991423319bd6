"""What the pages show works: files are read, commands are run, links lead somewhere."""

import ast
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

import jsonschema
import pytest

from tests.pages.blocks import PAGES, ROOT, Block, blocks_of, commands_of
from tests.pages.walk import END, LIMIT_S, Walk
from zacoustic.app.cli import parse
from zacoustic.app.cli.tree import whole_tree
from zacoustic.app.cli.verbs import ALIASES, VERBS
from zacoustic.app.tools.design.reference import json_schema
from zacoustic.json5 import parse_json5

_LINK: Final = re.compile(r"\]\(((?!http)[^)#]+)\)")
_VERB: Final = re.compile(r"`zacoustic ([a-z][a-z_ ]*)")

WITH_COMMANDS: Final = [
    page for page in PAGES if any(block.language == "sh" for block in blocks_of(page))
]


@pytest.mark.skipif(sys.platform == "win32", reason="scripts of sh, pseudo-terminals")
@pytest.mark.parametrize("page", WITH_COMMANDS)
def test_what_a_page_says_can_be_typed(
    page: str, tmp_path: Path, sized: Callable[..., int]
) -> None:
    with Walk(page, tmp_path, part=sized(1, share=4)) as walk:
        walk.go()


@pytest.mark.parametrize("page", WITH_COMMANDS)
def test_a_page_ends_what_it_starts_in_the_background(page: str) -> None:
    """Else the next commands, and the next page, find the ports in use."""
    sections: dict[int, list[str]] = {}
    for block in blocks_of(page):
        if block.language == "sh":
            sections.setdefault(block.section, []).extend(commands_of(block.text))
    open_ended = [
        commands[-1]
        for commands in sections.values()
        if any(command.endswith("&") for command in commands) and commands[-1] != END
    ]
    assert open_ended == []


def blocks(language: str) -> list[object]:
    return [
        pytest.param(block, id=f"{page}-{number}")
        for page in PAGES
        for number, block in enumerate(blocks_of(page))
        if block.language == language
    ]


@pytest.mark.parametrize("block", blocks("json5"))
def test_what_is_said_of_the_configuration_fits_its_schema(block: Block) -> None:
    """A block is a whole file of Zenoh, a part of our section, or a file of something else."""
    part = not block.text.lstrip("/").splitlines()[block.name is not None].startswith("{")
    written = parse_json5(f"{{{block.text}}}" if part else block.text, source="the page")
    assert isinstance(written, dict)
    if part:
        written = {"plugins": {"acoustic": written}}
    if "plugins" in written:
        jsonschema.validate(written, json_schema())


@pytest.mark.parametrize("block", blocks("python"))
def test_python_is_python(block: Block) -> None:
    ast.parse(block.text)


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_links_to_is_there(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    folder = (ROOT / page).parent
    absent = [target for target in _LINK.findall(text) if not (folder / target).exists()]
    assert absent == []


@pytest.mark.parametrize("page", PAGES)
def test_verbs_that_a_page_mentions_are_there(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    tree = whole_tree()
    for words in map(str.split, _VERB.findall(text)):
        path = tree.path_in(words)
        assert path, words
        assert tree.is_leaf(path) or path == tuple(words), words


@pytest.mark.parametrize("page", PAGES)
def test_commands_that_are_only_shown_have_the_arguments_that_they_show(page: str) -> None:
    shown = [block.text for block in blocks_of(page) if not block.language]
    for command in (line for text in shown for line in commands_of(text)):
        words = shlex.split(command.rstrip("&")) if command.startswith("zacoustic ") else []
        if words:
            parse(words[1:])


@pytest.mark.parametrize("page", PAGES)
def test_programs_of_others_are_shown_as_such(page: str) -> None:
    """Nothing of ours hides from the walk in a block that is only shown."""
    shown = [block.text for block in blocks_of(page) if block.language == "console"]
    assert not [text for text in shown if re.search(r"^\$? ?zacoustic\b", text, re.MULTILINE)]


def test_the_link_that_a_page_writes_passes_the_conformance_battery(tmp_path: Path) -> None:
    with Walk("docs/links.md", tmp_path):
        process = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "."],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=LIMIT_S,
            check=False,
        )
    assert process.returncode == 0, process.stdout


def test_the_front_page_is_short_and_each_cell_of_its_figures_has_one() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 150
    rows = [
        row.split("|")[2].strip()
        for row in text.partition("| what | measured |")[2].splitlines()[2:]
        if row.startswith("|")
    ]
    assert len(rows) == 10
    assert [cell for cell in rows if len(re.findall(r"\d+(?:\.\d+)?", cell)) != 1] == []


def test_every_verb_is_in_the_table_of_commands() -> None:
    table = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    for verb in (*VERBS, "run medium", "run modems"):
        assert re.search(rf"`(zacoustic )?{verb}\b", table), verb


_OLD: Final = re.compile(rf"(?<![-\w.])zacoustic (?:-v )?({'|'.join(ALIASES)})\b(?!-|\.\w)")


def joined(path: Path) -> list[str]:
    """The lines of a file; a continued one is one, and the next are empty."""
    text = path.read_text(encoding="utf-8", errors="replace")
    return re.sub(r"(.*\\\n)+.*", _in_one_line, text).splitlines()


def _in_one_line(found: re.Match[str]) -> str:
    return re.sub(r"\\\n\s*", "", found[0]) + "\n" * found[0].count("\n")


def test_nothing_advises_the_words_of_earlier_versions() -> None:
    """They still run, for those who know them; who reads us learns only today's."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, check=True)
    found = [
        f"{name}:{number}: {line.strip()}"
        for name in listed.stdout.decode().splitlines()
        if (ROOT / name).suffix not in (".png", ".svg") and name != "tests/cli/test_main.py"
        for number, line in enumerate(joined(ROOT / name), 1)
        if _OLD.search(line)
    ]
    assert found == []
