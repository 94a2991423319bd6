"""The verb `zacoustic service list`: the services of gateways."""

import argparse

from zacoustic.app.cli.watch.topics import add_watch_arguments, list_streams
from zacoustic.link.command import Command

_EXAMPLE = """It costs no airtime.

example:
  zacoustic service list --connect tcp/127.0.0.1:7447
"""


class ServicesCommand(Command):
    """Lists the services of gateways, once."""

    name = "list"
    summary = "the services that cross the channel: how often, what waits"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare gateways, their network, and the form of the output."""
        parser.epilog = _EXAMPLE
        add_watch_arguments(parser)

    def run(self, arguments: argparse.Namespace) -> int:
        """Query the gateways and print.

        Raises:
            SessionError: No router can be reached.
            DeliveryError: No gateway is there.
        """
        return list_streams(arguments, "service")
