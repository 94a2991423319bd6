"""One port of an emulated modem: a TCP connection or a serial line.

A port, not the modem, has an interpreter and its mode, a protocol id, the wanted notifications, and
the second of silence that guards `+++`. This module answers commands about these; the others are
for the modem.
"""

from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic_evologics.at import commands as asked
from zacoustic_evologics.at import refusals
from zacoustic_evologics.at.answers import reply_text
from zacoustic_evologics.at.command_decoder import CommandDecoder, CommandMessage
from zacoustic_evologics.at.encoder import command_name, encode_message
from zacoustic_evologics.at.firmware import Firmware, knows_external_clock
from zacoustic_evologics.at.framing import Framing, Interpreter
from zacoustic_evologics.at.messages import RawData, Reply
from zacoustic_evologics.at.notifications import ReceivedMessage
from zacoustic_evologics.at.replies import (
    Accepted,
    CommandReply,
    ModeReply,
    Number,
    TextReply,
)
from zacoustic_evologics.at.settings import SETTINGS
from zacoustic_evologics.at.table import COMMANDS, NOTIFICATIONS
from zacoustic_evologics.emulator.hardware.chassis import Origin, Spoken
from zacoustic_evologics.emulator.hardware.store import PORT_OPTIONS

GUARD_NS: Final = 1_000_000_000
"""Silence before and after `+++`, ns."""
ECLK_PERIOD_NS: Final = 1_000_000_000
"""Period of notifications of the external clock, ns, for a port that has asked for them."""


