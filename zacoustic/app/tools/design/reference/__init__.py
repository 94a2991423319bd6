"""Every key of the configuration, out of the records that read it.

The records of `zacoustic.config` say names, types and defaults, their docstrings what a key means,
and `ALLOWED` what it takes: `tables` puts that together, so that what is printed cannot differ from
what is read. `zacoustic schema` prints it; docs/reference.md is its output, and a test keeps it so.
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
