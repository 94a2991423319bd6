"""The verb `zacoustic silence`: orders a gateway to transmit nothing, and ends that."""

import argparse
import asyncio
import re
from typing import TYPE_CHECKING, Final

import msgspec

from zacoustic.cli.pub import check_positive, print_line
from zacoustic.command import EXIT_OK, Command
from zacoustic.errors import ConfigError

if TYPE_CHECKING:
    from zacoustic.gateway.silence import SilenceState

_EXAMPLE: Final = """what waits goes on waiting; a frame that the modem has begun is not cut off

examples:
  zacoustic silence --for 30m --connect tcp/127.0.0.1:7447    half an hour, all gateways here
  zacoustic silence --for 2h --node 2 --config router.json5   two hours, node 2
  zacoustic silence until-resumed --config router.json5       no end
  zacoustic silence resume --config router.json5              the end of it
  zacoustic silence --config router.json5                     what holds now
"""
_UNITS_S: Final = {"": 1, "s": 1, "m": 60, "h": 3600, "d": 86400}
_DURATION: Final = re.compile(r"(\d+(?:\.\d+)?)\s*([smhd]?)")


class SilenceCommand(Command):
    """Orders silence, ends it, or tells what holds."""

    name = "silence"
    summary = "transmit nothing for a while: divers, other sonars"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the order, how long, which node, where to ask."""
        parser.epilog = _EXAMPLE
        parser.add_argument(
            "order", nargs="?", choices=("resume", "until-resumed"),
            help="end the silence, or begin one without end",
        )  # fmt: skip
        parser.add_argument(
            "--for", dest="duration", metavar="TIME", help="be silent so long: 90s, 30m, 2h, 1d"
        )
        parser.add_argument(
            "--node", type=int, metavar="N",
            help="acoustic address of the gateway (default: all on this island)",
        )  # fmt: skip
        parser.add_argument(
            "--connect", action="append", metavar="ENDPOINT", help="Zenoh endpoint, tcp/HOST:PORT"
        )
        parser.add_argument("--config", metavar="FILE", help="file that tells where the router is")
        parser.add_argument("--json", action="store_true", help="one JSON object per line")
        parser.add_argument(
            "--timeout", type=float, default=10.0, metavar="S",
            help="how long to wait for the answer, s (default: %(default)g)",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Order it, and print what holds then; exit code 3 when nobody answers in time.

        Raises:
            ConfigError: The arguments contradict each other.
            DeliveryError: There is no such gateway, or it refuses.
        """
        check_positive(arguments, "timeout")
        for_s = None if arguments.duration is None else _seconds(arguments.duration)
        if arguments.order is not None and for_s is not None:
            raise ConfigError(f"--for {arguments.duration}; allowed: not with {arguments.order}")
        if arguments.node is not None and not 1 <= arguments.node <= 254:
            raise ConfigError(f"--node {arguments.node}; allowed: 1..254")
        order = {"resume": "resume", "until-resumed": "begin"}.get(arguments.order)
        if for_s is not None:
            order = "begin"
        for state in asyncio.run(_ask(arguments, order, for_s)):
            print_line(msgspec.to_builtins(state), _text(state), as_json=arguments.json)
        return EXIT_OK


async def _ask(
    arguments: argparse.Namespace, order: str | None, for_s: float | None
) -> "list[SilenceState]":
    from zacoustic.config import read_config
    from zacoustic.tools.silence import ask_silence

    config = None if arguments.config is None else read_config(arguments.config)
    return await ask_silence(
        config,
        arguments.connect,
        address=arguments.node,
        order=order,
        for_s=for_s,
        timeout_s=arguments.timeout,
    )


def _seconds(written: str) -> float:
    """Read a duration such as ``30m``.

    Raises:
        ConfigError: It is none.
    """
    found = _DURATION.fullmatch(written.strip())
    seconds = float(found[1]) * _UNITS_S[found[2]] if found else 0.0
    if seconds <= 0:
        raise ConfigError(f"--for {written}; allowed: a time above 0, such as 90s, 30m, 2h, 1d")
    return seconds


def _text(state: "SilenceState") -> str:
    if not state.silent:
        return f"node {state.address}: transmits"
    why = "ordered" if state.ordered else "a quiet window"
    until = f"until {state.until_utc}" if state.until_utc else "until it is resumed"
    return f"node {state.address}: silent, {why}, {until}"
