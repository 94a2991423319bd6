"""The help of a verb within the width of a terminal: prose is filled, an example stays a command.

A line with a blank before it is an example, or what one prints: if it is too long, it goes on in a
further line behind a backslash, so that it can still be copied as one. What stands behind three
blanks says what the command does; where there is no room for it, it is a comment before the line.
"""

import argparse
import re
import textwrap
from collections.abc import Iterator
from itertools import groupby
from typing import Final

_ONWARD: Final = " \\"
_EXPLAINED: Final = re.compile(r"(\s+\S.*?\S)\s{3,}(\S.*)")


class HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """Fills descriptions and epilogs, and breaks examples where they may be broken."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return "\n".join(f"{indent}{line}".rstrip() for line in filled(text, width - len(indent)))


def filled(text: str, width: int) -> Iterator[str]:
    """Yield the lines of a text, none wider than `width` if it can be broken."""
    for is_prose, lines in groupby(text.splitlines(), key=_is_prose):
        if is_prose:
            yield from _prose([*lines], width)
        else:
            for line in lines:
                yield from _example(line, width)


def _is_prose(line: str) -> bool:
    return bool(line) and not line[0].isspace()


def _prose(lines: list[str], width: int) -> Iterator[str]:
    """Yield prose as it is, or filled if a line of it is too long."""
    if max(map(len, lines)) <= width:
        yield from lines
        return
    yield from textwrap.wrap(" ".join(lines), width, break_long_words=False, break_on_hyphens=False)


def _example(line: str, width: int) -> Iterator[str]:
    explained = _EXPLAINED.fullmatch(line)
    if len(line) > width and explained is not None:
        command, meaning = explained.groups()
        blanks = " " * (len(command) - len(command.lstrip()))
        if len(command) + 2 + len(meaning) <= width:
            yield f"{command}  {meaning}"
            return
        yield f"{blanks}# {meaning}"
        line = command
    if len(line) <= width:
        yield line
        return
    blanks = " " * (len(line) - len(line.lstrip()))
    so_far = ""
    for word in _words(line.lstrip()):
        longer = f"{so_far} {word}" if so_far else f"{blanks}{word}"
        if so_far and len(longer) + len(_ONWARD) > width:
            yield so_far + _ONWARD
            so_far = f"{blanks}  {word}"
        else:
            so_far = longer
    yield so_far


def _words(command: str) -> list[str]:
    """Return the words of a command, an option with its value, and what is quoted, in one."""
    words = re.findall(r"(?:'[^']*'|\"[^\"]*\"|\S)+", command)
    joined: list[str] = []
    for word in words:
        if (
            joined
            and re.fullmatch(r"--?[\w-]+", joined[-1])
            and not word.startswith(("-", "&", "<"))
        ):
            joined[-1] += f" {word}"
        else:
            joined.append(word)
    return joined
