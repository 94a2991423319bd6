"""The verb `zacoustic stream`: switches a topic of a node off and on, sets rate and priority."""

import argparse
import asyncio
from typing import Any, Final

from zacoustic.app.cli.remote.silence import add_command_arguments, give, make_command
from zacoustic.app.cli.support.arguments import check_positive
from zacoustic.errors import ConfigError
from zacoustic.link.command import Command

_EXAMPLE: Final = """for a topic that the node publishes; it applies at once, without a restart,
and survives one if the node has a journal

examples:
  zacoustic stream auv1/nav --node 2 --config shore.json5                   how it is sent
  zacoustic stream auv1/nav --node 2 --off --config shore.json5             not at all
  zacoustic stream auv1/nav --node 2 --on --rate 0.1 --config shore.json5   at most every 10 s
  zacoustic stream auv1/nav --node 2 --priority background --config shore.json5
  zacoustic stream auv1/nav --node 2 --reset --config shore.json5           as its file says
"""


class StreamCommand(Command):
    """Overrides how a node sends a topic, or prints the override."""

    name = "stream"
    summary = "switch a topic of a node off or on, set its rate and priority"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare topic, node, settings, and where to ask."""
        parser.epilog = _EXAMPLE
        parser.add_argument(
            "stream", metavar="STREAM", nargs="?",
            help="name or stream id; a name is that of --config, or of a gateway here",
        )  # fmt: skip
        parser.add_argument("--id", type=int, metavar="ID", help=argparse.SUPPRESS)
        switch = parser.add_mutually_exclusive_group()
        switch.add_argument("--on", action="store_true", help="its samples go")
        switch.add_argument(
            "--off", action="store_true", help="they wait, expire and are superseded"
        )
        switch.add_argument(
            "--reset", action="store_true", help="everything as the node's file configures it"
        )
        parser.add_argument(
            "--rate", type=float, metavar="HZ", help="maximum rate of samples of a key"
        )
        parser.add_argument("--priority", metavar="NAME", help="Zenoh's, such as background")
        add_command_arguments(parser, is_node_required=True)

    def run(self, arguments: argparse.Namespace) -> int:
        """Send the command and print the new state; exit code 3 without an answer in time.

        Raises:
            ConfigError: An argument is wrong.
            DeliveryError, ServiceError: There is no such node, or it refuses.
        """
        from zacoustic.core.base.qos import PRIORITY_NAMES
        from zacoustic.core.streams.commands import CommandKind

        check_positive(arguments, "rate")
        fields: dict[str, Any] = {
            "on": True if arguments.on else False if arguments.off else None,
            "min_interval_s": None if arguments.rate is None else 1 / arguments.rate,
        }
        if arguments.priority is not None:
            if arguments.priority not in PRIORITY_NAMES:
                allowed = ", ".join(PRIORITY_NAMES)
                raise ConfigError(f"--priority {arguments.priority}; allowed: {allowed}")
            fields["priority"] = PRIORITY_NAMES[arguments.priority]
        is_overridden = any(value is not None for value in fields.values())
        if arguments.reset and is_overridden:
            raise ConfigError("--reset; allowed: not with --rate and --priority")
        kind = CommandKind.OVERRIDE if is_overridden else CommandKind.ASK
        if arguments.reset:
            kind = CommandKind.RESET
        command = make_command(kind=kind, stream_id=_stream_id(arguments), **fields)
        return give(arguments, command)


def _stream_id(arguments: argparse.Namespace) -> int:
    """Return the id of the stream that the arguments name.

    Raises:
        ConfigError: None is named, or two are, or there is none of this name.
    """
    if (arguments.stream is None) == (arguments.id is None):
        raise ConfigError("STREAM; allowed: one, by its name or id")
    if arguments.id is not None:
        return int(arguments.id)
    if arguments.stream.isascii() and arguments.stream.isdigit():
        return int(arguments.stream)
    from zacoustic.app.tools.fleetfile import read_fleet

    if arguments.config is None:
        known = asyncio.run(_ids_of_gateways(arguments.connect))
    else:
        table = read_fleet(arguments.config).table
        known = {stream.name: stream.stream_id for stream in table}
    if arguments.stream not in known:
        names = ", ".join(sorted(known)[:8])
        raise ConfigError(f"STREAM {arguments.stream}; allowed: {names or 'a stream id'}")
    return known[arguments.stream]


async def _ids_of_gateways(connect: "list[str] | None") -> dict[str, int]:
    """Return the ids of the streams of all gateways here, by name."""
    from zacoustic.app.tools.watch.watching import Watch

    async with Watch(None, connect) as watch:
        views = watch.board.views()
    return {stream.name: stream.id for view in views for stream in view.streams}
