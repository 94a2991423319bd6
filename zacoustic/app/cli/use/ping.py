"""The verb `zacoustic ping`: round-trip time, range and signal of a remote node."""

import argparse
import asyncio
import contextlib
from typing import TYPE_CHECKING, Any, Final

from zacoustic.app.cli.support.arguments import check_positive
from zacoustic.app.cli.support.participant import add_node_arguments, make_node
from zacoustic.app.cli.support.printing import print_json, print_line, print_text
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_OK, EXIT_TIMED_OUT, Command
from zacoustic.text.digits import whole_number
from zacoustic.text.safetext import one_line

if TYPE_CHECKING:
    from collections.abc import AsyncIterator

    from zacoustic.app.tools.field.pinging import Ping, Pinger, PingStatistics, Spread
    from zacoustic.config import Config

_LONGEST_S: Final = 600.0
MOST_FRAMES: Final = 6
"""Frames of a ping without losses: request, answer, two confirmations, a byte for the range, and
half a minute later the end of the call at both ends."""
MOST_BYTES: Final = 66
"""Their bytes in total, if the two nodes have not met yet."""
_EXAMPLE: Final = f"""it costs at most {MOST_FRAMES} frames, {MOST_BYTES} bytes together:
question, answer, what confirms them, which rides on other frames where there are any, and, where a
modem measures ranges on demand, a byte for that; a lost one is repeated within --timeout. The node
answers by itself, whatever runs there, unless it is silent.

examples:
  zacoustic ping 2 --connect tcp/127.0.0.1:7447
  zacoustic ping auv1 --config router.json5 --count 10 --interval 30 --json
  zacoustic ping 2 --link evologics/tcp:192.168.0.209:9200 --config router.json5
"""


class PingCommand(Command):
    """Pings a node: round-trip time, range, signal."""

    name = "ping"
    summary = "ping a remote node: round trip, range, signal"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare node, path, number and time limit."""
        parser.epilog = _EXAMPLE
        parser.add_argument("node", metavar="NODE", help="its address, or its name in --config")
        add_node_arguments(parser)
        parser.add_argument(
            "--count", type=int, default=4, metavar="N", help="how often (default: %(default)d)"
        )
        parser.add_argument(
            "--interval", type=float, default=5.0, metavar="S",
            help="least time from one to the next, s (default: %(default)g)",
        )  # fmt: skip
        parser.add_argument(
            "--timeout", type=float, default=30.0, metavar="S",
            help="how long to wait for each answer, s (default: %(default)g)",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Ping; exit code 3 if no ping was answered.

        Raises:
            DeliveryError, LocalError: The node cannot be asked.
        """
        check_positive(arguments, "count", "interval", "timeout")
        if arguments.timeout > _LONGEST_S:
            raise ConfigError(f"--timeout {arguments.timeout:g}; allowed: at most {_LONGEST_S:g}")
        done: list[Ping] = []
        try:
            asyncio.run(_ping(arguments, done))
        except KeyboardInterrupt:
            if not done:
                raise
        return _conclude(arguments, done)


async def _ping(arguments: argparse.Namespace, done: "list[Ping]") -> None:
    from zacoustic.app.tools.field.pinging import pings
    from zacoustic.app.tools.fleetfile import read_fleet

    config = None if arguments.config is None else read_fleet(arguments.config)
    node = _address(arguments.node, config)
    async with _pinger(arguments, config) as pinger:
        async for ping in pings(
            pinger,
            node,
            count=arguments.count,
            interval_s=arguments.interval,
            timeout_s=arguments.timeout,
        ):
            done.append(ping)
            print_line(_record(node, ping), _text(node, ping), as_json=arguments.json)


@contextlib.asynccontextmanager
async def _pinger(
    arguments: argparse.Namespace, config: "Config | None"
) -> "AsyncIterator[Pinger]":
    from zacoustic.app.tools.field.asking import local_gateways
    from zacoustic.app.tools.field.pinging import GatewayPinger, LinkPinger

    if arguments.link is None:
        async with local_gateways(config, arguments.connect) as gateways:
            yield GatewayPinger(gateways)
    else:
        async with make_node(arguments) as own:
            yield LinkPinger(own)


def _address(written: str, config: "Config | None") -> int:
    """Return the address of a node.

    Raises:
        ConfigError: It is not valid, or the name is unknown.
    """
    address = whole_number(written)
    if address is not None:
        if not 1 <= address <= 254:
            raise ConfigError(f"NODE {written}; allowed: 1..254, or a name")
        return address
    if config is None:
        raise ConfigError(f"NODE {written}", hint="a name needs --config FILE; else an address")
    names = {name: address for address, name in config.table.nodes.items()}
    if written not in names:
        known = ", ".join(names) or "none"
        raise ConfigError(f"NODE {written}; allowed: an address, or one of: {known}")
    return names[written]


def _record(node: int, ping: "Ping") -> dict[str, Any]:
    import msgspec

    found = {} if ping.answer is None else msgspec.to_builtins(ping.answer)
    head = {"number": ping.number, "node": node, "answered": ping.answer is not None}
    found.pop("address", None)
    why = {"why": ping.why} if ping.why else {}
    return {**head, **found, **why, "unix_s": ping.unix_s}


def _text(node: int, ping: "Ping") -> str:
    answer = ping.answer
    if answer is None:
        return f"{ping.number}: {one_line(ping.why) or f'node {node}: no answer in time'}"
    return f"{ping.number}: {answer.text()}"


def _conclude(arguments: argparse.Namespace, done: "list[Ping]") -> int:

    from zacoustic.app.tools.field.pinging import statistics_of

    found = statistics_of(done)
    if arguments.json:
        print_json({"statistics": found})
    else:
        print_text(_statistics_text(one_line(arguments.node), found))
    return EXIT_OK if found.answered else EXIT_TIMED_OUT


def _statistics_text(node: str, found: "PingStatistics") -> str:
    lost = 1 - found.answered / found.sent if found.sent else 0.0
    lines = [f"node {node}: {found.sent} sent, {found.answered} answered, {lost:.0%} lost"]
    if found.round_trip_s is not None:
        lines.append(f"round trip {_spread(found.round_trip_s, 2)} s")
    if found.range_m is not None:
        lines.append(f"range {_spread(found.range_m, 1)} m")
    return "\n".join(lines)


def _spread(spread: "Spread", digits: int) -> str:
    values = (spread.least, spread.mean, spread.most, spread.deviation)
    return f"min/mean/max/sd {'/'.join(f'{value:.{digits}f}' for value in values)}"
