"""The verb `zacoustic topic list`, and the shared parts of verbs that watch gateways."""

import argparse
import asyncio
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.arguments import OBJECT_PER_LINE, add_json, add_local_network
from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.errors import ConfigError, DeliveryError
from zacoustic.link.command import EXIT_OK, Command

if TYPE_CHECKING:
    from zacoustic.app.tools.watch.views import GatewayView
    from zacoustic.app.tools.watch.watching import Watch
    from zacoustic.config import Config

_EXAMPLE = """A line for each way that a topic takes through a gateway. Count is that of records on
the channel, last the time since the last of them, acknowledgements included, rate their present
rate; age is that of the newest sample received here (topics with stamp: "age"). It costs no
airtime.

examples:
  zacoustic topic list --connect tcp/127.0.0.1:7447
  zacoustic topic list --config router.json5 --node 2 --json
"""


class StreamsCommand(Command):
    """Lists the streams of one kind of gateways, once."""

    name = "list"
    prints_late = True
    kind = "topic"
    """``topic``, ``service`` or ``action``."""
    example = ""
    """The end of its help."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare gateways, their network, and the form of the output."""
        parser.epilog = self.example
        add_watch_arguments(parser)

    def run(self, arguments: argparse.Namespace) -> int:
        """Query the gateways and print.

        Raises:
            SessionError: No router can be reached.
            DeliveryError: No gateway is there.
        """
        return list_streams(arguments, self.kind)


class TopicsCommand(StreamsCommand):
    """Lists the topics of gateways, once."""

    summary = "the topics that cross the channel: how often, how old, what waits"
    example = _EXAMPLE

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare gateways, their network, and the form of the output."""
        super().add_arguments(parser)
        parser.add_argument(
            "--wide", action="store_true",
            help="services and actions as well, in one line each, wider than a terminal",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Query the gateways and print.

        Raises:
            SessionError: No router can be reached.
            DeliveryError: No gateway is there.
        """
        return list_streams(arguments, None if arguments.wide else "topic")


def list_streams(arguments: argparse.Namespace, kind: str | None) -> int:
    """Print the streams of gateways.

    Args:
        arguments: Those of `add_watch_arguments`.
        kind: ``topic``, ``service`` or ``action``; None: all, in one wide table.

    Raises:
        SessionError: No router can be reached.
        DeliveryError: No gateway is there.
    """
    asyncio.run(_list(arguments, kind))
    return EXIT_OK


async def _list(arguments: argparse.Namespace, kind: str | None) -> None:

    from zacoustic.app.tools.watch.topicstext import streams_text, topics_text
    from zacoustic.app.tools.watch.views import told

    async with make_watch(arguments) as watch:
        views = chosen(watch, arguments.node)
    for view in views:
        if not arguments.json:
            print_text(topics_text(view) if kind is None else streams_text(view, kind))
            continue
        for stream in view.streams:
            if kind in (None, stream.kind):
                print_json({"gateway": view.address, **told(stream)})


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
