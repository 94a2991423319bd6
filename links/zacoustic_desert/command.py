"""`zacoustic run modems desert`: the stand-in as a verb, for use without DESERT."""

import argparse
import asyncio
import os
import random
import sys
from typing import TYPE_CHECKING, Final

from zacoustic.command import EXIT_OK, Command
from zacoustic.core.clock import is_duration, ns_to_seconds
from zacoustic.errors import ConfigError
from zacoustic.link.serving import parse_place, run_until_stopped
from zacoustic.text.safetext import json_line, one_line

if TYPE_CHECKING:
    from zacoustic.channel.driver import Channel
    from zacoustic_desert.server import StandInServer
    from zacoustic_desert.standin import Observation, StandIn

FIRST_PORT: Final = 4000
"""Port of the first node in DESERT's sample script."""
NODES: Final = 2
"""Number of nodes without a scenario or an argument."""


class DesertEmulation(Command):
    """Serves a stand-in for DESERT's application sockets until it is interrupted."""

    name = "desert"
    summary = "stand in for DESERT's application sockets, for links desert/HOST:PORT"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare nodes, ports, the settings of DESERT's script, and the form of the output."""
        parser.epilog = (
            "example: two nodes, and a gateway on each\n"
            "  zacoustic run modems desert --listen 127.0.0.1:4000\n"
            "  zacoustic run gateway fleet.json5 --address 1 --link desert/127.0.0.1:4000\n"
            "  zacoustic run gateway fleet.json5 --address 2 --link desert/127.0.0.1:4001"
        )
        add = parser.add_argument
        add("--modems", type=int, metavar="N", help="number of nodes (default: 2)")
        add("--scenario", metavar="FILE", help="water and nodes of a scenario, JSON5")
        add("--listen", metavar="HOST:PORT", action="append", help="where to listen: once, for "
            "this port and the following ones, or once for each node; port 0 for any that is free "
            f"(default: 127.0.0.1:{FIRST_PORT})")  # fmt: skip
        add("--max-read-length", type=int, default=64, metavar="BYTES",
            help="largest packet (default: %(default)s)")  # fmt: skip
        add("--period", type=float, default=0.2, metavar="S",
            help="period_ of the application modules (default: %(default)s)")  # fmt: skip
        add("--no-csma", action="store_true", help="do not listen before a packet")
        add("--loss", type=float, default=0.0, metavar="SHARE",
            help="packets lost at random, without a scenario (default: %(default)s)")  # fmt: skip
        add("--paired", action="store_true", help="the first and the second node hear each "
            "other only, the third and the fourth, and so on")  # fmt: skip
        add("--start-delay", type=float, default=0.0, metavar="S",
            help="refuse connections so long, as DESERT does for 5 s (default: 0)")  # fmt: skip
        add("--seed", type=int, help="replaces the seed of the scenario (default: 1)")
        add("--time-scale", type=float, default=1.0, metavar="X",
            help="how many times faster than real (default: %(default)s)")  # fmt: skip
        add("--json", action="store_true", help="one JSON object per line")

    def run(self, arguments: argparse.Namespace) -> int:
        """Serve until SIGINT or SIGTERM, or until the output's reader closes.

        Raises:
            ConfigError: The scenario or an argument is wrong.
            LinkOpenError: A port cannot be listened at.
        """
        run_until_stopped(lambda stop: _serve(arguments, stop))
        return EXIT_OK


async def _serve(arguments: argparse.Namespace, stop: asyncio.Event) -> None:
    from zacoustic_desert.server import StandInServer

    reporter = _Reporter(stop, as_json=arguments.json)
    standin = _standin(arguments, reporter)
    host, ports = _parse_listen(arguments.listen, standin.nodes)
    if not is_duration(arguments.start_delay, or_zero=True):
        raise ConfigError(f"--start-delay is {arguments.start_delay:g}; allowed: 0 or more")
    server = StandInServer(standin, host=host, ports=ports, time_scale=arguments.time_scale)
    await server.open(start_delay_s=arguments.start_delay)
    try:
        reporter.listening(server)
        await asyncio.get_running_loop().create_future()  # until it is cancelled
    finally:
        await server.close()


