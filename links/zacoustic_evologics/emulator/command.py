"""The verb `zacoustic run modems evologics`: modems on TCP ports and pseudo-terminals.

With `--json` it prints one object a line: first the place of each modem, before anything else::

    listening   address locator                   again for each further port of a modem

then the events on the channel, which no modem knows. Names as in `zacoustic run medium --json`::

    emission    at_s source sequence service      a signal begins; `source` is the modem's address
                destination frame_bytes airtime_s in the scenario, `sequence` counts its signals
    reception   at_s source sequence service      … and has ended at another modem, `node`
                node outcome snr_db propagation_s

`service` is `im`, `ims` or `burst` for data of hosts, and `frame_bytes` is their size. Signals that
modems send by themselves have 0 bytes, unless a message goes with them: `ack`, `connect`, `accept`,
`burst ack`, `probe`. `outcome` is `received`, or the cause of the loss: `noise`, `collision`,
`half_duplex` (the modem was transmitting), `deaf` (it followed another sound). It is the outcome on
the channel: it does not show a modem that restarts meanwhile, or an acknowledgement lost by
`--faults`. `at_s` counts from the start, in the time of the modems.

With `--positions` another program steers the modems: see `zacoustic.link.positions`.
"""

import argparse
import asyncio
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from zacoustic.command import EXIT_OK, Command
from zacoustic.core.clock import ns_to_seconds
from zacoustic.errors import ConfigError
from zacoustic.link.positions import add_positions, positions_from
from zacoustic.link.serving import LineWriter, parse_place, run_until_stopped
from zacoustic.text.safetext import json_line, one_line

if TYPE_CHECKING:
    from zacoustic.channel.scenario import Scenario
    from zacoustic_evologics.emulator.fleet import EmulatedFleet
    from zacoustic_evologics.emulator.observation import Observation, Observer
    from zacoustic_evologics.emulator.serving.server import FleetServer, Place

FIRST_PORT: Final = 9200
"""Port of the first modem, as on a real one; further modems have the next ports."""


class EvologicsEmulation(Command):
    """Serves emulated S2C modems until it is interrupted."""

    name = "evologics"
    summary = "EvoLogics S2C modems, on TCP ports and pseudo-terminals"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare modems, places, faults and form of the output."""
        parser.epilog = "example: zacoustic run modems evologics --modems 2 --listen 127.0.0.1:9200"
        parser.add_argument(
            "--modems", type=int, metavar="N",
            help="how many, 500 m apart in calm water (default: those of the scenario, or 2)",
        )  # fmt: skip
        parser.add_argument("--scenario", metavar="FILE", help="who is where, JSON5")
        parser.add_argument(
            "--listen", metavar="HOST:PORT", nargs="+", action="extend", default=[],
            help="of each modem in turn; after the last one the next ports are taken, port 0 takes "
            f"any that is free (default: 127.0.0.1:{FIRST_PORT}, unless --pty)",
        )  # fmt: skip
        parser.add_argument("--pty", action="store_true", help="a pseudo-terminal for each modem")
        parser.add_argument(
            "--time-scale", type=float, default=1.0, metavar="X",
            help="how many times faster than real (default: %(default)s)",
        )  # fmt: skip
        parser.add_argument("--faults", metavar="FILE", help="what goes wrong, JSON5")
        parser.add_argument("--seed", type=int, help="replaces the seeds of scenario and faults")
        parser.add_argument(
            "--interpreter", choices=("NET", "AT"), default="NET",
            help="who reads on the ports; AT begins in data mode (default: %(default)s)",
        )  # fmt: skip
        parser.add_argument(
            "--firmware", choices=("1.6", "1.7", "1.8", "1.9"), default="1.9",
            help="of all modems: which fields records have, what is known (default: %(default)s)",
        )  # fmt: skip
        parser.add_argument(
            "--set", metavar="NAME=VALUE", nargs="+", action="extend", default=[], dest="settings",
            help="settings and port options of all modems, such as ZX=1 RI=0",
        )  # fmt: skip
        add_positions(parser)
        parser.add_argument(
            "--json", action="store_true",
            help="one JSON object per line: `listening` for each place, then `emission` and "
            "`reception` of each signal",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Serve until SIGINT or SIGTERM.

        Raises:
            ConfigError: A file or an argument is wrong.
            LinkOpenError: An address cannot be listened at.
        """
        run_until_stopped(lambda stop: self._serve(arguments, stop))
        return EXIT_OK

    async def _serve(self, arguments: argparse.Namespace, stop: asyncio.Event) -> None:
        from zacoustic_evologics.emulator.serving.running import RunningFleet
        from zacoustic_evologics.emulator.serving.server import FleetServer

        writer = LineWriter("emulate evologics", stop)
        reporter = _Reporter(writer, as_json=arguments.json)
        fleet = _create_fleet(arguments, reporter.observe)
        addresses = fleet.addresses
        listens = [] if arguments.pty and not arguments.listen else _listens(arguments, addresses)
        with writer:
            running = RunningFleet(fleet, time_scale=arguments.time_scale)
            server = FleetServer(running)
            try:
                with positions_from(arguments, running):
                    for place in await _open_places(server, addresses, listens, arguments.pty):
                        reporter.listening(place)
                    running.start()
                    await asyncio.get_running_loop().create_future()  # until it is cancelled
            finally:
                await server.close()


