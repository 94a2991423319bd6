"""From a host's bytes to commands: the emulator's side of `decoder`.

It follows the rules of a modem's reader:

- A line command ends with CR, LF or CR LF on any port. Empty lines before a command are ignored, so
  an LF after the CR of the former command does no harm.
- After the header of a payload command the reader takes exactly the announced bytes, then one line
  end. A payload longer than announced is one mistake, together with what follows up to the line
  end. A payload shorter than announced takes the host's next bytes until it is complete.
- In data mode a command begins with `+++AT` anywhere; everything else is data. Bytes that may
  become `+++AT` wait until the next byte decides.
- `+++` alone leaves data mode, if a second of silence precedes and follows it. The decoder has no
  clock: its owner calls `silence`.
- `ATC` and `ATO` change how the very next byte is read, so the decoder follows them by itself.
"""

import re
from typing import Final, TypeAlias

from zacoustic_evologics.at.commands import (
    Act,
    Action,
    Command,
    Escape,
    InvalidCommand,
    Mistake,
    PayloadCommand,
)
from zacoustic_evologics.at.framing import (
    HEADER_LIMIT_BYTES,
    PACKET_START,
    PAYLOAD_LIMIT_BYTES,
    Framing,
    Gap,
    Interpreter,
)
from zacoustic_evologics.at.messages import RawData
from zacoustic_evologics.at.stream import StreamDecoder
from zacoustic_evologics.at.table import LINE_COMMANDS, PAYLOAD_COMMANDS, refuse_number

COMMAND_LINE_LIMIT_BYTES: Final = 256
"""Longest line command, and longest part of a wrong payload that is shown."""
HELD_COMMAND_LIMIT_BYTES: Final = (
    len(PACKET_START) + HEADER_LIMIT_BYTES + PAYLOAD_LIMIT_BYTES + COMMAND_LINE_LIMIT_BYTES
)
"""Most bytes held between two calls."""

CommandMessage: TypeAlias = Command | InvalidCommand | RawData
"""Messages of a host."""

_LINE_END: Final = re.compile(rb"[\r\n]")
_COMMAND_NAME: Final = re.compile(r"[?@&!*%]?[A-Z]{0,12}")
_FORMS: Final = ("?", "!", "@", "*", "%")
"""First characters that mark the form of a command, followed by any name."""
_ACTIONS: Final = {action.value for action in Action}


