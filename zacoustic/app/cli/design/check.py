"""The verb `zacoustic config check`: is a configuration valid, and what airtime does it take?"""

import argparse

from zacoustic.app.cli.support.arguments import add_json, add_node_file, add_profile
from zacoustic.app.cli.support.printing import print_note, print_result
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, EXIT_USAGE, Command


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
            "exits with 1 when the file is valid, and its link or its key file cannot be used on\n"
            "this computer, or something in it can never cross; with 2 when it is not valid\n\n"
            "example:\n  zacoustic config check fleet.json5 --address 2"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print the report; fails if a link is unusable here, or a stream never crosses.

        Raises:
            ConfigError: The file or an argument is wrong.
        """
        from zacoustic.app.tools.design.check.report import report_of
        from zacoustic.app.tools.design.check.text import as_text
        from zacoustic.app.tools.security.keyrefusals import key_refusals
        from zacoustic.channel.profiles import profile_named
        from zacoustic.config import read_config

        profile = profile_named(arguments.profile) if arguments.profile else None
        config = read_config(arguments.file, address=arguments.address, locator=arguments.link)
        report = report_of(config, profile)
        print_result(report, as_text, as_json=arguments.json)
        wrong, fails = False, bool(report.misfits)
        for index, link in enumerate(report.links):
            if link.error:
                key = f"{arguments.file}: plugins.acoustic.links[{index}].locator"
                where = "--link" if arguments.link else key
                print_note(f"zacoustic config check: {where}: {link.error}")
                wrong, fails = wrong or link.is_wrong, True
        for refusal in key_refusals(config):
            print_note(f"zacoustic config check: {refusal}")
            fails = True
        return EXIT_USAGE if wrong else EXIT_FAILED if fails else EXIT_OK
