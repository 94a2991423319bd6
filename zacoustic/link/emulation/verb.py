"""Arguments, places and output that the verbs `zacoustic run modems …` have in common.

With `--json` such a verb prints one object a line, first the place of each modem::

    listening   address locator                   again for each further port of a modem
"""

import argparse
import asyncio
import contextlib
from collections.abc import Sequence
from typing import Final, Protocol

from zacoustic.channel.propagation.position import Position
from zacoustic.errors import ConfigError
from zacoustic.link.emulation.modems import Emulation
from zacoustic.link.emulation.running import RunningEmulation
from zacoustic.link.emulation.server import EmulationServer, Place
from zacoustic.link.positions import add_positions, positions_from
from zacoustic.link.serving import LineWriter, parse_place
from zacoustic.text.safetext import json_line, one_line

_LAST_PORT: Final = 65_535


class Afloat(Emulation, Protocol):
    """An emulation whose modems have places in water."""

    @property
    def addresses(self) -> Sequence[int]:
        """Addresses of the modems."""
        ...

    def move(self, address: int, position: Position, now: int) -> None:
        """Set the position of a modem from now on: x east, y north, z down, m.

        Raises:
            ValueError: No such modem, or a coordinate that is not a number or too large.
        """
        ...


class Steered:
    """Modems that another program moves.

    Args:
        modems: The emulation.
        running: Its clock.
    """

    def __init__(self, modems: Afloat, running: RunningEmulation) -> None:
        self._modems = modems
        self._running = running

    def move(self, address: int, position: Position) -> None:
        """Set the position of a modem from now on; raises as `Afloat.move`."""
        self._modems.move(address, position, self._running.now())


class Reporter:
    """Prints events, as text or as JSON.

    Args:
        writer: Takes the lines.
        make: Name of the link, as in its locator.
        as_json: One JSON object a line.
    """

    def __init__(self, writer: LineWriter, make: str, *, as_json: bool) -> None:
        self._writer = writer
        self._make = make
        self._as_json = as_json

    def listening(self, place: Place, **named: str) -> None:
        """Print the place of a modem.

        Args:
            place: The place.
            named: Another name than the address, such as its IMEI.
        """
        name: dict[str, object] = {**named} or {"address": place.address}
        shown = next(iter(name.values()))
        self.write(
            {"event": "listening", **name, "locator": place.locator},
            f"modem {shown} at {place.locator}: --link {self._make}/{place.locator}",
        )

    def write(self, record: dict[str, object], text: str) -> None:
        """Print an event."""
        self._writer.write(json_line(record) if self._as_json else one_line(text))


def add_places(parser: argparse.ArgumentParser, first_port: int, *, json_help: str = "") -> None:
    """Declare places, time scale and form of the output.

    Args:
        parser: Gets the arguments.
        first_port: Port of the first modem, unless the user names one.
        json_help: Meaning of the objects.
    """
    parser.add_argument(
        "--listen", metavar="HOST:PORT", nargs="+", action="extend", default=[],
        help="of each modem in turn; after the last one the next ports are taken, port 0 takes "
        f"any that is free (default: 127.0.0.1:{first_port}, unless --pty)",
    )  # fmt: skip
    parser.add_argument("--pty", action="store_true", help="a pseudo-terminal for each modem")
    parser.add_argument(
        "--time-scale", type=float, default=1.0, metavar="X",
        help="how many times faster than real (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help=f"one JSON object per line{json_help}")


def add_scenario(parser: argparse.ArgumentParser) -> None:
    """Declare who is where."""
    parser.add_argument(
        "--modems", type=int, metavar="N",
        help="how many, 500 m apart in calm water (default: those of the scenario, or 2)",
    )  # fmt: skip
    parser.add_argument("--scenario", metavar="FILE", help="who is where, JSON5")
    add_positions(parser)


def listens(
    arguments: argparse.Namespace, count: int, first_port: int
) -> list[tuple[str, int]] | None:
    """Return host and port of each place; None: there are pseudo-terminals only.

    Args:
        arguments: As declared by `add_places`.
        count: Number of places.
        first_port: Port of the first one, unless the user names one.

    Raises:
        ConfigError: `--listen` is no place, or there is no port for each one.
    """
    if arguments.pty and not arguments.listen:
        return None
    texts: list[str] = arguments.listen or [f"127.0.0.1:{first_port}"]
    given = [parse_place(text) for text in texts[:count]]
    host, port = given[-1]
    for further in range(1, 1 + count - len(given)):
        if port + further > _LAST_PORT:
            raise ConfigError(f"--listen {texts[-1]!r}; there is no port for every modem behind it")
        given.append((host, port + further if port else 0))
    return given


async def open_places(
    server: EmulationServer,
    addresses: Sequence[int],
    hosts: Sequence[tuple[str, int]] | None,
    *,
    has_terminals: bool,
) -> list[Place]:
    """Open the ports and pseudo-terminals of all modems.

    Args:
        server: Serves them.
        addresses: Their addresses.
        hosts: The result of `listens`.
        has_terminals: Whether each modem has a pseudo-terminal.

    Raises:
        LinkOpenError: A place cannot be used.
    """
    places = []
    for index, address in enumerate(addresses):
        if hosts is not None:
            places.append(await server.listen(address, *hosts[index]))
        if has_terminals:
            places.append(server.open_terminal(address))
    return places


async def serve(
    modems: Afloat, arguments: argparse.Namespace, reporter: Reporter, *, first_port: int
) -> None:
    """Serve modems in water until the task is cancelled.

    Args:
        modems: The emulation.
        arguments: As declared by `add_places` and `add_scenario`.
        reporter: Prints the places.
        first_port: Port of the first modem, unless the user names one.

    Raises:
        ConfigError: An argument is wrong.
        LinkOpenError: A place cannot be used.
    """
    hosts = listens(arguments, len(modems.addresses), first_port)
    running = RunningEmulation(modems, time_scale=arguments.time_scale)
    async with contextlib.AsyncExitStack() as stack:
        server = EmulationServer(running)
        stack.push_async_callback(server.close)
        stack.enter_context(positions_from(arguments, Steered(modems, running)))
        opened = await open_places(server, modems.addresses, hosts, has_terminals=arguments.pty)
        for place in opened:
            reporter.listening(place)
        running.start()
        await asyncio.get_running_loop().create_future()  # until it is cancelled
