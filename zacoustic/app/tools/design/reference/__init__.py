"""Every key of the configuration, from the records that read it.

The records of `zacoustic.config` declare names, types, ranges and defaults, their docstrings the
meaning of a key. `tables` combines them, so the printed reference cannot differ from
the reader. `zacoustic config schema` prints it; docs/reference.md is its output, as a test ensures.
"""

from zacoustic.app.tools.design.reference.jsonschema import json_schema
from zacoustic.app.tools.design.reference.tables import KeyRow, KeyTable, table_named, tables
from zacoustic.app.tools.design.reference.text import as_markdown, as_text, list_of_tables

__all__ = [
    "KeyRow",
    "KeyTable",
    "as_markdown",
    "as_text",
    "json_schema",
    "list_of_tables",
    "table_named",
    "tables",
]
