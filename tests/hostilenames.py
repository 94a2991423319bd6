"""Texts that try to steer what shows them, and what must hold of everything that shows them."""

import json
from typing import Any, Final

HOSTILE: Final = (
    "a[/b]c[bold red]\x1b[2J\x1b]0;owned\x07\nforged line\r\x9b31m\u202egnp.\u2066\u2028"
    "<script>alert(1)</script>\"' onload='x' $\\frac${{ 7*7 }}"
)
"""Markup of rich, escapes of a terminal, line ends, right-to-left marks, tags, formulas."""

HOSTILE_NAME: Final = HOSTILE.translate({ord(letter): "_" for letter in "/*$?#{}"})
"""The same without what no chunk of a key may have."""


def assert_harmless(shown: str) -> None:
    """Check that a terminal can only show it, and that no line of it is forged."""
    for line in shown.split("\n"):
        assert line.isprintable(), ascii(line)
        assert not line.strip().startswith("forged"), ascii(line)


def strictly(line: str) -> Any:
    """Read JSON as every reader does: without NaN and the infinities."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    return json.loads(line, parse_constant=refuse)
