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
from collections.abc import Callable
from typing import Final, TypeAlias

import msgspec

from zacoustic_evologics.at.commands import (
    Act,
    Action,
    Command,
    Escape,
    ExtensionCommand,
    Help,
    InvalidCommand,
    Mistake,
    Query,
    SendBurst,
    SendIm,
    SendIms,
    SendPbm,
    SendProbe,
    Set,
    SetOption,
)
from zacoustic_evologics.at.encoder import NUMBERED_ACTIONS
from zacoustic_evologics.at.fields import SIGNED, Choice, Integer, Maybe
from zacoustic_evologics.at.framing import (
    HEADER_LIMIT_BYTES,
    PACKET_START,
    PAYLOAD_LIMIT_BYTES,
    Framing,
    Gap,
    Header,
    Interpreter,
    packet_start_overlap,
    read_header,
)
from zacoustic_evologics.at.layouts import Columns, decode_columns, width
from zacoustic_evologics.at.messages import RawData
from zacoustic_evologics.at.notifications import ImFlag

COMMAND_LINE_LIMIT_BYTES: Final = 256
"""Longest line command, and longest part of a wrong payload that is shown."""
HELD_COMMAND_LIMIT_BYTES: Final = (
    len(PACKET_START) + HEADER_LIMIT_BYTES + PAYLOAD_LIMIT_BYTES + COMMAND_LINE_LIMIT_BYTES
)
"""Most bytes held between two calls."""

CommandMessage: TypeAlias = Command | InvalidCommand | RawData
"""Messages of a host."""


class _PayloadForm(msgspec.Struct, frozen=True):
    record: "Callable[..., PayloadCommand]"
    columns: Columns


_NUMBER: Final = Integer(0, 2**32 - 1)
_DESTINATION: Final[Columns] = (("destination", _NUMBER),)
_PAYLOAD_FORMS: Final = {
    b"*SENDIM,": _PayloadForm(SendIm, (*_DESTINATION, ("flag", Choice(ImFlag)))),
    b"*SENDIMS,": _PayloadForm(SendIms, (*_DESTINATION, ("start_us", Maybe(_NUMBER)))),
    b"*SENDPBM,": _PayloadForm(SendPbm, _DESTINATION),
    b"*SEND,": _PayloadForm(SendBurst, _DESTINATION),
}
_PROBE: Final[Columns] = (("bit", SIGNED), ("follow", SIGNED), ("start_us", Maybe(_NUMBER)))
_LINE_END: Final = re.compile(rb"[\r\n]")
_ACTION: Final = re.compile(r"(&?[A-Z]?)([0-9]{0,3})")
_ACTIONS: Final = {action.value: action for action in Action}
_NAMED: Final = re.compile(r"([?!@])([A-Z]{1,12})([0-9]{0,10})")
_EXTENSION: Final = re.compile(r"%([A-Z]{1,12})(?:,([ -~]*))?")
_HELP: Final = re.compile(r"([?!@&%*]?[A-Z]{1,12})\$")
_COMMAND_NAME: Final = re.compile(r"[?@&!*%]?[A-Z]{0,12}")


