"""The meanings of a record's keys: the docstring below each attribute in its source."""

import ast
import inspect
import sys
import textwrap
from typing import Any


def meanings_of(record: type[Any]) -> dict[str, str]:
    """Return the docstring of each attribute of a class, on one line, including its bases.

    Args:
        record: A class with available source.
    """
    meanings: dict[str, str] = {}
    for owner in reversed(record.__mro__):
        if owner.__module__ in sys.stdlib_module_names or owner.__module__.startswith("msgspec"):
            continue
        (definition,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
        assert isinstance(definition, ast.ClassDef)
        for attribute, text in zip(definition.body, definition.body[1:], strict=False):
            match attribute, text:
                case (
                    ast.AnnAssign(target=ast.Name(id=name)),
                    ast.Expr(value=ast.Constant(value=str(said))),
                ):
                    meanings[name] = " ".join(said.split())
                case _:
                    pass
    return meanings
