"""The verb `zacoustic mavlink`: joins an autopilot and a ground station through the gateways."""

import argparse
import asyncio
import secrets
import time
from typing import TYPE_CHECKING, Final

from zacoustic.app.cli.support.arguments import (
    OBJECT_PER_LINE,
    add_connect,
    add_json,
)
from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_OK, Command, CommandGroup
from zacoustic.link.serving import run_until_stopped
from zacoustic.text.safetext import one_line

if TYPE_CHECKING:
    from zacoustic.config import Config
    from zacoustic.mavlink.bridge import Settings, Tell
    from zacoustic.mavlink.entries import Names
    from zacoustic.mavlink.outputs import Notice

INTERVAL_S: Final = 10.0
"""Time between two HIGH_LATENCY2: a frame of 15 bytes and its share of others', s."""
GROUND_EVERY_S: Final = 20.0
"""Time between two signs of life of a ground station, s: three are lost before it is."""
LOST_AFTER_S: Final = 90.0
"""Silence after which the other side is lost, s: four signs of life of either side."""

_SHORTEST_S, _LONGEST_S = 0.1, 86_400.0
_FASTEST_BAUD: Final = 10_000_000


class MavlinkCommand(CommandGroup):
    """The bridges to MAVLink."""

    name = "mavlink"

    def __init__(self) -> None:
        members = {member.name: member for member in (OnVehicle(), OnShore(), Streams())}
        super().__init__(self.name, members, tuple(members))
        self.summary = "join an autopilot to a ground station"  # type: ignore[misc]


class OnVehicle(Command):
    """Runs the bridge beside the autopilot."""

    name = "vehicle"
    summary = "beside the autopilot: serve its commands, publish HIGH_LATENCY2"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, port and times."""
        _add_bridge(parser, "the autopilot, or a router of its packets")
        parser.add_argument(
            "--interval", type=float, default=INTERVAL_S, metavar="S",
            help="time between two HIGH_LATENCY2, s (default: %(default)g)",
        )  # fmt: skip
        parser.add_argument(
            "--lost-after", type=float, default=LOST_AFTER_S, metavar="S",
            help="end the heartbeats to the autopilot when nothing of shore is heard for this "
            "long, s (default: %(default)g)",
        )  # fmt: skip
        parser.add_argument(
            "--system", type=int, metavar="N", help="system id of the autopilot, if there are more"
        )
        parser.add_argument(
            "--ground-system", type=int, default=255, metavar="N",
            help="system id of the ground station whose loss the autopilot watches "
            "(default: %(default)d)",
        )  # fmt: skip
        parser.epilog = (
            "example:\n"
            "  zacoustic mavlink vehicle fleet.json5 --mavlink udpin:127.0.0.1:14551\n"
            "  zacoustic mavlink vehicle fleet.json5 --mavlink serial:/dev/ttyACM0 --baudrate "
            "115200"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Run until SIGINT or SIGTERM.

        Raises:
            ConfigError: The file or an argument is wrong.
            SessionError, LinkOpenError: No Zenoh router; the port is in use.
        """
        _check(arguments, "interval", "lost_after")
        _check_system(arguments, "system", "ground_system")
        run_until_stopped(lambda stop: _run_on_vehicle(arguments, stop))
        return EXIT_OK


class OnShore(Command):
    """Runs the bridge beside the ground station."""

    name = "shore"
    summary = "beside the ground station: show the vehicle, pass commands on"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, port and times."""
        _add_bridge(parser, "the ground station")
        parser.add_argument(
            "--every", type=float, default=GROUND_EVERY_S, metavar="S",
            help="tell the vehicle this often that a ground station is there, s "
            "(default: %(default)g)",
        )  # fmt: skip
        parser.add_argument(
            "--lost-after", type=float, default=LOST_AFTER_S, metavar="S",
            help="show nothing when no report has come for this long, s (default: %(default)g)",
        )  # fmt: skip
        parser.add_argument(
            "--present", action="store_true",
            help="count the ground station as there without its heartbeats",
        )  # fmt: skip
        parser.add_argument(
            "--instruments", action="store_true",
            help="show each report as GLOBAL_POSITION_INT, SYS_STATUS and VFR_HUD as well, which "
            "MAVSDK and MAVProxy read",
        )  # fmt: skip
        parser.epilog = (
            "example:\n  zacoustic mavlink shore fleet.json5 --mavlink udpout:127.0.0.1:14550"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Run until SIGINT or SIGTERM.

        Raises:
            ConfigError: The file or an argument is wrong.
            SessionError, LinkOpenError: No Zenoh router; the port is in use.
        """
        _check(arguments, "every", "lost_after")
        run_until_stopped(lambda stop: _run_on_shore(arguments, stop))
        return EXIT_OK