async def _open_places(
    server: "FleetServer",
    addresses: Sequence[int],
    listens: Sequence[tuple[str, int]],
    has_terminals: bool,
) -> "list[Place]":
    places = []
    for index, address in enumerate(addresses):
        if listens:
            places.append(await server.listen(address, *listens[index]))
        if has_terminals:
            places.append(server.open_terminal(address))
    return places


class _Reporter:
    """Prints events, as text or as JSON."""

    def __init__(self, writer: LineWriter, *, as_json: bool) -> None:
        self._writer = writer
        self._as_json = as_json

    def listening(self, place: "Place") -> None:
        """Print the place of a modem."""
        self._write(
            {"event": "listening", "address": place.address, "locator": place.locator},
            f"modem {place.address} at {place.locator}: --link evologics/{place.locator}",
        )

    def observe(self, observation: "Observation") -> None:
        """Print an event on the channel."""
        from zacoustic_evologics.emulator.observation import SignalEmitted

        signal = observation.signal
        at_s, service = ns_to_seconds(observation.at), signal.kind.service
        if isinstance(observation, SignalEmitted):
            size = signal.content_bytes
            record: dict[str, object] = {
                "event": "emission", "at_s": at_s, "source": observation.node,
                "sequence": observation.sequence, "service": service,
                "destination": signal.destination, "frame_bytes": size,
                "airtime_s": ns_to_seconds(signal.duration_ns),
            }  # fmt: skip
            text = f"{observation.node} sends {service}" + (f", {size} bytes" if size else "")
        else:
            record = {
                "event": "reception", "at_s": at_s, "source": observation.source,
                "sequence": observation.sequence, "service": service, "node": observation.node,
                "outcome": observation.outcome.value, "snr_db": round(observation.snr_db, 2),
                "propagation_s": observation.propagation_s,
            }  # fmt: skip
            heard = f"{observation.source} at {observation.node}"
            text = f"{heard}: {service} {observation.outcome.value}"
        self._write(record, f"{at_s:10.3f} s  {text}")

    def _write(self, record: dict[str, object], text: str) -> None:
        self._writer.write(json_line(record) if self._as_json else one_line(text))


def _create_fleet(arguments: argparse.Namespace, observer: "Observer") -> "EmulatedFleet":
    import msgspec

    from zacoustic.json5 import read_json5
    from zacoustic_evologics.at.framing import Interpreter
    from zacoustic_evologics.emulator.fleet import EmulatedFleet
    from zacoustic_evologics.emulator.hardware.chassis import Behaviour
    from zacoustic_evologics.emulator.station.faults import NO_FAULTS, plan_from_mapping

    faults = NO_FAULTS
    if arguments.faults is not None:
        faults = plan_from_mapping(read_json5(arguments.faults), source=arguments.faults)
    scenario = _read_scenario(arguments)
    if arguments.seed is not None:
        faults = msgspec.structs.replace(faults, seed=arguments.seed)
        scenario = msgspec.structs.replace(scenario, seed=arguments.seed)
    return EmulatedFleet(
        scenario,
        interpreter=Interpreter(arguments.interpreter),
        faults=faults,
        settings=_parse_settings(arguments.settings),
        behaviour=Behaviour(firmware=arguments.firmware),
        observer=observer,
    )


def _read_scenario(arguments: argparse.Namespace) -> "Scenario":
    import msgspec

    from zacoustic.channel.scenario import scenario_from_mapping
    from zacoustic.json5 import read_json5
    from zacoustic_evologics.emulator.fleet import scenario_of

    if arguments.scenario is None:
        return scenario_of(2 if arguments.modems is None else arguments.modems)
    path: str = arguments.scenario
    scenario = scenario_from_mapping(read_json5(path), source=path, folder=Path(path).parent)
    count = len(scenario.nodes) if arguments.modems is None else arguments.modems
    if not 1 <= count <= len(scenario.nodes):
        raise ConfigError(f"--modems {count}; the scenario has {len(scenario.nodes)} nodes")
    nodes = scenario.nodes[:count]
    there = {node.address for node in nodes}
    links = tuple(link for link in scenario.links if {link.source, link.target} <= there)
    return msgspec.structs.replace(scenario, nodes=nodes, links=links, traffic=())


def _parse_settings(texts: Sequence[str]) -> Mapping[str, int]:
    settings = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (equals and value.isascii() and value.isdigit()):
            raise ConfigError(f"--set {text!r}; allowed: NAME=VALUE with a whole number")
        settings[name] = int(value)
    return settings


def _listens(arguments: argparse.Namespace, addresses: Sequence[int]) -> list[tuple[str, int]]:
    """Return host and port of each modem."""
    texts = arguments.listen or [f"127.0.0.1:{FIRST_PORT}"]
    given = [parse_place(text) for text in texts[: len(addresses)]]
    host, port = given[-1]
    for further in range(1, 1 + len(addresses) - len(given)):
        if port + further > 65_535:
            raise ConfigError(f"--listen {texts[-1]!r}; there is no port for every modem behind it")
        given.append((host, port + further if port else 0))
    return given
