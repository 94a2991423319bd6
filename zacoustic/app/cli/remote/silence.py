"""The verb `zacoustic silence`: commands transmit silence; also the shared parts of such verbs."""

import argparse
import asyncio
import re
from typing import TYPE_CHECKING, Any, Final

import msgspec

from zacoustic.app.cli.support.arguments import (
    OBJECT_PER_LINE,
    add_json,
    add_local_network,
    check_positive,
)
from zacoustic.app.cli.support.printing import print_line
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_OK, Command

if TYPE_CHECKING:
    from zacoustic.core.streams.commands import RemoteCommand

_EXAMPLE: Final = """waiting data stays; a frame that the modem has begun is not cut off

examples:
  zacoustic silence --for 30m --connect tcp/127.0.0.1:7447    half an hour, all gateways here
  zacoustic silence --for 2h --node 2 --config router.json5   two hours, node 2, wherever it is
  zacoustic silence until-resumed --config router.json5       no end
  zacoustic silence resume --config router.json5              the end of it
  zacoustic silence --config router.json5                     what holds now

A remote node is silent when the command has arrived, and its answer is its last frame. If none
comes in time (exit code 3), it may be silent all the same.
"""
_UNITS_S: Final = {"": 1, "s": 1, "m": 60, "h": 3600, "d": 86400}
_DURATION: Final = re.compile(r"([0-9]+(?:\.[0-9]+)?)\s*([smhd]?)")
_HERE_S: Final = 10.0
_BEYOND_S: Final = 60.0


class SilenceCommand(Command):
    """Commands transmit silence, ends it, or prints the state."""

    name = "silence"
    summary = "transmit nothing for a while: divers, other sonars"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare command, duration, node, and where to ask."""
        parser.epilog = _EXAMPLE
        parser.add_argument(
            "command", nargs="?", choices=("resume", "until-resumed"),
            help="end the silence, or begin one without end",
        )  # fmt: skip
        parser.add_argument(
            "--for",
            dest="duration",
            metavar="TIME",
            help="duration of the silence: 90s, 30m, 2h, 1d",
        )
        add_command_arguments(parser)

    def run(self, arguments: argparse.Namespace) -> int:
        """Send the command and print the new state; exit code 3 without an answer in time.

        Raises:
            ConfigError: The arguments contradict each other.
            DeliveryError, ServiceError: There is no such node, or it refuses.
        """
        from zacoustic.core.streams.commands import CommandKind

        for_s = None if arguments.duration is None else _seconds(arguments.duration)
        if arguments.command is not None and for_s is not None:
            raise ConfigError(f"--for {arguments.duration}; allowed: not with {arguments.command}")
        kind = {"resume": CommandKind.RESUME, "until-resumed": CommandKind.SILENCE}.get(
            arguments.command, CommandKind.ASK if for_s is None else CommandKind.SILENCE
        )
        return give(arguments, make_command(kind=kind, for_s=for_s))


def add_command_arguments(
    parser: argparse.ArgumentParser, *, is_node_required: bool = False
) -> None:
    """Declare the commanded node, and where Zenoh is joined."""
    default = "" if is_node_required else " (default: those of all gateways here)"
    parser.add_argument(
        "--node", type=int, metavar="N", required=is_node_required,
        help=f"acoustic address of the node, of this local network or remote{default}",
    )  # fmt: skip
    add_local_network(parser)
    add_json(parser, OBJECT_PER_LINE)
    parser.add_argument(
        "--timeout", type=float, metavar="S",
        help=f"how long to try, s (default: {_BEYOND_S:g} for one node, else {_HERE_S:g})",
    )  # fmt: skip


def make_command(**fields: Any) -> "RemoteCommand":  # noqa: ANN401 (fields of a command)
    """Make a command.

    Raises:
        ConfigError: The fields contradict each other.
    """
    from zacoustic.core.streams.commands import RemoteCommand

    try:
        return RemoteCommand(**fields)
    except ValueError as error:
        raise ConfigError(str(error)) from None


def give(arguments: argparse.Namespace, command: "RemoteCommand") -> int:
    """Send a command and print the new state.

    Args:
        arguments: Those of `add_command_arguments`.
        command: The command.

    Raises:
        ConfigError: An argument is wrong.
        DeliveryError, ServiceError: There is no such node, or it refuses.
    """
    from zacoustic.app.tools.field.asking import local_gateways
    from zacoustic.app.tools.fleetfile import read_fleet
    from zacoustic.zenoh.requests.commands import row_of

    check_positive(arguments, "timeout")
    if arguments.node is not None and not 1 <= arguments.node <= 254:
        raise ConfigError(f"--node {arguments.node}; allowed: 1..254")
    timeout_s = arguments.timeout
    if timeout_s is None:
        timeout_s = _HERE_S if arguments.node is None else _BEYOND_S
    request = row_of(command)
    if timeout_s > request.most_s:
        raise ConfigError(f"--timeout {timeout_s:g}; allowed: at most {request.most_s:g}")
    config = None if arguments.config is None else read_fleet(arguments.config)

    async def ask() -> list[Any]:
        async with local_gateways(config, arguments.connect) as gateways:
            if arguments.node is None:
                return await gateways.ask_all(request, command, timeout_s)
            return [await gateways.ask(request, arguments.node, command, timeout_s)]

    for state in sorted(asyncio.run(ask()), key=lambda state: state.address):
        print_line(msgspec.to_builtins(state), state.text(), as_json=arguments.json)
    return EXIT_OK


def _seconds(written: str) -> float:
    """Read a duration such as ``30m``.

    Raises:
        ConfigError: It is not a duration.
    """
    found = _DURATION.fullmatch(written.strip())
    seconds = float(found[1]) * _UNITS_S[found[2]] if found else 0.0
    if seconds <= 0:
        raise ConfigError(f"--for {written}; allowed: a time above 0, such as 90s, 30m, 2h, 1d")
    return seconds
