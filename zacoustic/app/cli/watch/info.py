"""The verb `zacoustic topic info`: one topic: its definition, and what gateways count of it."""

import argparse
import asyncio
from typing import Final

from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.app.cli.watch.topics import add_watch_arguments, chosen, make_watch, read_watch
from zacoustic.errors import DeliveryError
from zacoustic.link.command import EXIT_OK, Command

_EXAMPLE: Final = """With --config it says what the file defines as well: type, publishers,
subscribers, priority, reliability. A service or an action may be named, too. It costs no airtime.

examples:
  zacoustic topic info auv1/nav --connect tcp/127.0.0.1:7447
  zacoustic topic info auv1/nav --config router.json5
"""


class InfoCommand(Command):
    """Shows one stream."""

    name = "info"
    summary = "one topic: its definition, and what gateways count of it"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the topic, gateways, their network, and the form of the output."""
        parser.epilog = _EXAMPLE
        parser.add_argument("stream", metavar="TOPIC", help="name or stream id")
        add_watch_arguments(parser)

    def run(self, arguments: argparse.Namespace) -> int:
        """Query the gateways and print.

        Raises:
            SessionError: No router can be reached.
            DeliveryError: No gateway is there, or none has the topic.
        """
        asyncio.run(_show(arguments))
        return EXIT_OK


async def _show(arguments: argparse.Namespace) -> None:
    from zacoustic.app.tools.watch.streaminfo import definition_of, info_text, stream_in
    from zacoustic.app.tools.watch.views import told

    config = read_watch(arguments)
    async with make_watch(arguments) as watch:
        views = chosen(watch, arguments.node)
    found = [
        (view, stream)
        for view in views
        if (stream := stream_in(view.streams, arguments.stream)) is not None
    ]
    if not found:
        known = ", ".join(stream.name for view in views for stream in view.streams[:8])
        raise DeliveryError(
            f"no gateway here has a stream {arguments.stream}", hint=f"some that are: {known}"
        )
    definition = None if config is None else definition_of(config, found[0][1].id)
    if arguments.json:
        counts = [{"gateway": view.address, "stream": told(stream)} for view, stream in found]
        print_json({"definition": definition, "gateways": counts})
    else:
        print_text(info_text(found, definition))
