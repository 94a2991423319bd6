"""The verbs `zacoustic mavlink`: join an autopilot and a ground station through the gateways."""

import secrets
import time
from typing import TYPE_CHECKING, Any, Final

from zacoustic.app.cli.support.rows import (
    OBJECT_PER_LINE,
    endpoint,
    flag,
    option,
    seconds,
    whole,
    word,
)
from zacoustic.app.cli.support.verb import Verb
from zacoustic.errors import ConfigError
from zacoustic.text.safetext import one_line

if TYPE_CHECKING:
    from zacoustic.config import Config
    from zacoustic.mavlink.bridge import Settings
    from zacoustic.mavlink.entries import Names
    from zacoustic.mavlink.outputs import Notice

INTERVAL_S: Final = 10.0
"""Time between two HIGH_LATENCY2: a frame of 15 bytes and its share of others', s."""
GROUND_EVERY_S: Final = 20.0
"""Time between two signs of life of a ground station, s: three are lost before it is."""
LOST_AFTER_S: Final = 90.0
"""Silence after which the other side is lost, s: four signs of life of either side."""

_SPAN_S: Final = {"least": 0.1, "most": 86_400.0}
_SYSTEM: Final = {"least": 1, "most": 255}
_FASTEST_BAUD: Final = 10_000_000


def _place_of(what: str) -> Any:  # noqa: ANN401 (a row)
    places = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:PORT"
    return option("PLACE", f"{what}: {places}", required=True)


class Bridge(Verb):
    """One of the two bridges to MAVLink."""

    prints_late = False
    runs_on = True

    file: str = word("FILE", "Zenoh config with plugins.acoustic")
    mavlink: str
    baudrate: int | None = whole(
        "N", "of a serial port (default: 57600)", least=1, most=_FASTEST_BAUD
    )
    connect: list[str] | None = endpoint()
    prefix: str | None = option("KEY", "first part of the streams' names, if there are more")
    json: bool = flag(OBJECT_PER_LINE)

    def read(self) -> "tuple[Config, Names]":
        """Read the file, and find the streams of the bridge.

        Raises:
            ConfigError: The file is wrong, or lacks them.
        """
        from zacoustic.mavlink.bridge import read_fleet
        from zacoustic.mavlink.entries import find_names

        config = read_fleet(self.file)
        return config, find_names(config, self.prefix, source=self.file)

    def settings(self, config: "Config", address: int) -> "Settings":
        """Return the settings of both bridges."""
        from zacoustic.mavlink.bridge import Settings
        from zacoustic.mavlink.port import BAUDRATE

        return Settings(
            config=config,
            connect=self.connect,
            place=self.mavlink,
            baudrate=self.baudrate or BAUDRATE,
            address=address,
        )

    def tell_notice(self, notice: "Notice") -> None:
        """Print a notice."""
        sign = "!" if notice.is_trouble else " "
        text = f"{time.strftime('%H:%M:%S')} {sign} {notice.event}: {notice.text}"
        self.tell(notice, one_line(text))


class Vehicle(Bridge):
    """Beside the autopilot: serve its commands, publish HIGH_LATENCY2.

    Example:
      zacoustic mavlink vehicle fleet.json5 --mavlink udpin:127.0.0.1:14551
      zacoustic mavlink vehicle fleet.json5 --mavlink serial:/dev/ttyACM0 --baudrate 115200
    """

    mavlink: str = _place_of("the autopilot, or a router of its packets")
    interval: float = seconds("time between two HIGH_LATENCY2, s", INTERVAL_S, **_SPAN_S)
    lost_after: float = seconds(
        "end the heartbeats to the autopilot when nothing of shore is heard for this long, s",
        LOST_AFTER_S,
        **_SPAN_S,
    )
    system: int | None = whole("N", "system id of the autopilot, if there are more", **_SYSTEM)
    ground_system: int = whole(
        "N", "system id of the ground station whose loss the autopilot watches", 255, **_SYSTEM
    )

    async def work(self) -> None:
        """Run until SIGINT or SIGTERM.

        Raises:
            ConfigError: The file or an argument is wrong.
            SessionError, LinkOpenError: No Zenoh router; the port is in use.
        """
        from zacoustic.mavlink.autopilot import AutopilotSide
        from zacoustic.mavlink.vehicle import VehicleBridge, vehicle_address
        from zacoustic.mavlink.vehicletime import PERIOD_MS

        config, names = self.read()
        engine = AutopilotSide(
            interval_s=self.interval,
            lost_after_s=self.lost_after,
            system=self.system,
            ground_system=self.ground_system,
            clock_ms=secrets.randbelow(PERIOD_MS),
            now=time.monotonic_ns(),
        )
        settings = self.settings(config, vehicle_address(names))
        await VehicleBridge(engine, settings, names, self.tell_notice).run()


class Shore(Bridge):
    """Beside the ground station: show the vehicle, pass commands on.

    Example:
      zacoustic mavlink shore fleet.json5 --mavlink udpout:127.0.0.1:14550
    """

    mavlink: str = _place_of("the ground station")
    every: float = seconds(
        "tell the vehicle this often that a ground station is there, s", GROUND_EVERY_S, **_SPAN_S
    )
    lost_after: float = seconds(
        "show nothing when no report has come for this long, s", LOST_AFTER_S, **_SPAN_S
    )
    present: bool = flag("count the ground station as there without its heartbeats")
    instruments: bool = flag(
        "show each report as GLOBAL_POSITION_INT, SYS_STATUS and VFR_HUD as well, which MAVSDK and "
        "MAVProxy read"
    )

    async def work(self) -> None:
        """Run until SIGINT or SIGTERM.

        Raises:
            ConfigError: The file or an argument is wrong.
            SessionError, LinkOpenError: No Zenoh router; the port is in use.
        """
        from zacoustic.mavlink.shore import ShoreBridge, shore_address
        from zacoustic.mavlink.station import StationSide

        config, names = self.read()
        engine = StationSide(
            names.prefix.partition("/")[0],
            ground_every_s=self.every,
            lost_after_s=self.lost_after,
            is_present=self.present,
            has_instruments=self.instruments,
            now=time.monotonic_ns(),
        )
        settings = self.settings(config, shore_address(names))
        await ShoreBridge(engine, settings, names, self.tell_notice).run()


class Streams(Verb):
    """Print the types and streams to add to the fleet's file.

    a second vehicle needs only the lines of `streams`: the types are the same

    Example:
      zacoustic mavlink streams --prefix auv1/mavlink --vehicle 2
    """

    prints_late = False

    prefix: str = option("KEY", "first part of the names", "auv1/mavlink")
    vehicle: int = whole("N", "acoustic address of the vehicle", 2)
    shore: int = whole("N", "acoustic address of the shore", 1)
    first_id: int = whole("N", "first of six stream ids", 60)

    def work(self) -> None:
        """Print them.

        Raises:
            ConfigError: They are no valid entries.
        """
        from zacoustic.config import config_from_mapping
        from zacoustic.mavlink.entries import entries, entries_text

        if self.vehicle == self.shore:
            raise ConfigError(f"--vehicle {self.vehicle}; allowed: another one than --shore")
        made = entries(self.prefix, vehicle=self.vehicle, shore=self.shore, first_id=self.first_id)
        config_from_mapping({"address": self.shore, **made}, source=self.program)
        self.show(made, entries_text)
