"""The verb `zacoustic config doctor`: what will go wrong at sea?"""

import argparse
import asyncio

from zacoustic.app.cli.support.arguments import (
    add_examined_node,
    add_json,
    add_load,
    check_positive,
    examined_node,
)
from zacoustic.app.cli.support.printing import print_result
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command


class DoctorCommand(Command):
    """Examines a node on its own computer, without transmitting."""

    name = "doctor"
    summary = "find what would go wrong at sea, with the cure"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, node, where to look and form of the output."""
        add_examined_node(parser)
        add_load(
            parser,
            recording="rates for the airtime",
            profile=" of the airtimes",
        )
        parser.add_argument(
            "--patience", type=float, metavar="S", help="how long a modem may take to come, s (10)"
        )
        add_json(parser)
        parser.epilog = (
            "nothing is transmitted, and nothing is set. Where a gateway of this node runs\n"
            "already, doctor asks it instead of its modem. Exits with 1 when something is wrong;\n"
            "docs/doctor.md lists the checks\n\n"
            "example:\n  zacoustic config doctor router.json5 --address 2 --ntp pool.ntp.org"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print the faults; fails if there are any.

        Raises:
            ConfigError: The file or an argument is wrong.
        """
        import msgspec

        from zacoustic.app.tools.design.plan.fleet import AssumedChannel
        from zacoustic.app.tools.field.doctor.doctor import DEFAULT_PATIENCE_S, diagnose
        from zacoustic.app.tools.field.doctor.text import as_text
        from zacoustic.channel.profiles import DEFAULT_PROFILE

        check_positive(arguments, "patience")
        options = msgspec.structs.replace(
            examined_node(arguments),
            recordings=tuple(arguments.recording),
            channel=AssumedChannel(profile=arguments.profile or DEFAULT_PROFILE),
            patience_s=arguments.patience or DEFAULT_PATIENCE_S,
        )
        report = asyncio.run(diagnose(arguments.file, options))
        print_result(report, as_text, as_json=arguments.json)
        return EXIT_FAILED if report.findings else EXIT_OK
