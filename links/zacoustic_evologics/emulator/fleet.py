r"""N emulated modems on one channel, in virtual time: no clock, no socket, `now` is an argument.

::

    fleet = EmulatedFleet(scenario_of(2, spacing_m=1500.0))
    port = fleet.open_port(1, now=0)
    fleet.handle_bytes(port, b"AT?AL\n", now=0)
    while (output := fleet.poll_output()) is not None: …     PortBytes, PortClosed, …
    fleet.poll_timeout()                                     the next due instant
    fleet.handle_timeout(that)                               then `poll_output` again

`now` is ns since the start of the scenario and never decreases. Each call first runs what was due
before, at its own instant, but its results come afterwards. So a driver of virtual time calls
`handle_timeout` exactly at `poll_timeout`. `zacoustic.link.emulation` runs it on a loop.

Signals and timers are on one agenda; each station is there with its first due instant. An idle
fleet has no timer.
"""

import random
from collections import deque
from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic.channel.agenda import Agenda, Entry
from zacoustic.channel.propagation.position import Position
from zacoustic.channel.scenario import Scenario
from zacoustic.errors import ConfigError
from zacoustic.link.emulation import ModemOutput, PortClosed
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.at.settings import HIGHEST_ADDRESSES, SETTINGS, refuse_value
from zacoustic_evologics.emulator.hardware.chassis import Behaviour
from zacoustic_evologics.emulator.hardware.signals import Hearing
from zacoustic_evologics.emulator.hardware.store import PORT_OPTIONS
from zacoustic_evologics.emulator.medium import EmulatedMedium
from zacoustic_evologics.emulator.modem.modem import EmulatedModem
from zacoustic_evologics.emulator.observation import Observer, ignore
from zacoustic_evologics.emulator.station.faults import NO_FAULTS, FaultPlan
from zacoustic_evologics.emulator.station.station import Station

PORTS_LIMIT: Final = 64
"""Most open ports of one modem."""