class CommandDecoder:
    """Reads the commands of a host on one port.

    Args:
        interpreter: The interpreter of the port. With NET the framing is always LINES.
        framing: Framing of the connection at first; the decoder follows `ATC` and `ATO`.
    """

    def __init__(
        self, interpreter: Interpreter = Interpreter.NET, framing: Framing = Framing.LINES
    ) -> None:
        if interpreter is Interpreter.NET and framing is Framing.PACKETS:
            raise ValueError("the NET interpreter has no data mode")
        self.interpreter = interpreter
        self.framing = framing
        self._buffer = bytearray()
        self._after_cr = False
        self._skipping = False

    @property
    def held_bytes(self) -> int:
        """Number of bytes waiting for more, at most `HELD_COMMAND_LIMIT_BYTES`."""
        return len(self._buffer)

    def feed(self, received: bytes) -> list[CommandMessage]:
        """Take bytes, return the messages that they complete. Never raises on their content."""
        self._buffer += received
        messages: list[CommandMessage] = []
        while self._prepare():
            message = self._read()
            if message is None:
                break
            previous = messages[-1] if messages else None
            if isinstance(message, RawData) and isinstance(previous, RawData):
                messages[-1] = RawData(previous.content + message.content)
            else:
                messages.append(message)
        return messages

    def silence(self, *, guarded: bool) -> list[CommandMessage]:
        """Note that the host has been silent for the guard time of `+++`.

        Args:
            guarded: The held bytes are all that came since another such silence.

        Returns:
            `Escape` if they are `+++` and guarded; otherwise, in data mode, the bytes held because
            they might have become a command, as data. A command that has begun stays held.
        """
        held = bytes(self._buffer)
        if self.framing is Framing.LINES or not held or held.startswith(PACKET_START):
            return []
        self._buffer.clear()
        if held == b"+++" and guarded:
            self.framing = Framing.LINES
            return [Escape()]
        return [RawData(held)]

    def _prepare(self) -> bool:
        """Drop bytes that belong to no command; return whether any are left."""
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
                del self._buffer[:1]
        if self.framing is Framing.LINES:
            empty = len(self._buffer) - len(self._buffer.lstrip(b"\r\n"))
            del self._buffer[:empty]
        return bool(self._buffer)

    def _read(self) -> CommandMessage | None:
        if self.framing is Framing.LINES:
            return self._read_command(0)
        start = self._buffer.find(PACKET_START)
        if start < 0:
            start = len(self._buffer) - packet_start_overlap(self._buffer)
        if start > 0:
            content = bytes(self._buffer[:start])
            del self._buffer[:start]
            return RawData(content)
        return self._read_command(len(b"+++")) if self._buffer.startswith(PACKET_START) else None

    def _read_command(self, start: int) -> CommandMessage | None:
        for token, form in _PAYLOAD_FORMS.items():
            if self._buffer.startswith(b"AT" + token, start):
                header = read_header(
                    self._buffer[start : start + HEADER_LIMIT_BYTES],
                    width(form.columns),
                    PAYLOAD_LIMIT_BYTES,
                )
                if header is Gap.INCOMPLETE:
                    return None
                if isinstance(header, Header):
                    name = token[:-1].decode()
                    return self._read_payload_command(start, name, form, header)
        return self._read_line_command(start)

    def _read_payload_command(
        self, start: int, name: str, form: _PayloadForm, header: Header
    ) -> CommandMessage | None:
        end = start + header.payload_end
        if len(self._buffer) <= end:
            return None
        payload = bytes(self._buffer[start + header.payload_start : end])
        try:
            values = decode_columns(form.columns, header.values)
            command = form.record(payload=payload, pid=header.pid, **values)
        except ValueError:
            return self._read_invalid(start, end, name)
        if self._buffer[end] not in b"\r\n":
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
            del self._buffer[:stop]
            self._skipping = True
        return InvalidCommand(raw, Mistake.WRONG_FORMAT, name)

    def _read_line_command(self, start: int) -> CommandMessage | None:
        limit = start + COMMAND_LINE_LIMIT_BYTES
        end = _LINE_END.search(self._buffer, start, limit)
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
        self._after_cr = self._buffer[end : end + 1] == b"\r"
        del self._buffer[: end + 1]


PayloadCommand: TypeAlias = SendIm | SendIms | SendPbm | SendBurst
"""A command that ends with a payload."""


def decode_payload_command(raw: bytes) -> tuple[PayloadCommand, int] | None:
    """Read a command with payload from the beginning of some bytes.

    Args:
        raw: From its `AT` on, with its line end.

    Returns:
        The command and the bytes it took, line end included; None: it is none, or incomplete.
    """
    for token, form in _PAYLOAD_FORMS.items():
        if raw.startswith(b"AT" + token):
            header = read_header(raw[:HEADER_LIMIT_BYTES], width(form.columns), PAYLOAD_LIMIT_BYTES)
            if isinstance(header, Gap):
                return None
            end = header.payload_end
            try:
                values = decode_columns(form.columns, header.values)
                payload = raw[header.payload_start : end]
                command = form.record(payload=payload, pid=header.pid, **values)
            except ValueError:
                return None
            return (command, end + 1) if raw[end : end + 1] in (b"\r", b"\n") else None
    return None


def decode_command_line(raw: bytes) -> Command | InvalidCommand:
    """Read a command without payload.

    Args:
        raw: From its `AT` on, without `+++` and line end.
    """
    text = raw.decode("latin-1")
    rest = text.removeprefix("AT")
    if rest == text:
        return InvalidCommand(raw, Mistake.WRONG_FORMAT)
    command = _decode_action(rest) or _decode_named(rest)
    if command is not None:
        return command
    match = _COMMAND_NAME.match(rest)
    name = match[0] if match else ""
    known = name[:1] in _FORMS or name in _ACTIONS
    return InvalidCommand(raw, Mistake.WRONG_FORMAT if known else Mistake.UNKNOWN_COMMAND, name)


def _decode_action(rest: str) -> Act | None:
    match = _ACTION.fullmatch(rest)
    if not match or match[1] not in _ACTIONS:
        return None
    if match[2] and (match[1] not in NUMBERED_ACTIONS or int(match[2]) > 255):
        return None
    return Act(_ACTIONS[match[1]], int(match[2]) if match[2] else None)


def _decode_named(rest: str) -> Command | None:
    if match := _HELP.fullmatch(rest):
        return Help(match[1])
    if match := _EXTENSION.fullmatch(rest):
        return ExtensionCommand(match[1], match[2] or "")
    if match := _NAMED.fullmatch(rest):
        return _decode_setting(match[1], match[2], match[3])
    token, *texts = rest.split(",")
    if token != "*SENDPROBE" or len(texts) != len(_PROBE):
        return None
    try:
        return SendProbe(**decode_columns(_PROBE, tuple(texts)))
    except ValueError:
        return None


def _decode_setting(form: str, name: str, number: str) -> Command | None:
    value = int(number) if number else None
    if form == "@":
        return SetOption(name, value)
    if form == "!":
        return None if value is None else Set(name, value)
    return Query(name) if value is None else None


_FORMS: Final = frozenset("?!@*%")
"""First characters that mark the form of a command, followed by any name."""