class CommandDecoder(StreamDecoder[Command | InvalidCommand]):
    """Reads the commands of a host on one port; holds `HELD_COMMAND_LIMIT_BYTES` at most.

    Args:
        interpreter: The interpreter of the port. With NET the framing is always LINES.
        framing: Framing of the connection at first; the decoder follows `ATC` and `ATO`.
    """

    def __init__(
        self, interpreter: Interpreter = Interpreter.NET, framing: Framing = Framing.LINES
    ) -> None:
        if interpreter is Interpreter.NET and framing is Framing.PACKETS:
            raise ValueError("the NET interpreter has no data mode")
        super().__init__(framing)
        self.interpreter = interpreter
        self._after_cr = False
        self._skipping = False

    def silence(self, *, guarded: bool) -> list[CommandMessage]:
        """Note that the host has been silent for the guard time of `+++`.

        Args:
            guarded: The held bytes are all that came since another such silence.

        Returns:
            `Escape` if they are `+++` and guarded; otherwise, in data mode, the bytes held because
            they might have become a command, as data. A command that has begun stays held.
        """
        if self.framing is Framing.LINES or not self._buffer or self._has_begun:
            return []
        held = self._take(self.held_bytes)
        if held == b"+++" and guarded:
            self.framing = Framing.LINES
            return [Escape()]
        return [RawData(held)]

    @property
    def _has_begun(self) -> bool:
        """Whether a command in data mode is at the beginning of the buffer."""
        return self._buffer.startswith(PACKET_START)

    def _read(self) -> CommandMessage | None:
        self._drop_line_ends()
        if not self._buffer:
            return None
        if self.framing is Framing.LINES:
            return self._read_command(0)
        raw = self._read_raw()
        return raw or (self._read_command(len(b"+++")) if self._has_begun else None)

    def _drop_line_ends(self) -> None:
        """Drop bytes that belong to no command."""
        if self._skipping and self._buffer:
            end = _LINE_END.search(self._buffer)
            if end is None:
                self._buffer.clear()
            else:
                self._skipping = False
                self._end_line(end.start())
        if self._after_cr and self._buffer:
            self._after_cr = False
            if self._buffer.startswith(b"\n"):
                self._take(1)
        if self.framing is Framing.LINES:
            self._take(len(self._buffer) - len(self._buffer.lstrip(b"\r\n")))

    def _read_command(self, start: int) -> CommandMessage | None:
        read = read_payload_command(self._buffer, start)
        if read is Gap.INCOMPLETE:
            return None
        if isinstance(read, Gap):
            return self._read_line_command(start)
        command, end, name = read
        if command is None:
            return self._read_invalid(start, end, name)
        self._end_line(end)
        return command

    def _read_invalid(self, start: int, search: int, name: str) -> InvalidCommand | None:
        """Read up to the line end that follows `search`."""
        limit = search + COMMAND_LINE_LIMIT_BYTES
        end = _LINE_END.search(self._buffer, search, limit)
        if end is None and len(self._buffer) < limit:
            return None
        stop = end.start() if end else limit
        raw = bytes(self._buffer[start:stop])
        if end:
            self._end_line(stop)
        else:
            self._take(stop)
            self._skipping = True
        return InvalidCommand(raw, Mistake.WRONG_FORMAT, name)

    def _read_line_command(self, start: int) -> CommandMessage | None:
        end = _LINE_END.search(self._buffer, start, start + COMMAND_LINE_LIMIT_BYTES)
        if end is None:
            return self._read_invalid(start, start, "")
        raw = bytes(self._buffer[start : end.start()])
        self._end_line(end.start())
        command = decode_command_line(raw)
        if isinstance(command, Act) and self.interpreter is Interpreter.AT:
            if command.action is Action.COMMAND_MODE:
                self.framing = Framing.LINES
            elif command.action is Action.DATA_MODE:
                self.framing = Framing.PACKETS
        return command

    def _end_line(self, end: int) -> None:
        self._after_cr = self._take(end + 1).endswith(b"\r")


def read_payload_command(
    buffer: bytes | bytearray, start: int = 0
) -> tuple[PayloadCommand | None, int, str] | Gap:
    """Read a command with payload.

    Args:
        buffer: Has the `AT` of a command at `start`.
        start: Where it begins.

    Returns:
        The command (None: it has a mistake), where its line end is, and its name; MALFORMED: it has
        no payload.
    """
    for row in PAYLOAD_COMMANDS:
        if not buffer.startswith(b"AT" + row.start, start):
            continue
        header = row.read_header(buffer, start + len(b"AT"))
        if isinstance(header, Gap):
            return header
        end = header.payload_end
        if len(buffer) <= end:
            return Gap.INCOMPLETE
        payload = bytes(buffer[header.payload_start : end])
        command = row.read(header.text, payload=payload) if buffer[end] in b"\r\n" else None
        return command, end, row.name
    return Gap.MALFORMED


def decode_command_line(raw: bytes) -> Command | InvalidCommand:
    """Read a command without payload.

    Args:
        raw: From its `AT` on, without `+++` and line end.
    """
    text = raw.decode("latin-1")
    rest = text.removeprefix("AT")
    if rest == text:
        return InvalidCommand(raw, Mistake.WRONG_FORMAT)
    for row in LINE_COMMANDS:
        command: Command | None = row.read(rest)
        if command is not None and not (isinstance(command, Act) and refuse_number(command)):
            return command
    match = _COMMAND_NAME.match(rest)
    name = match[0] if match else ""
    known = name.startswith(_FORMS) or name in _ACTIONS
    return InvalidCommand(raw, Mistake.WRONG_FORMAT if known else Mistake.UNKNOWN_COMMAND, name)
