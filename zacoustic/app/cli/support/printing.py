"""Printing: all output passes here, so that no text from others controls the terminal.

Results go to standard output, notes to standard error: with `--json` standard output carries only
JSON. Output during the run is flushed, since the reader of a pipe wants each line at once.
"""

import sys
from collections.abc import Callable
from typing import Any, TypeVar

from zacoustic.app.cli.support.atwork import AT_WORK
from zacoustic.text.safetext import json_line, one_line, some_lines, without_secrets

T = TypeVar("T")


def print_text(text: str, *, flush: bool = False) -> None:
    """Print lines for people; each line must be safe already."""
    AT_WORK.end()
    print(some_lines(text), flush=flush)


def print_json(value: object, *, flush: bool = False) -> None:
    """Print one JSON object in a line.

    Args:
        value: A record, or what JSON holds.
        flush: Flush the output.
    """
    import msgspec

    AT_WORK.end()
    print(json_line(msgspec.to_builtins(value, str_keys=True)), flush=flush)


def print_result(result: T, text: Callable[[T], str], *, as_json: bool) -> None:
    """Print the result of a verb, for people or as one JSON object."""
    if as_json:
        print_json(result)
    else:
        print_text(text(result))


def print_line(record: dict[str, Any], text: str, *, as_json: bool) -> None:
    """Print one result: a record as JSON, or its line for people."""
    if as_json:
        print_json(record, flush=True)
    else:
        AT_WORK.end()
        print(one_line(text), flush=True)


def print_note(text: str) -> None:
    """Print one line on standard error, without the passwords of endpoints."""
    AT_WORK.end()
    print(one_line(without_secrets(text)), file=sys.stderr, flush=True)
