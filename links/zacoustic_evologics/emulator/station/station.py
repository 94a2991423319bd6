"""One modem with its ports, and the faults between them and their hosts."""

import re
from collections import deque
from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic.channel.agenda import Agenda
from zacoustic.channel.faults.faults import corrupt
from zacoustic.link.emulation import ModemDown, ModemOutput, ModemUp, PortBytes, PortClosed
from zacoustic_evologics.at import refusals
from zacoustic_evologics.at.command_decoder import CommandMessage
from zacoustic_evologics.at.commands import PayloadCommand
from zacoustic_evologics.at.fields import CLOCK_SPAN_US
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.at.messages import RawData
from zacoustic_evologics.at.notifications import (
    AsyncError,
    ExternalClock,
    ReceivedMessage,
    RecvIm,
)
from zacoustic_evologics.at.notifications import FaultKind as ModemFault
from zacoustic_evologics.at.replies import Accepted, CommandReply
from zacoustic_evologics.emulator.hardware.chassis import CameUp, Said, Spoken, WentDown
from zacoustic_evologics.emulator.hardware.signals import Hearing, SignalKind
from zacoustic_evologics.emulator.modem.modem import EmulatedModem
from zacoustic_evologics.emulator.station.faults import FaultKind, FaultPlan, Misfortune
from zacoustic_evologics.emulator.station.port import Port

_STALE: Final = b",-44,118,0.0000,ld bytes\r\n"
_LENGTH: Final = re.compile(rb"(RECV(?:IM|IMS|PBM)?,(?:p[0-9],)?)([0-9]+)")


