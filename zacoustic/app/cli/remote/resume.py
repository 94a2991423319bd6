"""The verb `zacoustic resume`: ends the silence of a remote command."""

import argparse
from typing import Final

from zacoustic.app.cli.remote.silence import add_command_arguments, give, make_command
from zacoustic.link.command import Command

_EXAMPLE: Final = """the same as `zacoustic silence resume`; quiet windows of the configuration stay

examples:
  zacoustic resume --connect tcp/127.0.0.1:7447        all gateways here
  zacoustic resume --node 2 --config router.json5      node 2, local or remote
"""


class ResumeCommand(Command):
    """Ends a silence."""

    name = "resume"
    summary = "transmit again, before a commanded silence ends by itself"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare which node, and where to ask."""
        parser.epilog = _EXAMPLE
        add_command_arguments(parser)

    def run(self, arguments: argparse.Namespace) -> int:
        """Send the command and print the new state; exit code 3 without an answer in time.

        Raises:
            ConfigError: An argument is wrong.
            DeliveryError, ServiceError: There is no such node, or it refuses.
        """
        from zacoustic.core.streams.commands import CommandKind

        return give(arguments, make_command(kind=CommandKind.RESUME))
