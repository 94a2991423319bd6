"""A host's side of an SBD modem and the emulated modem, in virtual time."""

import random
from typing import Any, Final

from zacoustic.channel.agenda import Agenda
from zacoustic.core.clock import NS_PER_S
from zacoustic_iridium.budget import Budget
from zacoustic_iridium.emulator.gateway import EmulatedGateway
from zacoustic_iridium.emulator.isu import EmulatedIsu, IsuFaults
from zacoustic_iridium.modem import Arrived, Ended, Ready, SbdModem, Silent

IMEI: Final = "300234010000001"
PLENTY: Final = 10**9


class Host:
    """A modem and its host, joined by a wire without delay.

    Args:
        agenda: Virtual time.
        gateway: Behind the modem.
        imei: Number of the modem.
        faults: What goes wrong.
        seed: Of the modem.
        most_bytes: The budget.
        more: Arguments of `SbdModem`.
    """

    def __init__(
        self,
        agenda: Agenda,
        gateway: EmulatedGateway,
        imei: str = IMEI,
        *,
        faults: IsuFaults | None = None,
        seed: int = 1,
        most_bytes: int = PLENTY,
        **more: Any,
    ) -> None:
        self.agenda = agenda
        self.budget = Budget(most_bytes, 50)
        self.modem = SbdModem(self.budget, **more)
        self.isu = EmulatedIsu(imei, gateway, random.Random(seed), faults=faults or IsuFaults())
        self.isu.rang = self._rang
        self.ended: list[Ended] = []
        self.arrived: list[bytes] = []
        self.readies = 0
        self.silences: list[str] = []
        self._armed = 0
        self.modem.connected(agenda.now)
        self.serve()

    def send(self, frame: bytes) -> None:
        """Send a frame."""
        self.modem.send(frame, self.agenda.now)
        self.serve()

    def cut_power(self) -> None:
        """Cut the power of the modem; its port stays open."""
        self.isu.restart()
        self.serve()

    def _rang(self) -> None:
        self.agenda.push(self.agenda.now, self.serve)

    def serve(self) -> None:
        """Move bytes until nothing moves, and set the timers."""
        now = self.agenda.now
        moved = True
        while moved:
            moved = False
            while (data := self.modem.poll_write()) is not None:
                self.isu.receive(data, now)
                moved = True
            while (said := self.isu.poll_write()) is not None:
                self.modem.received(said, now)
                moved = True
        while (event := self.modem.poll_event()) is not None:
            match event:
                case Ended():
                    self.ended.append(event)
                case Arrived(data, _):
                    self.arrived.append(data)
                case Ready():
                    self.readies += 1
                case Silent(reason):
                    self.silences.append(reason)
        self._armed += 1
        for due_at in (self.modem.poll_timeout(), self.isu.poll_timeout()):
            if due_at is not None:
                self.agenda.push(max(due_at, now), self._expire, self._armed)

    def _expire(self, armed: int) -> None:
        if armed == self._armed:
            now = self.agenda.now
            self.isu.timeout(now)
            due_at = self.modem.poll_timeout()
            if due_at is not None and due_at <= now:
                self.modem.timeout(now)
            self.serve()


def run(agenda: Agenda, seconds: float) -> None:
    """Let time pass."""
    agenda.run(agenda.now + round(seconds * NS_PER_S))
