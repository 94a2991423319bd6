"""An emulation on the running loop, at any time scale: one timer, and a callback for each port.

The loop may be late: due actions then happen at their own instants, one after the other. All calls
and callbacks are on the loop.
"""

import time
from collections.abc import Callable
from typing import Protocol

from zacoustic.core.base.clock import Clock
from zacoustic.link.alarm import Alarm
from zacoustic.link.emulation.modems import Emulation, ModemDown, ModemUp, PortBytes, PortClosed
from zacoustic.link.serving import ScaledClock


class PortHost(Protocol):
    """The other end of a port."""

    def bytes_said(self, content: bytes) -> None:
        """Take a message of the modem."""
        ...

    def port_closed(self) -> None:
        """Note that the modem has closed the port; nothing follows."""
        ...


class RunningEmulation:
    """Drives an emulation by a clock.

    Args:
        modems: The emulation; only this class may step it from now on.
        time_scale: How many times faster than real time, > 0. Guard times and restarts scale, too.
        clock: Source of instants.
        changed: Called when a modem goes down (False) or comes up (True).

    Raises:
        ConfigError: The time scale is not above 0.
    """

    def __init__(
        self,
        modems: Emulation,
        *,
        time_scale: float = 1.0,
        clock: Clock = time.monotonic_ns,
        changed: Callable[[int, bool], None] | None = None,
    ) -> None:
        self._modems = modems
        self.changed = changed
        self._clock = ScaledClock(time_scale, clock)
        self._hosts: dict[int, PortHost] = {}
        self._alarm = Alarm(self._clock.now, self._expire, time_scale=time_scale)
        self._is_closed = False

    def start(self) -> None:
        """Begin to follow the clock, so that scripted faults happen even without a port."""
        self.changed_outside()

    def now(self) -> int:
        """Return the instant of the emulation, ns; never decreases."""
        return max(self._modems.now, self._clock.now())

    def changed_outside(self) -> None:
        """Deliver what the modems say after something else than a port or the clock moved them."""
        self._service()

    def open_port(self, address: int, host: PortHost, *, is_serial: bool = False) -> int:
        """Open a port of a modem.

        Raises:
            ConnectionRefusedError: The modem accepts no connection.
        """
        port_id = self._modems.open_port(address, now=self.now(), is_serial=is_serial)
        self._hosts[port_id] = host
        self._service()
        return port_id

    def close_port(self, port_id: int) -> None:
        """Close a port from the host's side; may be repeated."""
        self._hosts.pop(port_id, None)
        self._modems.close_port(port_id, now=self.now())
        self._service()

    def handle_bytes(self, port_id: int, content: bytes) -> None:
        """Take bytes of a host."""
        self._modems.handle_bytes(port_id, content, self.now())
        self._service()

    def close(self) -> None:
        """Stop; nothing is called afterwards. May be repeated."""
        self._is_closed = True
        self._hosts.clear()
        self._alarm.stop()

    def _service(self) -> None:
        """Deliver the modems' messages, then set the one timer."""
        while not self._is_closed and (output := self._modems.poll_output()) is not None:
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
            self._alarm.set(self._modems.poll_timeout())

    def _expire(self, due_at: int) -> None:
        # The loop may be early by its resolution; the due instant counts.
        self._modems.handle_timeout(max(self.now(), due_at))
        self._service()