class Streams(Command):
    """Prints the entries of the stream table."""

    name = "streams"
    summary = "print the types and streams to add to the fleet's file"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare names, addresses and ids."""
        parser.add_argument(
            "--prefix", default="auv1/mavlink", metavar="KEY",
            help="first part of the names (default: %(default)s)",
        )  # fmt: skip
        parser.add_argument(
            "--vehicle", type=int, default=2, metavar="N",
            help="acoustic address of the vehicle (default: %(default)d)",
        )  # fmt: skip
        parser.add_argument(
            "--shore", type=int, default=1, metavar="N",
            help="acoustic address of the shore (default: %(default)d)",
        )  # fmt: skip
        parser.add_argument(
            "--first-id", type=int, default=60, metavar="N",
            help="first of six stream ids (default: %(default)d)",
        )  # fmt: skip
        add_json(parser)
        parser.epilog = (
            "a second vehicle needs only the lines of `streams`: the types are the same\n\n"
            "example:\n  zacoustic mavlink streams --prefix auv1/mavlink --vehicle 2"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print them.

        Raises:
            ConfigError: They are no valid entries.
        """
        from zacoustic.config import config_from_mapping
        from zacoustic.mavlink.entries import entries, entries_text

        if arguments.vehicle == arguments.shore:
            raise ConfigError(f"--vehicle {arguments.vehicle}; allowed: another one than --shore")
        made = entries(
            arguments.prefix,
            vehicle=arguments.vehicle,
            shore=arguments.shore,
            first_id=arguments.first_id,
        )
        section = {"address": arguments.shore, **made}
        config_from_mapping(section, source="zacoustic mavlink streams")
        if arguments.json:
            print_json(made)
        else:
            print_text(entries_text(made))
        return EXIT_OK


def _add_bridge(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("file", metavar="FILE", help="Zenoh config with plugins.acoustic")
    parser.add_argument(
        "--mavlink", required=True, metavar="PLACE",
        help=f"{what}: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:PORT",
    )  # fmt: skip
    parser.add_argument(
        "--baudrate", type=int, metavar="N", help="of a serial port (default: 57600)"
    )
    add_connect(parser)
    parser.add_argument(
        "--prefix", metavar="KEY", help="first part of the streams' names, if there are more"
    )
    add_json(parser, OBJECT_PER_LINE)


def _check(arguments: argparse.Namespace, *names: str) -> None:
    for name in names:
        value = getattr(arguments, name)
        if not _SHORTEST_S <= value <= _LONGEST_S:
            limits = f"{_SHORTEST_S:g}..{_LONGEST_S:g}"
            raise ConfigError(f"--{name.replace('_', '-')} {value:g}; allowed: {limits}")
    if arguments.baudrate is not None and not 1 <= arguments.baudrate <= _FASTEST_BAUD:
        raise ConfigError(f"--baudrate {arguments.baudrate}; allowed: 1..{_FASTEST_BAUD}")


def _check_system(arguments: argparse.Namespace, *names: str) -> None:
    for name in names:
        value = getattr(arguments, name)
        if value is not None and not 1 <= value <= 255:
            raise ConfigError(f"--{name.replace('_', '-')} {value}; allowed: 1..255")


async def _run_on_vehicle(arguments: argparse.Namespace, stop: asyncio.Event) -> None:
    from zacoustic.mavlink.autopilot import AutopilotSide
    from zacoustic.mavlink.vehicle import VehicleBridge, vehicle_address
    from zacoustic.mavlink.vehicletime import PERIOD_MS

    config, names = _read(arguments)
    engine = AutopilotSide(
        interval_s=arguments.interval,
        lost_after_s=arguments.lost_after,
        system=arguments.system,
        ground_system=arguments.ground_system,
        clock_ms=secrets.randbelow(PERIOD_MS),
        now=time.monotonic_ns(),
    )
    settings = _settings(arguments, config, vehicle_address(names))
    await VehicleBridge(engine, settings, names, _printer(arguments, stop)).run()


async def _run_on_shore(arguments: argparse.Namespace, stop: asyncio.Event) -> None:
    from zacoustic.mavlink.shore import ShoreBridge, shore_address
    from zacoustic.mavlink.station import StationSide

    config, names = _read(arguments)
    engine = StationSide(
        names.prefix.partition("/")[0],
        ground_every_s=arguments.every,
        lost_after_s=arguments.lost_after,
        is_present=arguments.present,
        has_instruments=arguments.instruments,
        now=time.monotonic_ns(),
    )
    settings = _settings(arguments, config, shore_address(names))
    await ShoreBridge(engine, settings, names, _printer(arguments, stop)).run()


def _read(arguments: argparse.Namespace) -> "tuple[Config, Names]":
    from zacoustic.mavlink.bridge import read_fleet
    from zacoustic.mavlink.entries import find_names

    config = read_fleet(arguments.file)
    return config, find_names(config, arguments.prefix, source=arguments.file)


def _settings(arguments: argparse.Namespace, config: "Config", address: int) -> "Settings":
    from zacoustic.mavlink.bridge import Settings
    from zacoustic.mavlink.port import BAUDRATE

    return Settings(
        config=config,
        connect=arguments.connect,
        place=arguments.mavlink,
        baudrate=arguments.baudrate or BAUDRATE,
        address=address,
    )


def _printer(arguments: argparse.Namespace, stop: asyncio.Event) -> "Tell":
    def tell(notice: "Notice") -> None:
        try:
            if arguments.json:
                print_json(notice, flush=True)
                return
            now = time.strftime("%H:%M:%S")
            sign = "!" if notice.is_trouble else " "
            print_text(one_line(f"{now} {sign} {notice.event}: {notice.text}"), flush=True)
        except BrokenPipeError:
            stop.set()

    return tell