class Port:
    """One port.

    Args:
        port_id: Number in the fleet.
        interpreter: Interpreter of the port.
        is_serial: A serial line, which stays when the modem restarts.
        firmware: Firmware of the modem.
        options: Differences from the options of a new port, by name (`ZF`).
        now: Instant of its opening, ns.
    """

    def __init__(
        self,
        port_id: int,
        interpreter: Interpreter,
        *,
        is_serial: bool,
        firmware: Firmware = "1.9",
        options: Mapping[str, int],
        now: int,
    ) -> None:
        self.port_id = port_id
        self.interpreter = interpreter
        self.is_serial = is_serial
        self._unknown = () if knows_external_clock(firmware) else ("ZA", "ECLK")
        self._presets = {name: options.get(name, SETTINGS[name].default) for name in PORT_OPTIONS}
        self.restart(now)

    def restart(self, now: int) -> None:
        """Become a new port, in data mode if there is one."""
        is_net = self.interpreter is Interpreter.NET
        self._framing = Framing.LINES if is_net else Framing.PACKETS
        self._decoder = CommandDecoder(self.interpreter, self._framing)
        self._options = dict(self._presets)
        self._read_at = now
        self._bytes_since_silence = 0
        self._is_silent = False
        self._eclk_at = now
        # Name of the command whose answer is due, for the packet of the answer.
        self._asked = ""

    @property
    def origin(self) -> Origin:
        """The modem's view of this port."""
        return Origin(self.port_id, self._options["ZS"], self.interpreter)

    @property
    def held_bytes(self) -> int:
        """Number of bytes waiting for more."""
        return self._decoder.held_bytes

    def feed(self, content: bytes, now: int) -> list[CommandMessage]:
        """Take bytes of the host; pass each message of the result to `take`, in order."""
        if now - self._read_at >= GUARD_NS:
            self._bytes_since_silence = 0
        self._bytes_since_silence += len(content)
        self._read_at = now
        self._is_silent = False
        return self._decoder.feed(content)

    def poll_timeout(self) -> int | None:
        """Return the next due instant, ns; None: none."""
        waits = self._framing is Framing.PACKETS and self.held_bytes > 0 and not self._is_silent
        due_at = [self._read_at + GUARD_NS] if waits else []
        if self._options["ZA"]:
            due_at.append(self._eclk_at + ECLK_PERIOD_NS)
        return min(due_at, default=None)

    def handle_timeout(self, now: int) -> list[CommandMessage]:
        """Run the due actions; the result is as that of `feed`."""
        if self._is_silent or not self.held_bytes or now < self._read_at + GUARD_NS:
            return []
        self._is_silent = True
        is_guarded = self._bytes_since_silence == self.held_bytes
        self._bytes_since_silence = 0
        return self._decoder.silence(guarded=is_guarded)

    def take_eclk(self, now: int) -> bool:
        """Tell whether a notification of the external clock is due."""
        is_due = self._options["ZA"] == 1 and now >= self._eclk_at + ECLK_PERIOD_NS
        if is_due:
            self._eclk_at = now
        return is_due

    def take(self, message: CommandMessage) -> asked.Command | RawData | CommandReply | None:
        """Take a message of the host.

        Returns:
            A command or raw data for the modem; or the reply, which `encode` writes; or None.
        """
        match message:
            case RawData():
                return message
            case asked.InvalidCommand():
                self._asked = message.name
                return message.mistake.value
            case asked.Escape():
                self._framing = Framing.LINES
                return Accepted()
        self._asked = command_name(message)
        match message:
            case asked.Query(name) | asked.Set(name) | asked.SetOption(name) if (
                name in self._unknown
            ):
                return refusals.WRONG_FORMAT
            case asked.Query("MODE"):
                return ModeReply(self.interpreter)
            case asked.Query("PID"):
                return Number(self._options["ZS"])
            case asked.Query("ZSL"):
                return TextReply(f"{self.port_id} {self.interpreter.value} {self._options['ZS']}\n")
            case asked.Query(name) if name in PORT_OPTIONS:
                return Number(self._options[name])
            case asked.Query("ECLK"):
                return Number(self._options["ZA"])
            case asked.Set(name, value) if name in PORT_OPTIONS:
                return self._set(name, value)
            case asked.SetOption(name, value) if name in PORT_OPTIONS and value is not None:
                return self._set(name, value)
            case asked.Act(asked.Action.COMMAND_MODE | asked.Action.DATA_MODE as action):
                return self._switch(action)
        if isinstance(message, asked.PayloadCommand) and message.pid is not None:
            if not COMMANDS[type(message)].allows(message, "pid"):
                return refusals.PROTOCOL_ID
            if not self._options["ZF"]:
                # A host that sends a protocol id would look for one in received messages, in vain.
                return refusals.WRONG_FORMAT
        return message

    def wants(self, message: Spoken) -> bool:
        """Tell whether this port wants a message that is for all ports."""
        row = NOTIFICATIONS.get(type(message))
        if row is not None and row.option:
            return self._options[row.option] == 1
        if isinstance(message, RawData):
            return self._framing is Framing.PACKETS
        if isinstance(message, ReceivedMessage):
            return self._options["ZF"] == 1 or message.pid == self._options["ZS"]
        return True

    def encode(self, message: Spoken) -> bytes:
        """Encode a message for this port."""
        if isinstance(message, ReceivedMessage) and not self._options["ZF"]:
            message = msgspec.structs.replace(message, pid=None)
        if isinstance(message, CommandReply):
            name = self._asked if self._framing is Framing.PACKETS else None
            return encode_message(Reply(reply_text(message), name), self._framing)
        return encode_message(message, self._framing)

    def _set(self, name: str, value: int) -> CommandReply:
        if not SETTINGS[name].allows(value):
            return refusals.OUT_OF_RANGE
        self._options[name] = value
        self._eclk_at = self._read_at
        return Accepted()

    def _switch(self, action: asked.Action) -> CommandReply | None:
        if self.interpreter is Interpreter.NET:
            return refusals.UNKNOWN_COMMAND
        if action is asked.Action.COMMAND_MODE:
            self._framing = Framing.LINES
            return Accepted()
        self._framing = Framing.PACKETS
        return None
