"""A fleet on the running loop, at any time scale: one timer, and a callback for each port.

The loop may be late: due actions then happen at their own instants, one after the other. All calls
and callbacks are on the loop.
"""

import time
from collections.abc import Callable
from typing import Protocol

from zacoustic.channel.propagation.position import Position
from zacoustic.core.clock import Clock
from zacoustic.link.alarm import Alarm
from zacoustic.link.serving import ScaledClock
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.emulator.fleet import EmulatedFleet
from zacoustic_evologics.emulator.station.station import ModemDown, ModemUp, PortBytes, PortClosed


class PortHost(Protocol):
    """The other end of a port."""

    def bytes_said(self, content: bytes) -> None:
        """Take a message of the modem."""
        ...

    def port_closed(self) -> None:
        """Note that the modem has closed the port; nothing follows."""
        ...


class RunningFleet:
    """Drives a fleet by a clock.

    Args:
        fleet: The fleet; only this class may step it from now on.
        time_scale: How many times faster than real time, > 0. Guard times and restarts scale, too.
        clock: Source of instants.
        changed: Called when a modem goes down (False) or comes up (True).

    Raises:
        ConfigError: The time scale is not above 0.
    """

    def __init__(
        self,
        fleet: EmulatedFleet,
        *,
        time_scale: float = 1.0,
        clock: Clock = time.monotonic_ns,
        changed: Callable[[int, bool], None] | None = None,
    ) -> None:
        self.fleet = fleet
        self.changed = changed
        self._clock = ScaledClock(time_scale, clock)
        self._hosts: dict[int, PortHost] = {}
        self._alarm = Alarm(self._clock.now, self._expire, time_scale=time_scale)
        self._is_closed = False

    def start(self) -> None:
        """Begin to follow the clock, so that scripted faults happen even without a port."""
        self._service()

    def open_port(
        self,
        address: int,
        host: PortHost,
        *,
        interpreter: Interpreter | None = None,
        is_serial: bool = False,
    ) -> int:
        """Open a port of a modem.

        Raises:
            ConnectionRefusedError: The modem accepts no connection.
        """
        now = self._now()
        port_id = self.fleet.open_port(
            address, now=now, interpreter=interpreter, is_serial=is_serial
        )
        self._hosts[port_id] = host
        self._service()
        return port_id

    def move(self, address: int, position: Position) -> None:
        """Set the position of a modem from now on; raises as `EmulatedFleet.move`."""
        self.fleet.move(address, position, self._now())

    def close_port(self, port_id: int) -> None:
        """Close a port from the host's side; may be repeated."""
        self._hosts.pop(port_id, None)
        self.fleet.close_port(port_id, now=self._now())
        self._service()

    def handle_bytes(self, port_id: int, content: bytes) -> None:
        """Take bytes of a host."""
        self.fleet.handle_bytes(port_id, content, self._now())
        self._service()

    def close(self) -> None:
        """Stop; nothing is called afterwards. May be repeated."""
        self._is_closed = True
        self._hosts.clear()
        self._alarm.stop()

    def _now(self) -> int:
        """Return the instant of the fleet; never decreases."""
        return max(self.fleet.now, self._clock.now())

    def _service(self) -> None:
        """Deliver the fleet's messages, then set the one timer."""
        while not self._is_closed and (output := self.fleet.poll_output()) is not None:
            match output:
                case PortBytes(port_id, content):
                    if port_id in self._hosts:
                        self._hosts[port_id].bytes_said(content)
                case PortClosed(port_id):
                    host = self._hosts.pop(port_id, None)
                    if host is not None:
                        host.port_closed()
                case ModemDown(address) | ModemUp(address):
                    if self.changed is not None:
                        self.changed(address, isinstance(output, ModemUp))
        if not self._is_closed:
            self._alarm.set(self.fleet.poll_timeout())

    def _expire(self, due_at: int) -> None:
        # The loop may be early by its resolution; the due instant counts.
        self.fleet.handle_timeout(max(self._now(), due_at))
        self._service()
