"""The contract of an emulation: modems with ports, in virtual time, without input and output.

`now` is ns since the start and never decreases. Each call first runs what was due before, at its
own instant. A driver of virtual time calls `handle_timeout` exactly at `poll_timeout`, and takes
all of `poll_output` after each call.
"""

from typing import Protocol, TypeAlias

import msgspec


class PortBytes(msgspec.Struct, frozen=True):
    """Bytes for the host of a port."""

    port_id: int
    """Port."""
    content: bytes
    """One byte or more."""


class PortClosed(msgspec.Struct, frozen=True):
    """The modem has closed a TCP port, which no longer exists."""

    port_id: int
    """Port."""


class ModemDown(msgspec.Struct, frozen=True):
    """A modem restarts: it accepts no connections, and serial lines are dead."""

    address: int
    """Its address."""


class ModemUp(msgspec.Struct, frozen=True):
    """A modem has restarted."""

    address: int
    """Its address."""


ModemOutput: TypeAlias = PortBytes | PortClosed | ModemDown | ModemUp
"""Outputs of an emulation."""


class Emulation(Protocol):
    """Modems of one make."""

    @property
    def now(self) -> int:
        """Instant of the last call or of a later event, ns."""
        ...

    def open_port(self, address: int, *, now: int, is_serial: bool = False) -> int:
        """Open a port of a modem.

        Args:
            address: Address of the modem.
            now: Instant, ns.
            is_serial: A serial line, which stays during a restart of the modem.

        Returns:
            The number of the port.

        Raises:
            ConnectionRefusedError: The modem accepts no connection.
            ValueError: No such modem.
        """
        ...

    def close_port(self, port_id: int, *, now: int) -> None:
        """Close a port from the host's side; may be repeated."""
        ...

    def handle_bytes(self, port_id: int, content: bytes, now: int) -> None:
        """Take bytes of a host; those for a closed port are lost."""
        ...

    def handle_timeout(self, now: int) -> None:
        """Run the due actions."""
        ...

    def poll_timeout(self) -> int | None:
        """Return the next due instant, ns; None: none."""
        ...

    def poll_output(self) -> ModemOutput | None:
        """Return the next output for a host, or None."""
        ...
