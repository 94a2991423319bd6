"""The meaning of an answer's text, by the command that was sent; and its text from the meaning.

One command is in flight at a time, so an answer carries no name: the dialogue collects it
(`ReplyCollector`) and reads it (`decode_reply`); an emulator writes it (`reply_text`).

In the LINES framing an empty line ends an answer of several lines; the collector joins the lines to
the text that a packet would have.
"""

import re
from typing import Final, assert_never

from zacoustic_evologics.at.commands import Act, Action, Command, Help, Query
from zacoustic_evologics.at.fields import ADDRESS, COUNT, METRES, SIGNED, Decimal
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.at.messages import Reply
from zacoustic_evologics.at.replies import (
    Accepted,
    CommandReply,
    DeliveryReply,
    DeliveryState,
    LinkStatus,
    Measurement,
    ModeReply,
    MultipathReply,
    NetStatus,
    Number,
    Path,
    PositionReply,
    RefusalKind,
    Refused,
    SettingsReply,
    ShownSetting,
    TextReply,
)

STARRED: Final = "[*]"
"""Prefix of some answers."""

STATE_ACTIONS: Final = frozenset({Action.LISTEN, Action.MEASURE_NOISE, Action.DEAF})
"""Actions whose answer is the new state, not OK."""

_MEASUREMENTS: Final = frozenset({"E", "V", "BV"})
_MEASUREMENT: Final = Decimal(4, 1_000_000.0)
_REFUSAL: Final = re.compile(r"(ERROR|BUSY)(?: ([^\r\n]*))?")
_NUMBER: Final = re.compile(r"(\[\*\])?(-?[0-9]{1,19})")
_STATUS: Final = re.compile(r"([A-Z_]+(?: [A-Z_]+)*)((?: [0-9]{1,10})*)")
_PATH: Final = re.compile(r"([0-9]{1,10}) +([0-9]{1,10}) *")
_SHOWN: Final = re.compile(r"(\[\*\])?([^:\r\n]+): *(-?[0-9]{1,19}) *")


def decode_reply(command: Command, text: str) -> CommandReply:
    """Read an answer by its command; an unexpected one becomes `TextReply`.

    Args:
        command: The answered command.
        text: The whole text; several lines with their line feeds.
    """
    if text in ("OK", STARRED + "OK"):
        return Accepted(text != "OK")
    if match := _REFUSAL.fullmatch(text):
        return Refused(RefusalKind(match[1]), match[2] or "")
    try:
        return _decode_value(command, text) or TextReply(text)
    except ValueError:
        return TextReply(text)


def reply_text(reply: CommandReply) -> str:
    """Write an answer; one of several lines ends with a line feed.

    Raises:
        ValueError: A value that its field does not allow.
    """
    match reply:
        case Accepted():
            return STARRED + "OK" if reply.starred else "OK"
        case Refused():
            return f"{reply.kind.value} {reply.reason}" if reply.reason else reply.kind.value
        case Number():
            return (STARRED if reply.starred else "") + SIGNED.encode(reply.value)
        case Measurement():
            return _MEASUREMENT.encode(reply.value)
        case ModeReply():
            return reply.interpreter.value
        case DeliveryReply():
            return reply.state.value
        case LinkStatus():
            return " ".join([reply.state, *map(COUNT.encode, reply.free_bytes)])
        case NetStatus():
            return _net_status_text(reply)
        case SettingsReply():
            # Captured so; the other answers of several lines have bare line feeds.
            return "".join(f"{_shown_text(setting)}\r\n" for setting in reply.settings)
        case MultipathReply():
            return "".join(f"{path.delay_us:<6d}{path.strength:<5d}\n" for path in reply.paths)
        case PositionReply():
            numbers = [COUNT.encode(reply.measured_s), ADDRESS.encode(reply.address)]
            position = [METRES.encode(each) for each in (reply.x_m, reply.y_m, reply.z_m)]
            return ",".join(numbers + position)
        case TextReply():
            return reply.text
        case _:
            assert_never(reply)


def has_several_lines(command: Command, interpreter: Interpreter) -> bool:
    """Tell whether an empty line ends the answer to a command, unless it is a refusal."""
    match command:
        case Query("S"):
            return interpreter is Interpreter.NET
        case Query("ZSL" | "P") | Act(Action.SHOW_SETTINGS) | Help():
            return True
        case _:
            return False


