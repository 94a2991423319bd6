"""The verb `zacoustic topics`, and the shared parts of verbs that watch gateways."""

import argparse
import asyncio
from typing import TYPE_CHECKING, Any

from zacoustic.app.cli.support.arguments import OBJECT_PER_LINE, add_json, add_local_network
from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.errors import ConfigError, DeliveryError
from zacoustic.link.command import EXIT_OK, Command

if TYPE_CHECKING:
    from zacoustic.app.tools.watch.views import GatewayView
    from zacoustic.app.tools.watch.watching import Watch
    from zacoustic.config import Config

_EXAMPLE = """sent and heard count records on the channel; last is the time since the stream was
last transmitted or received, acknowledgements included, rate the current rate of that; age is the
age of the newest sample received here (topics with stamp: "age"). It costs no airtime.

examples:
  zacoustic topics --connect tcp/127.0.0.1:7447
  zacoustic topics --config router.json5 --node 2 --json
"""


class TopicsCommand(Command):
    """Lists the streams of gateways, once."""

    name = "topics"
    summary = "list what crosses the channel: how often, how old, what waits"
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
    import msgspec

    from zacoustic.app.tools.watch.topicstext import topics_text

    async with make_watch(arguments) as watch:
        views = chosen(watch, arguments.node)
    for view in views:
        if not arguments.json:
            print_text(topics_text(view))
            continue
        for stream in view.streams:
            row: dict[str, Any] = msgspec.to_builtins(stream)
            print_json({"gateway": view.address, **row})


def add_watch_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the watched gateways and their network."""
    parser.add_argument(
        "--node", type=int, metavar="N", help="address of one gateway (default: all that are here)"
    )
    add_local_network(parser)
    add_json(parser, OBJECT_PER_LINE)


def make_watch(arguments: argparse.Namespace) -> "Watch":
    """Make the watch described by the arguments; on the loop.

    Raises:
        ConfigError: The file or an argument is wrong.
    """
    from zacoustic.app.tools.watch.watching import Watch

    return Watch(read_watch(arguments), arguments.connect)


def read_watch(arguments: argparse.Namespace) -> "Config | None":
    """Check the arguments, and read their file, if any.

    Raises:
        ConfigError: The file or an argument is wrong.
    """
    from zacoustic.app.tools.fleetfile import read_fleet

    if arguments.node is not None and not 1 <= arguments.node <= 254:
        raise ConfigError(f"--node {arguments.node}; allowed: 1..254")
    return None if arguments.config is None else read_fleet(arguments.config)


def chosen(watch: "Watch", node: int | None) -> "list[GatewayView]":
    """Return the requested gateways.

    Raises:
        DeliveryError: There is none.
    """
    views = [view for view in watch.board.views() if node in (None, view.address)]
    if not views:
        which = "no gateway is" if node is None else f"gateway {node} is not"
        known = ", ".join(map(str, watch.board.addresses()))
        here = f"; there are: {known}" if known else ""
        raise DeliveryError(
            f"{which} on this network{here}", hint="is it running, and is --connect its router?"
        )
    return views
