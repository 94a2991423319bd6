"""The verb `zacoustic config show`: what holds, with all defaults."""

import argparse
import json
from typing import Final

from zacoustic.app.cli.support.arguments import ONE_OBJECT, add_json, add_node_file
from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.link.command import EXIT_OK, Command
from zacoustic.text.safetext import without_secrets

_EXAMPLE: Final = """What it prints is a file again. Keys that have no value by default are left out
(zacoustic config schema says what that means), and so are Zenoh's part of the file and passwords.

examples:
  zacoustic config show fleet.json5 --address 2
  zacoustic config show fleet.json5 --json
"""


class ShowCommand(Command):
    """Prints the section with its defaults."""

    name = "show"
    summary = "the configuration that holds: defaults filled in, arguments applied"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, overrides, and form of the output."""
        parser.epilog = _EXAMPLE
        add_node_file(parser)
        add_json(parser, ONE_OBJECT)

    def run(self, arguments: argparse.Namespace) -> int:
        """Print it.

        Raises:
            ConfigError: The file or an argument is wrong.
        """
        from zacoustic.app.tools.design.effective import effective_section

        section = effective_section(
            arguments.file, address=arguments.address, locator=arguments.link
        )
        whole = {"plugins": {"acoustic": section}}
        if arguments.json:
            print_json(whole)
        else:
            print_text(without_secrets(json.dumps(whole, indent=2, ensure_ascii=False)))
        return EXIT_OK
