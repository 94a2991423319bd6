"""The verb `zacoustic predive`: does everything work, through the real links, before the dive?"""

import argparse
import asyncio

from zacoustic.app.cli.support.arguments import add_json, add_node_file, check_positive
from zacoustic.app.cli.support.printing import print_result
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command


class PrediveCommand(Command):
    """Tries the channel to the other nodes, and examines this one."""

    name = "predive"
    summary = "send one command each way through the real links, and compare both ends"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, nodes, where to ask, and how long to wait."""
        add_node_file(parser)
        parser.add_argument(
            "--node", type=int, action="append", default=[], metavar="N",
            help="another node (default: all of the file); may be given again",
        )  # fmt: skip
        parser.add_argument(
            "--connect", action="append", default=[], metavar="ENDPOINT",
            help="Zenoh router of the gateway, instead of the file's; may be given again",
        )  # fmt: skip
        parser.add_argument(
            "--ntp", metavar="HOST[:PORT]", help="ask this time server how wrong the clock is"
        )
        parser.add_argument(
            "--timeout", type=float, metavar="S", help="how long to wait for the answers, s (40)"
        )
        add_json(parser)
        parser.epilog = (
            "for each other node a remote command that changes nothing, and its answer; a range\n"
            "where a modem measures it; and what `zacoustic doctor` looks at on this computer.\n"
            "The gateway has to run. Exits with 1 when something is wrong, within a minute\n\n"
            "example:\n  zacoustic predive router.json5 --address 1 --node 2"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print what was found; fails when something is wrong.

        Raises:
            ConfigError: The file or an argument is wrong.
        """
        from zacoustic.app.tools.field.doctor.doctor import Options
        from zacoustic.app.tools.field.predive import DEFAULT_WITHIN_S, as_text, predive

        check_positive(arguments, "timeout")
        options = Options(
            address=arguments.address,
            locator=arguments.link,
            connect=tuple(arguments.connect),
            ntp=arguments.ntp,
        )
        within_s = arguments.timeout or DEFAULT_WITHIN_S
        report = asyncio.run(predive(arguments.file, options, arguments.node, within_s))
        print_result(report, as_text, as_json=arguments.json)
        return EXIT_FAILED if report.findings else EXIT_OK