class Station:
    """One modem and its ports.

    Args:
        node: Address in the scenario.
        modem: The modem.
        plan: The faults.
        options: Options of new ports that differ from the usual ones.
    """

    def __init__(
        self, node: int, modem: EmulatedModem, plan: FaultPlan, options: Mapping[str, int]
    ) -> None:
        self.node = node
        self.modem = modem
        self.ports: dict[int, Port] = {}
        self.outputs: deque[ModemOutput] = deque()
        self._misfortune = Misfortune(plan, node)
        self._options = options
        self._late = Agenda()
        for at in self._misfortune.timed_at():
            self._late.push(at, self._happen, at)

    def open_port(
        self, port_id: int, interpreter: Interpreter, *, is_serial: bool, now: int
    ) -> None:
        """Open a port."""
        self.ports[port_id] = Port(
            port_id,
            interpreter,
            is_serial=is_serial,
            firmware=self.modem.firmware,
            options=self._options,
            now=now,
        )
        if self._misfortune.strikes(FaultKind.STALE, now):
            self.outputs.append(PortBytes(port_id, _STALE))

    def close_port(self, port_id: int) -> None:
        """Close a port."""
        if self.ports.pop(port_id, None) is not None:
            self.modem.close_port(port_id)

    def handle_bytes(self, port_id: int, content: bytes, now: int) -> None:
        """Take bytes of a host; they are lost while the modem restarts."""
        if not self.modem.is_up:
            return
        self._handle_messages(port_id, self.ports[port_id].feed(content, now), now)
        if self._misfortune.strikes(FaultKind.DROP_CONNECTION, now):
            self._drop_connection(port_id)
        if self._misfortune.strikes(FaultKind.RESET, now):
            self.modem.restart(now)
        self._collect(now)

    def handle_sound(self, sound: int, now: int) -> None:
        """Note the beginning of a signal."""
        self.modem.handle_sound(sound, now)
        self._collect(now)

    def handle_hearing(self, hearing: Hearing, now: int) -> None:
        """Take a signal that has ended."""
        is_ack = hearing.signal.kind is SignalKind.ACK and hearing.is_received
        is_ours = hearing.signal.destination == self.modem.address
        if is_ack and is_ours and self._misfortune.strikes(FaultKind.LOST_ACK, now):
            hearing = msgspec.structs.replace(hearing, is_unheard=True)
        self.modem.handle_hearing(hearing, now)
        self._collect(now)

    def poll_timeout(self) -> int | None:
        """Return the next due instant, ns; None: none."""
        instants = [self.modem.poll_timeout(), self._late.next_at()]
        if self.modem.is_up:
            instants += [port.poll_timeout() for port in self.ports.values()]
        return min((at for at in instants if at is not None), default=None)

    def handle_timeout(self, now: int) -> None:
        """Run the due actions."""
        self._late.run(now)
        self.modem.handle_timeout(now)
        for port_id, port in tuple(self.ports.items()):
            if self.modem.is_up:
                self._handle_messages(port_id, port.handle_timeout(now), now)
                if port.take_eclk(now):
                    self._tell(port, self._clock_record(now), now)
        self._collect(now)

    def _handle_messages(self, port_id: int, messages: list[CommandMessage], now: int) -> None:
        for message in messages:
            port = self.ports.get(port_id)
            if port is None or not self.modem.is_up:
                return
            taken = port.take(message)
            if isinstance(taken, PayloadCommand) and self._misfortune.strikes(FaultKind.BUSY, now):
                taken = refusals.DELIVERING
            if taken is None:
                continue
            if isinstance(taken, CommandReply):
                self._reply(port, taken, now)
            elif isinstance(taken, RawData):
                self.modem.handle_raw(port.origin, taken.content, now)
            else:
                self.modem.handle_command(port.origin, taken, now)
            self._collect(now)

    def _collect(self, now: int) -> None:
        """Pass the modem's messages to its ports."""
        while (output := self.modem.poll_output()) is not None:
            match output:
                case Said(message, None):
                    for port in tuple(self.ports.values()):
                        if port.wants(message):
                            self._tell(port, message, now)
                case Said(message, int(port_id)):
                    addressed = self.ports.get(port_id)
                    if addressed is not None and isinstance(message, CommandReply):
                        self._reply(addressed, message, now)
                    elif addressed is not None:
                        self._tell(addressed, message, now)
                case WentDown():
                    self._go_down(now)
                case CameUp():
                    self.outputs.append(ModemUp(self.node))
                    for port in self.ports.values():
                        port.restart(now)

    def _go_down(self, now: int) -> None:
        self._late = Agenda()
        for at in self._misfortune.timed_at():
            self._late.push(max(at, now), self._happen, max(at, now))
        for port_id in tuple(self.ports):
            self._drop_connection(port_id)
        self.outputs.append(ModemDown(self.node))

    def _drop_connection(self, port_id: int) -> None:
        port = self.ports.get(port_id)
        if port is not None and not port.is_serial:
            self.close_port(port_id)
            self.outputs.append(PortClosed(port_id))

    def _happen(self, now: int) -> None:
        """Run the faults that are due now without an opportunity."""
        for kind in self._misfortune.take_timed(now):
            if kind is FaultKind.RESET and self.modem.is_up:
                self.modem.restart(now)
            elif kind is FaultKind.DROP_CONNECTION:
                for port_id in tuple(self.ports):
                    self._drop_connection(port_id)
        self._collect(now)

    def _reply(self, port: Port, reply: CommandReply, now: int) -> None:
        misfortune = self._misfortune
        if misfortune.strikes(FaultKind.EFAULT, now):
            self._put(port, AsyncError(ModemFault.EFAULT), now)
        if misfortune.strikes(FaultKind.LOST_REPLY, now):
            return
        if isinstance(reply, Accepted) and misfortune.strikes(FaultKind.STARRED, now):
            reply = Accepted(starred=True)
        self._put(port, reply, now)

    def _tell(self, port: Port, message: Spoken, now: int) -> None:
        if self._misfortune.strikes(FaultKind.LATE, now):
            later = now + self._misfortune.late_ns()
            self._late.push(later, self._put, port, message, later)
        else:
            self._put(port, message, now)
        if isinstance(message, RecvIm) and self._misfortune.strikes(FaultKind.DUPLICATE, now):
            self._put(port, message, now)

    def _put(self, port: Port, message: Spoken, now: int) -> None:
        """Write a message to a port, with the faults of the line."""
        if port.port_id not in self.ports or not self.modem.is_up:
            return
        content = port.encode(message)
        misfortune = self._misfortune
        has_payload = isinstance(message, ReceivedMessage)
        if misfortune.strikes(FaultKind.GARBAGE, now):
            self.outputs.append(PortBytes(port.port_id, misfortune.garbage()))
        if misfortune.damages(FaultKind.WRONG_LENGTH, now, has_payload=has_payload):
            content = _LENGTH.sub(
                lambda match: match[1] + b"%d" % misfortune.other_length(int(match[2])), content, 1
            )
        if misfortune.damages(FaultKind.CORRUPT, now, has_payload=has_payload):
            content = corrupt(content, misfortune.rng)
        if misfortune.damages(FaultKind.HALF_LINE, now, has_payload=has_payload):
            content = misfortune.cut(content)
        pieces = [content]
        if misfortune.strikes(FaultKind.PIECES, now):
            pieces = [content[place : place + 1] for place in range(len(content))]
        self.outputs.extend(PortBytes(port.port_id, piece) for piece in pieces if piece)

    def _clock_record(self, now: int) -> ExternalClock:
        return ExternalClock(
            monotonic_us=now // 1000,
            clock_us=self.modem.clock_us(now) % CLOCK_SPAN_US,
            steering_ns_s=0,
            flags=0,
            gps_us=self.modem.system_us(now),
        )
