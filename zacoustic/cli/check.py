"""The verb `zacoustic check`: is a configuration valid, and what does it cost on the water?"""

import argparse
import json
import sys

from zacoustic.command import EXIT_FAILED, EXIT_OK, Command


class CheckCommand(Command):
    """Validates a file and prints its stream table."""

    name = "check"
    summary = "validate a configuration and show bytes and airtime of every stream"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, address, modem profile and form of the output."""
        parser.add_argument("file", metavar="FILE", help="Zenoh config with plugins.acoustic")
        parser.add_argument(
            "--address", type=int, metavar="N", help="address of this node, instead of the file's"
        )
        parser.add_argument(
            "--link", metavar="LOCATOR", help="the modem, instead of the file's: NAME/ADDRESS"
        )
        parser.add_argument(
            "--profile", metavar="NAME", help="modem of the airtimes (default: the EvoLogics 18/34)"
        )
        parser.add_argument("--json", action="store_true", help="one JSON object")
        parser.epilog = (
            "fails when the file is valid and its link cannot be used on this computer\n\n"
            "example:\n  zacoustic check fleet.json5 --address 2"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print the report; fails when a link cannot be used here.

        Raises:
            ConfigError: The file or an argument is wrong.
        """
        import msgspec

        from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
        from zacoustic.config import read_config
        from zacoustic.tools.check.report import report_of
        from zacoustic.tools.check.text import as_text

        profile = profile_named(arguments.profile or DEFAULT_PROFILE)
        config = read_config(arguments.file, address=arguments.address, locator=arguments.link)
        report = report_of(config, profile)
        if arguments.json:
            print(json.dumps(msgspec.to_builtins(report, str_keys=True), ensure_ascii=False))
        else:
            print(as_text(report))
        unusable = [link for link in report.links if link.error]
        for link in unusable:
            print(f"zacoustic check: {arguments.file}: {link.error}", file=sys.stderr)
        return EXIT_FAILED if unusable else EXIT_OK