class EmulatedFleet:
    """All modems of a scenario.

    Args:
        scenario: The channel and its nodes; their addresses become those of the modems. A profile
            decides levels and errors, not durations: those are the S2C's.
        interpreter: Interpreter of the ports.
        faults: Faults between modems and hosts.
        settings: Settings of all modems, and options of their ports, that differ from the usual
            ones, by name: `{"RI": 0, "ZX": 1}`.
        behaviour: Choices where sources disagree.
        observer: Gets every transmission with its outcome; no modem knows it.

    Raises:
        ConfigError: A setting does not exist, or cannot have that value.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        interpreter: Interpreter = Interpreter.NET,
        faults: FaultPlan = NO_FAULTS,
        settings: Mapping[str, int] | None = None,
        behaviour: Behaviour | None = None,
        observer: Observer = ignore,
    ) -> None:
        self.scenario = scenario
        self.interpreter = interpreter
        self._agenda = Agenda()
        self._driver = EmulatedMedium(
            scenario,
            self._agenda,
            begun=self._handle_sound,
            heard=self._handle_hearing,
            observer=observer,
        )
        self._medium = self._driver.medium
        self._outputs: deque[ModemOutput] = deque()
        self._stations: dict[int, Station] = {}
        self._station_of_port: dict[int, Station] = {}
        self._armed: dict[int, tuple[int, Entry]] = {}
        self._next_port_id = 1
        settings = settings or {}
        _check_settings(settings)
        behaviour = behaviour or Behaviour()
        reach_s = max(behaviour.reach_s, 1.1 * scenario.farthest_s)
        behaviour = msgspec.structs.replace(behaviour, reach_s=reach_s)
        highest = next(each for each in HIGHEST_ADDRESSES if each >= max(self._medium.addresses))
        common = {"AM": max(highest, SETTINGS["AM"].default)} | dict(settings)
        options = {name: value for name, value in settings.items() if name in PORT_OPTIONS}
        for address in self._medium.addresses:
            rng = random.Random(f"zacoustic/evologics/{scenario.seed}/{address}")
            modem = EmulatedModem({"AL": address} | common, behaviour=behaviour, rng=rng)
            self._stations[address] = Station(address, modem, faults, options)
            self._arm(self._stations[address])

    @property
    def now(self) -> int:
        """Instant of the last call or of a later event, ns."""
        return self._agenda.now

    @property
    def addresses(self) -> tuple[int, ...]:
        """Addresses of the scenario."""
        return tuple(self._stations)

    def move(self, address: int, position: Position, now: int) -> None:
        """Set the position of a modem from now on: x east, y north, z down, m.

        Raises:
            ValueError: No such modem, or a coordinate that is not a number or too large.
        """
        self._medium.move(address, position, now)

    def distance_m(self, address: int, other: int) -> float:
        """Return the present distance of two modems, m."""
        return self._medium.path(address, other, self.now).distance_m

    @property
    def remembered(self) -> int:
        """Number of stored past and future items; bounded by what is under way."""
        return self._medium.remembered + len(self._agenda) + len(self._outputs)

    def is_up(self, address: int) -> bool:
        """Whether a modem is running, not restarting."""
        return self._station(address).modem.is_up

    def open_port(
        self,
        address: int,
        *,
        now: int,
        interpreter: Interpreter | None = None,
        is_serial: bool = False,
    ) -> int:
        """Open a port of a modem.

        Args:
            address: Address of the modem in the scenario.
            now: Instant, ns.
            interpreter: Interpreter of the port; None: that of the fleet.
            is_serial: A serial line, which stays during a restart of the modem.

        Returns:
            The number of the port.

        Raises:
            ConnectionRefusedError: The modem restarts, or has `PORTS_LIMIT` ports.
            ValueError: No such modem.
        """
        self._advance(now)
        station = self._station(address)
        if not is_serial and (not station.modem.is_up or len(station.ports) >= PORTS_LIMIT):
            raise ConnectionRefusedError(f"modem {address} takes no connection")
        port_id = self._next_port_id
        self._next_port_id += 1
        self._station_of_port[port_id] = station
        station.open_port(port_id, interpreter or self.interpreter, is_serial=is_serial, now=now)
        self._settle(station)
        return port_id

    def close_port(self, port_id: int, *, now: int) -> None:
        """Close a port from the host's side; may be repeated."""
        self._advance(now)
        station = self._station_of_port.pop(port_id, None)
        if station is not None:
            station.close_port(port_id)

    def handle_bytes(self, port_id: int, content: bytes, now: int) -> None:
        """Take bytes of a host; those for a closed port are lost."""
        self._advance(now)
        station = self._station_of_port.get(port_id)
        if station is not None and port_id in station.ports:
            station.handle_bytes(port_id, content, now)
            self._settle(station)

    def handle_timeout(self, now: int) -> None:
        """Run the due actions."""
        self._advance(now)

    def poll_timeout(self) -> int | None:
        """Return the next due instant, ns; None: none."""
        return self._agenda.next_at()

    def poll_output(self) -> ModemOutput | None:
        """Return the next output for a host, or None."""
        return self._outputs.popleft() if self._outputs else None

    def _station(self, address: int) -> Station:
        try:
            return self._stations[address]
        except KeyError:
            raise ValueError(f"modem {address}; there are {list(self._stations)}") from None

    def _advance(self, now: int) -> None:
        assert now >= self.now, "time runs backwards"
        self._agenda.run(now)

    def _settle(self, station: Station) -> None:
        """Take the output of a station, and transmit its signals."""
        while station.outputs:
            output = station.outputs.popleft()
            if isinstance(output, PortClosed):
                del self._station_of_port[output.port_id]
            self._outputs.append(output)
        while (signal := station.modem.poll_signal()) is not None:
            self._driver.emit(station.node, signal)
        self._arm(station)

    def _handle_sound(self, node: int, sound: int) -> None:
        station = self._stations[node]
        station.handle_sound(sound, self.now)
        self._settle(station)

    def _handle_hearing(self, node: int, hearing: Hearing) -> None:
        station = self._stations[node]
        station.handle_hearing(hearing, self.now)
        self._settle(station)

    def _arm(self, station: Station) -> None:
        """Put a station on the agenda at its next due instant, and at no other."""
        due_at = station.poll_timeout()
        assert due_at is None or due_at >= self.now, "a timer in the past"
        armed_at, entry = self._armed.get(station.node, (None, None))
        if due_at == armed_at:
            return
        if entry is not None:
            del self._armed[station.node]
            self._agenda.cancel(entry)
        if due_at is not None:
            entry = self._agenda.push(due_at, self._expire, station, due_at)
            self._armed[station.node] = due_at, entry

    def _expire(self, station: Station, at: int) -> None:
        del self._armed[station.node]
        station.handle_timeout(at)
        self._settle(station)


def _check_settings(settings: Mapping[str, int]) -> None:
    for name, value in settings.items():
        if name not in SETTINGS:
            raise ConfigError(f"setting {name}; allowed: {', '.join(sorted(SETTINGS))}")
        if refusal := refuse_value(name, value):
            raise ConfigError(refusal)
