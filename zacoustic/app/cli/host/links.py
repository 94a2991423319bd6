"""The verb `zacoustic links`: the installed links, and whether they are usable."""

import argparse

from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command
from zacoustic.text.installing import OURSELVES


class LinksCommand(Command):
    """Lists the installed links with their settings."""

    name = "links"
    summary = "list the installed links, their settings, and whether they can be used"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the form of the output."""
        parser.add_argument("--json", action="store_true", help="one JSON object for all of them")
        parser.epilog = "example:\n  zacoustic links"

    def run(self, arguments: argparse.Namespace) -> int:
        """Print them; fails if there is none."""
        from zacoustic.app.tools.field.links import describe_as_text
        from zacoustic.errors import LinkUnavailableError
        from zacoustic.link import registry

        links = registry.describe()
        if arguments.json:
            print_json({"links": links})
            return EXIT_OK if links else EXIT_FAILED
        if not links:
            raise LinkUnavailableError("no links are installed", hint=OURSELVES)
        print_text(describe_as_text(links))
        return EXIT_OK