class ReplyCollector:
    """Joins the lines that answer one command.

    Args:
        command: The command that was sent.
        interpreter: The interpreter of the port.
    """

    def __init__(self, command: Command, interpreter: Interpreter) -> None:
        self._several = has_several_lines(command, interpreter)
        self._lines: list[str] = []

    def add(self, reply: Reply) -> str | None:
        """Take a reply; return the whole text once it is complete.

        It skips an empty line where none is expected: one firmware adds one to its `OK`.
        """
        if reply.command is not None:
            return reply.text
        if self._several:
            if not self._lines and _REFUSAL.fullmatch(reply.text):
                return reply.text
            if reply.text:
                self._lines.append(reply.text + "\n")
                return None
            return "".join(self._lines) or None
        return reply.text or None


def _decode_value(command: Command, text: str) -> CommandReply | None:
    match command:
        case Query("MODE"):
            return ModeReply(Interpreter(text))
        case Query("DI"):
            return _decode_delivery(text)
        case Query("S"):
            return _decode_net_status(text) if "\n" in text else _decode_status(text)
        case Query("P"):
            return _decode_multipath(text)
        case Query("UP" | "UPX"):
            return _decode_position(text)
        case Query(name) if name in _MEASUREMENTS:
            return Measurement(_MEASUREMENT.decode(text))
        case Query():
            return _decode_number(text)
        case Act(Action.SHOW_SETTINGS):
            return _decode_settings(text)
        case Act(action) if action in STATE_ACTIONS:
            return _decode_status(text)
        case _:
            return None


def _decode_number(text: str) -> Number | None:
    match = _NUMBER.fullmatch(text)
    return Number(SIGNED.decode(match[2]), match[1] is not None) if match else None


def _decode_delivery(text: str) -> DeliveryReply | None:
    word = text.partition(",")[0]
    if word.startswith(DeliveryState.DELIVERED.value):
        return DeliveryReply(DeliveryState.DELIVERED)
    return DeliveryReply(DeliveryState(word))


def _decode_status(text: str) -> LinkStatus | None:
    match = _STATUS.fullmatch(text.removeprefix(STARRED))
    if not match:
        return None
    return LinkStatus(match[1], tuple(COUNT.decode(room) for room in match[2].split()))


def _decode_net_status(text: str) -> NetStatus | None:
    """Read the values behind the colons by their order: the labels are uncertain."""
    lines = [line.partition(":")[2].strip() for line in text.splitlines() if line.strip()]
    if len(lines) != 5:
        return None
    return NetStatus(
        local_address=ADDRESS.decode(lines[0]),
        remote_address=ADDRESS.decode(lines[1]),
        state=lines[2],
        pool=lines[3],
        promiscuous=lines[4] in ("ON", "1"),
    )


def _net_status_text(status: NetStatus) -> str:
    values = {
        "Local Address": ADDRESS.encode(status.local_address),
        "Remote Address": ADDRESS.encode(status.remote_address),
        "Acoustic Link Status": status.state,
        "Pool Status": status.pool,
        "Promiscuous Mode": "ON" if status.promiscuous else "OFF",
    }
    return "".join(f"{label}: {value}\n" for label, value in values.items())


def _decode_settings(text: str) -> SettingsReply | None:
    matches = [_SHOWN.fullmatch(line) for line in text.splitlines() if line.strip()]
    shown = tuple(
        ShownSetting(match[2], SIGNED.decode(match[3]), match[1] is not None)
        for match in matches
        if match
    )
    return SettingsReply(shown) if shown and None not in matches else None


def _shown_text(setting: ShownSetting) -> str:
    star = STARRED if setting.starred else ""
    return f"{star}{setting.label}: {SIGNED.encode(setting.value)}"


def _decode_multipath(text: str) -> MultipathReply | None:
    matches = [_PATH.fullmatch(line) for line in text.splitlines() if line.strip()]
    paths = tuple(Path(int(match[1]), int(match[2])) for match in matches if match)
    return MultipathReply(paths) if paths and None not in matches else None


def _decode_position(text: str) -> PositionReply | None:
    fields = text.split(",")
    if len(fields) != 5:
        return None
    x_m, y_m, z_m = (METRES.decode(each) for each in fields[2:])
    measured_s, address = COUNT.decode(fields[0]), ADDRESS.decode(fields[1])
    return PositionReply(measured_s=measured_s, address=address, x_m=x_m, y_m=y_m, z_m=z_m)
