"""The verb `zacoustic predive`: tests everything through the real links before a dive."""

import argparse
import asyncio

from zacoustic.app.cli.support.arguments import (
    add_examined_node,
    add_json,
    check_positive,
    examined_node,
)
from zacoustic.app.cli.support.printing import print_result
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command


class PrediveCommand(Command):
    """Tests the channel to the other nodes, and examines this one."""

    name = "predive"
    summary = "ask the other nodes through the real links, and compare both ends"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, nodes, where to ask, and how long to wait."""
        add_examined_node(parser)
        parser.add_argument(
            "--node", type=int, action="append", default=[], metavar="N",
            help="another node (default: all of the file); may be given again",
        )  # fmt: skip
        parser.add_argument(
            "--timeout", type=float, metavar="S", help="how long to wait for the answers, s (40)"
        )
        add_json(parser)
        parser.epilog = (
            "each other node is asked for its journal, clock and slots; tables, lives and ranges\n"
            "are compared, and this computer is examined as by `zacoustic config doctor`.\n"
            "The gateway has to run. Exits with 1 when something is wrong, within a minute\n\n"
            "example:\n  zacoustic predive router.json5 --address 1 --node 2"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print the results; fails if something is wrong.

        Raises:
            ConfigError: The file or an argument is wrong.
        """
        from zacoustic.app.tools.field.predive import DEFAULT_WITHIN_S, as_text, predive

        check_positive(arguments, "timeout")
        within_s = arguments.timeout or DEFAULT_WITHIN_S
        report = asyncio.run(
            predive(arguments.file, examined_node(arguments), arguments.node, within_s)
        )
        print_result(report, as_text, as_json=arguments.json)
        return EXIT_FAILED if report.findings else EXIT_OK
