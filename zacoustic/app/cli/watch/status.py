"""The verb `zacoustic status`: gateways in ten lines each."""

import argparse
import asyncio
from typing import Final

from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.app.cli.watch.topics import add_watch_arguments, chosen, make_watch
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command

_EXAMPLE: Final = """exit code 1: a gateway is gone, its link is not up, it may not transmit, its
journal fails, or a stream is stopped. It costs no airtime.

examples:
  zacoustic status --connect tcp/127.0.0.1:7447
  zacoustic status --config router.json5 --json
"""


class StatusCommand(Command):
    """Shows the state of gateways, once."""

    name = "status"
    summary = "is the link up, who was heard, which streams fail: ten lines a gateway"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare gateways, their network, and the form of the output."""
        parser.epilog = _EXAMPLE
        add_watch_arguments(parser)

    def run(self, arguments: argparse.Namespace) -> int:
        """Query the gateways and print; exit code 1 if something is wrong with one.

        Raises:
            SessionError: No router can be reached.
            DeliveryError: No gateway is there.
        """
        return asyncio.run(_show(arguments))


async def _show(arguments: argparse.Namespace) -> int:
    from zacoustic.app.tools.watch.statustext import goes_well, status_of, status_text

    async with make_watch(arguments) as watch:
        views = chosen(watch, arguments.node)
    for view in views:
        if arguments.json:
            print_json(status_of(view))
        else:
            print_text(status_text(view))
    return EXIT_OK if all(goes_well(view) for view in views) else EXIT_FAILED
