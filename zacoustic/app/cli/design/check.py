"""The verb `zacoustic config check`: is a configuration valid, and what airtime does it take?"""

import argparse

from zacoustic.app.cli.support.arguments import add_json, add_node_file, add_profile
from zacoustic.app.cli.support.printing import print_note, print_result
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command


class CheckCommand(Command):
    """Validates a file and prints its stream table."""

    name = "check"
    summary = "validate a configuration and show bytes and airtime of every stream"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, address, modem profile and form of the output."""
        add_node_file(parser)
        add_profile(parser, " of the airtimes")
        add_json(parser)
        parser.epilog = (
            "fails when the file is valid, and its link cannot be used on this computer, or\n"
            "something in it can never cross\n\n"
            "example:\n  zacoustic config check fleet.json5 --address 2"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print the report; fails if a link is unusable here, or a stream never crosses.

        Raises:
            ConfigError: The file or an argument is wrong.
        """
        from zacoustic.app.tools.design.check.report import report_of
        from zacoustic.app.tools.design.check.text import as_text
        from zacoustic.channel.profiles import profile_named
        from zacoustic.config import read_config

        profile = profile_named(arguments.profile) if arguments.profile else None
        config = read_config(arguments.file, address=arguments.address, locator=arguments.link)
        report = report_of(config, profile)
        print_result(report, as_text, as_json=arguments.json)
        unusable = [link for link in report.links if link.error]
        for link in unusable:
            print_note(f"zacoustic config check: {arguments.file}: {link.error}")
        return EXIT_FAILED if unusable or report.misfits else EXIT_OK