def _standin(arguments: argparse.Namespace, reporter: "_Reporter") -> "StandIn":
    from zacoustic_desert.standin import StandIn, StandInConfig

    seed, channel = _channel(arguments)
    csma = {"wait_s": 0.0, "listen_s": 0.0} if arguments.no_csma else {}
    try:
        config = StandInConfig(
            max_read_length=arguments.max_read_length,
            period_s=arguments.period,
            paired=arguments.paired,
            **csma,
        )
    except ValueError as error:
        raise ConfigError(str(error)) from error
    rng = random.Random(f"stand-in/{seed}")
    return StandIn(channel, config, rng=rng, observer=reporter.observe)


def _channel(arguments: argparse.Namespace) -> "tuple[int, Channel]":
    """Return the seed, and the channel: a scenario's, or that of DESERT's sample."""
    from zacoustic_desert.channel import SampleChannel, medium_of

    if arguments.scenario is None:
        seed = 1 if arguments.seed is None else arguments.seed
        nodes = NODES if arguments.modems is None else arguments.modems
        if not 2 <= nodes <= 254:
            raise ConfigError(f"--modems is {nodes}; allowed: 2..254")
        return seed, SampleChannel(nodes, random.Random(f"water/{seed}"), loss=arguments.loss)
    import msgspec

    from zacoustic.channel.scenario import scenario_from_mapping
    from zacoustic.json5 import read_json5

    if arguments.loss:
        raise ConfigError("--loss beside --scenario; allowed: one of them, the scenario has `loss`")
    scenario = scenario_from_mapping(read_json5(arguments.scenario), source=arguments.scenario)
    if arguments.modems not in (None, len(scenario.nodes)):
        raise ConfigError(
            f"--modems is {arguments.modems}; {arguments.scenario} has {len(scenario.nodes)} nodes"
        )
    if arguments.seed is not None:
        scenario = msgspec.structs.replace(scenario, seed=arguments.seed)
    return scenario.seed, medium_of(scenario, arguments.max_read_length)


class _Reporter:
    """Reports events, as text or as JSON."""

    def __init__(self, stop: asyncio.Event, *, as_json: bool) -> None:
        self._stop = stop
        self._as_json = as_json

    def listening(self, server: "StandInServer") -> None:
        addresses = server.addresses
        links = ", ".join(f"--link desert/{address}" for address in addresses)
        self._write(
            {"event": "listening", "addresses": list(addresses)},
            f"stands in for DESERT with {len(addresses)} nodes: {links}",
        )

    def observe(self, observation: "Observation") -> None:
        at_s = ns_to_seconds(observation.at)
        record: dict[str, object] = {
            "event": observation.event, "at_s": at_s, "node": observation.node,
            "size_bytes": observation.size_bytes, "detail": observation.detail,
        }  # fmt: skip
        size = f" {observation.size_bytes} bytes" if observation.size_bytes else ""
        detail = f" ({observation.detail})" if observation.detail else ""
        text = f"{at_s:10.3f} s  node {observation.node}: {observation.event}{size}{detail}"
        self._write(record, text)

    def _write(self, record: dict[str, object], text: str) -> None:
        if self._stop.is_set():
            return
        try:
            print(json_line(record) if self._as_json else one_line(text), flush=True)
        except BrokenPipeError:
            self._stop.set()
            # The interpreter flushes again at exit.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parse_listen(listen: list[str] | None, nodes: int) -> tuple[str, list[int]]:
    """Host, and a port for each node."""
    places = [parse_place(place) for place in listen or [f"127.0.0.1:{FIRST_PORT}"]]
    if len(places) == 1:
        host, first = places[0]
        if first + nodes - 1 > 65_535:
            raise ConfigError(f"--listen {listen}: {nodes} ports from {first}; allowed: to 65535")
        return host, [first + node if first else 0 for node in range(nodes)]
    hosts = {host for host, _ in places}
    if len(places) != nodes or len(hosts) > 1:
        raise ConfigError(
            f"--listen is given {len(places)} times; allowed: once, or once for each of {nodes} "
            "nodes, with one host"
        )
    return hosts.pop(), [port for _, port in places]
