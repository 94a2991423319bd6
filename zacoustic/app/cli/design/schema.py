"""The verb `zacoustic config schema`: the keys of the configuration and their meanings."""

import argparse

from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.link.command import EXIT_OK, Command


class SchemaCommand(Command):
    """Prints the keys of the configuration."""

    name = "schema"
    summary = "every key of the configuration, what it takes and what it means"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the table and the form of the output."""
        parser.add_argument(
            "table", metavar="TABLE", nargs="?", help="one table, such as links (default: a list)"
        )
        form = parser.add_mutually_exclusive_group()
        form.add_argument("--json", action="store_true", help="all as a JSON Schema, for an editor")
        form.add_argument("--markdown", action="store_true", help="all as the page of the docs")
        parser.epilog = "example:\n  zacoustic config schema 'streams (topic)'"

    def run(self, arguments: argparse.Namespace) -> int:
        """Print it.

        Raises:
            ConfigError: There is no such table.
        """
        from zacoustic.app.tools.design import reference

        if arguments.json:
            print_json(reference.json_schema())
        elif arguments.markdown:
            print_text(reference.as_markdown(reference.tables()).removesuffix("\n"))
        elif arguments.table is not None:
            print_text(reference.as_text(reference.table_named(arguments.table)))
        else:
            print_text(reference.list_of_tables(reference.tables()))
        return EXIT_OK
