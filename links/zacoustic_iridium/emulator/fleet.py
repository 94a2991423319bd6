"""Emulated SBD modems behind one gateway, in virtual time: no clock, no socket.

A modem has one serial line: the host that has connected last is served, any other one is closed.
"""

import random
from collections import deque
from typing import Final

from zacoustic.link.emulation import ModemOutput, PortBytes, PortClosed
from zacoustic_iridium.emulator.gateway import EmulatedGateway
from zacoustic_iridium.emulator.isu import EmulatedIsu, IsuFaults

FIRST_IMEI: Final = 300234010000001


class EmulatedSbdFleet:
    """Modems whose addresses are 1, 2 and so on.

    Args:
        gateway: Behind the satellites.
        modems: How many.
        session_s: Shortest and longest session, s.
        faults: What goes wrong.
        seed: Of all draws.
    """

    def __init__(
        self,
        gateway: EmulatedGateway,
        modems: int,
        *,
        session_s: tuple[float, float],
        faults: IsuFaults,
        seed: int,
    ) -> None:
        self.isus = {
            1 + index: EmulatedIsu(
                str(FIRST_IMEI + index),
                gateway,
                random.Random(f"{seed}/{index}"),
                session_s=session_s,
                faults=faults,
            )
            for index in range(modems)
        }
        self._now = 0
        self._next_port_id = 1
        self._port_of: dict[int, int] = {}
        """Port of each modem, by its address."""
        self._outputs: deque[ModemOutput] = deque()

    @property
    def now(self) -> int:
        """Instant of the last call, ns."""
        return self._now

    def open_port(self, address: int, *, now: int, is_serial: bool = False) -> int:
        """Open the port of a modem, in place of an earlier one."""
        self.handle_timeout(now)
        if address not in self.isus:
            raise ValueError(f"modem {address}; there are {list(self.isus)}")
        if address in self._port_of:
            self._outputs.append(PortClosed(self._port_of[address]))
        self._port_of[address] = self._next_port_id
        self._next_port_id += 1
        return self._port_of[address]

    def close_port(self, port_id: int, *, now: int) -> None:
        """Close a port from the host's side; may be repeated."""
        self.handle_timeout(now)
        self._port_of = {at: port for at, port in self._port_of.items() if port != port_id}

    def handle_bytes(self, port_id: int, content: bytes, now: int) -> None:
        """Take bytes of a host; those for a closed port are lost."""
        self.handle_timeout(now)
        for address, port in self._port_of.items():
            if port == port_id:
                self.isus[address].receive(content, now)

    def handle_timeout(self, now: int) -> None:
        """Run the due actions."""
        self._now = now
        for isu in self.isus.values():
            isu.timeout(now)

    def poll_timeout(self) -> int | None:
        """Return the next due instant, ns; None: none."""
        instants = (isu.poll_timeout() for isu in self.isus.values())
        return min((at for at in instants if at is not None), default=None)

    def poll_output(self) -> ModemOutput | None:
        """Return the next output for a host, or None; nobody hears a modem without a host."""
        if self._outputs:
            return self._outputs.popleft()
        for address, isu in self.isus.items():
            while (content := isu.poll_write()) is not None:
                if address in self._port_of:
                    return PortBytes(self._port_of[address], content)
        return None
