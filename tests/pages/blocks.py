"""The blocks of a page, and the files among them.

What the language of a block says::

    sh          commands, which are run (`tests.pages.walk`)
    console     commands of other programs (`ros2`, `systemctl`), which are not there: shown only
    json5, python, toml, ini, …    a file, if its first line is a comment that names it, or a name
                stands behind the language
    none        output, wire layouts, and whatever else is no program
"""

import re
from pathlib import Path
from typing import Final

import msgspec

ROOT: Final = Path(__file__).parents[2]
PAGES: Final = sorted(
    str(page.relative_to(ROOT)) for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
)
"""README.md and all of docs/."""

_BLOCK: Final = re.compile(r"^```(\w*)(?: ([\w./-]+))?\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_HEADING: Final = re.compile(r"^##+ ", re.MULTILINE)
_NAME: Final = re.compile(r"(?://|#) ([\w./-]+\.\w+)\n")


class Block(msgspec.Struct, frozen=True):
    """One block."""

    language: str
    title: str
    text: str
    section: int
    """How many headings are before it."""

    @property
    def name(self) -> str | None:
        """The file that it is, or None."""
        if self.title:
            return self.title
        named = _NAME.match(self.text)
        return named[1] if named is not None and self.language not in ("sh", "console") else None


def blocks_of(page: str) -> list[Block]:
    """Return the blocks of a page, named from the root of the repository."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return [
        Block(found[1], found[2] or "", found[3], len(_HEADING.findall(text, 0, found.start())))
        for found in _BLOCK.finditer(text)
    ]


def files_of(page: str) -> dict[str, str]:
    """Return the files of a page; those of README.md are there on every other one."""
    own = {block.name: block.text for block in blocks_of(page) if block.name is not None}
    return own if page == "README.md" else {**files_of("README.md"), **own}


def commands_of(text: str) -> list[str]:
    """Return the commands of a block of sh, comments gone, continued lines joined."""
    return [command for command, _ in steps_of(text)]


def steps_of(text: str) -> list[tuple[str, int]]:
    """Return the commands of a block of sh, each with its exit code: 0, or `# … exit code N`."""
    joined = re.sub(r"\\\n\s*", "", text)
    steps = []
    for line in joined.splitlines():
        command, _, comment = re.sub(r"(^|\s)#\s", "\0", line, count=1).partition("\0")
        expected = re.search(r"exit code (\d)", comment)
        if command.strip():
            steps.append((command.strip(), int(expected[1]) if expected is not None else 0))
    return steps
