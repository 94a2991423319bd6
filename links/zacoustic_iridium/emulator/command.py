"""The verb `zacoustic run modems iridium`: SBD modems, and the provider's gateway."""

import argparse
import asyncio
from typing import TYPE_CHECKING, Final

from zacoustic.command import EXIT_OK, Command
from zacoustic.core.clock import DURATIONS, is_duration
from zacoustic.errors import ConfigError
from zacoustic.link.emulation.verb import Reporter, add_places, listens, open_places
from zacoustic.link.serving import LineWriter, parse_place, run_until_stopped

if TYPE_CHECKING:
    from zacoustic_iridium.emulator.server import SbdServer

FIRST_PORT: Final = 9600
_MOST_MODEMS: Final = 64


class IridiumEmulation(Command):
    """Serves emulated SBD modems until it is interrupted."""

    name = "iridium"
    summary = "Iridium SBD modems, on TCP ports and pseudo-terminals, and their gateway"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare modems, places, faults and form of the output."""
        parser.epilog = (
            "example: a vehicle and its shore\n"
            "  zacoustic run modems iridium --modems 1 --shore 127.0.0.1:9700\n"
            "  zacoustic run gateway fleet.json5 --address 2 \\\n"
            "    --link 'iridium/tcp:127.0.0.1:9600#max_bytes_per_day=5000'"
        )
        add = parser.add_argument
        add("--modems", type=int, default=2, metavar="N", help="how many (default: %(default)s)")
        add("--shore", metavar="HOST:PORT", help="where the gateway delivers by DirectIP "
            "(default: modems write to each other)")  # fmt: skip
        add("--session", type=float, nargs=2, default=(6.0, 30.0), metavar=("LEAST", "MOST"),
            help="duration of a session, s (default: 6 30)")  # fmt: skip
        add("--no-network", type=float, default=0.0, metavar="SHARE",
            help="sessions without a network (default: %(default)s)")  # fmt: skip
        add("--breaks", type=float, default=0.0, metavar="SHARE", help="sessions that break off "
            "after the message is at the gateway (default: %(default)s)")  # fmt: skip
        add("--seed", type=int, default=1, help="of all draws (default: %(default)s)")
        add_places(parser, FIRST_PORT)

    def run(self, arguments: argparse.Namespace) -> int:
        """Serve until SIGINT or SIGTERM.

        Raises:
            ConfigError: An argument is wrong.
            LinkOpenError: An address cannot be listened at.
        """
        run_until_stopped(lambda stop: _serve(arguments, stop))
        return EXIT_OK


async def _serve(arguments: argparse.Namespace, stop: asyncio.Event) -> None:
    server = _server(arguments)
    addresses = range(1, 1 + arguments.modems)
    # DirectIP has the place behind those of the modems.
    hosts = listens(arguments, len(addresses) + 1, FIRST_PORT)
    try:
        with LineWriter("emulate iridium", stop) as writer:
            reporter = Reporter(writer, "iridium", as_json=arguments.json)
            has_terminals = arguments.pty
            for place in await open_places(
                server.modems, addresses, hosts, has_terminals=has_terminals
            ):
                reporter.listening(place, imei=server.isus[place.address - 1].imei)
            await server.open_gateway(*(hosts or [("127.0.0.1", 0)])[-1])
            record: dict[str, object] = {"event": "directip", "place": server.directip}
            reporter.write(record, f"DirectIP for messages to modems at {server.directip}")
            await asyncio.get_running_loop().create_future()  # until it is cancelled
    finally:
        await server.close()


def _server(arguments: argparse.Namespace) -> "SbdServer":
    from zacoustic_iridium.emulator.isu import IsuFaults
    from zacoustic_iridium.emulator.server import SbdServer

    if not 1 <= arguments.modems <= _MOST_MODEMS:
        raise ConfigError(f"--modems is {arguments.modems}; allowed: 1..{_MOST_MODEMS}")
    least_s, most_s = arguments.session
    if not (is_duration(least_s) and is_duration(most_s) and least_s <= most_s):
        raise ConfigError(f"--session is {least_s:g} {most_s:g}; allowed: {DURATIONS}, ascending")
    for name in ("no_network", "breaks"):
        if not 0 <= getattr(arguments, name) <= 1:
            raise ConfigError(f"--{name.replace('_', '-')}: allowed: 0..1")
    return SbdServer(
        arguments.modems,
        shore=None if arguments.shore is None else parse_place(arguments.shore),
        session_s=(least_s, most_s),
        faults=IsuFaults(statuses={32: arguments.no_network}, breaks_after=arguments.breaks),
        seed=arguments.seed,
        time_scale=arguments.time_scale,
    )
