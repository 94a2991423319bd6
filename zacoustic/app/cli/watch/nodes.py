"""The verb `zacoustic nodes`: the other nodes, as gateways hear them."""

import argparse
import asyncio
from typing import Final

from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.app.cli.watch.topics import add_watch_arguments, chosen, make_watch
from zacoustic.link.command import EXIT_OK, Command

_EXAMPLE: Final = """Heard is the time since the last frame of a node; range is the last measured
one (zacoustic ping measures anew); loss is the share of frames without an acknowledgement of its
modem. It costs no airtime.

examples:
  zacoustic nodes --connect tcp/127.0.0.1:7447
  zacoustic nodes --config router.json5 --json
"""


class NodesCommand(Command):
    """Lists the other nodes of gateways, once."""

    name = "nodes"
    summary = "the other nodes: when heard, signal, range, loss, by which link"
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
        asyncio.run(_list(arguments))
        return EXIT_OK


async def _list(arguments: argparse.Namespace) -> None:

    from zacoustic.app.tools.watch.statustext import nodes_text
    from zacoustic.app.tools.watch.views import told

    async with make_watch(arguments) as watch:
        views = chosen(watch, arguments.node)
    for view in views:
        if not arguments.json:
            print_text(nodes_text(view))
            continue
        for peer in view.peers:
            print_json({"gateway": view.address, **told(peer)})
