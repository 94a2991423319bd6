"""The grammar of an S2C modem: one row for each kind of message, read and written by the same row.

A row has the words of a message and the order of its fields; kinds and limits of the fields are in
the annotations of its record. There are three groups: what a host says (`COMMANDS`), what a modem
says unasked (`NOTIFICATIONS`), and what it answers (`ANSWERS`).

A payload has exactly the length that its record announces, then a line end; nothing in it is
escaped. Firmware 1.6 has other fields in two records. The field that holds the velocity in the
later layout distinguishes the two: velocities have a decimal point in every source, and the delay
that firmware 1.6 has there has none; then the next field must be the velocity.

A notification with more fields than its row is read without the surplus ones: one firmware adds a
velocity to RECVEND, and a later one must not disable a whole kind of record.
"""

from collections.abc import Callable
from typing import Any, Final, TypeAlias

from zacoustic.core.linktypes import BROADCAST
from zacoustic.link.fields import fields_of
from zacoustic.link.forms import Form
from zacoustic_evologics.at import commands as asked
from zacoustic_evologics.at import notifications as said
from zacoustic_evologics.at import replies, usbl
from zacoustic_evologics.at.fields import Payload
from zacoustic_evologics.at.framing import Gap, Header, read_header
from zacoustic_evologics.at.messages import Noise
from zacoustic_evologics.at.settings import refuse_value

Record: TypeAlias = said.Notification | Noise
"""Records of a modem that are no answer in text."""


class Row(Form[Any]):
    """One kind of message.

    Args:
        record: Type of its record.
        name: How it begins; for a command this names its answer in a packet.
        rest: All that follows, a payload apart; None: each field of `columns` after a comma, for a
            payload with protocol id and length before them.
        columns: Names of fields, in order; empty: all of the record that are not in `name`.
        option: Option of the port that switches it on, such as `ZX`; empty: it always comes.
        refusal: Returns why a host must not send such a command, or an empty text.
    """

    def __init__(
        self,
        record: type,
        name: str,
        rest: str | None = None,
        *,
        columns: str = "",
        option: str = "",
        refusal: Callable[[Any], str] = lambda command: "",
    ) -> None:
        kinds = fields_of(record)
        payload = kinds.get("payload")
        self.payload = payload if isinstance(payload, Payload) else None
        self.option = option
        self.refusal = refusal
        surplus = ""
        if rest is None:
            names = columns.split() or [each for each in kinds if each not in ("payload", "pid")]
            rest = "".join(f",{{{each}}}" for each in names)
            surplus = "(?:,.*)?"
        if self.payload is not None:
            pid = "{pid}" if "pid" in kinds else ""
            rest, surplus = f",{pid}{{payload}}{rest},", ""
        super().__init__(record, name + rest, surplus=surplus)
        self.name = name
        self.start = f"{name},".encode()
        self.commas = self.template.count(",")
        self._name: Form[Any] = Form(record, name)

    def name_of(self, record: object) -> str:
        """Return how the text of a record begins: a command without its parameters."""
        return self._name.write(record)

    def read_header(self, buffer: bytes | bytearray, start: int = 0) -> Header | Gap:
        """Read the text before a payload, whose name and comma are at `start`."""
        assert self.payload is not None
        return read_header(buffer, start, self.commas, self.payload.longest_read)

    def encode(self, record: object) -> bytes:
        """Write a record, with its payload.

        Raises:
            ValueError: A value that the grammar or the device does not allow.
        """
        if refusal := self.refusal(record):
            raise ValueError(refusal)
        payload: bytes = getattr(record, "payload", b"")
        return self.write(record).encode("ascii") + payload


def _refuse_broadcast(command: asked.SendIm) -> str:
    if command.destination == BROADCAST and command.flag is said.ImFlag.ACK:
        return f"nobody acknowledges for {BROADCAST}; allowed: noack, force"
    return ""


def _refuse_setting(command: asked.Set | asked.SetOption) -> str:
    return "" if command.value is None else refuse_value(command.name, command.value)


def refuse_number(command: asked.Act) -> str:
    """Return why an action cannot have its number, or an empty text."""
    is_plain = command.value is None or command.action.value in NUMBERED_ACTIONS
    return "" if is_plain else f"{command.action.name} with {command.value}"


NUMBERED_ACTIONS: Final = frozenset("DHIZ")
"""Letters of commands that may carry a number."""

PAYLOAD_COMMANDS: Final = (
    Row(asked.SendIm, "*SENDIM", refusal=_refuse_broadcast),
    Row(asked.SendIms, "*SENDIMS"),
    Row(asked.SendPbm, "*SENDPBM"),
    Row(asked.SendBurst, "*SEND"),
)
LINE_COMMANDS: Final = (
    Row(asked.SendProbe, "*SENDPROBE", ",{bit},{follow},{start_us}"),
    Row(asked.Query, "?{name}", ""),
    Row(asked.Set, "!{name}", "{value}", refusal=_refuse_setting),
    Row(asked.SetOption, "@{name}", "{value}", refusal=_refuse_setting),
    Row(asked.Act, "{action}", "{value}", refusal=refuse_number),
    Row(asked.Help, "{key}$", ""),
    Row(asked.ExtensionCommand, "%{key}", "{parameters}"),
)
COMMANDS: Final[dict[type, Row]] = {row.record: row for row in PAYLOAD_COMMANDS + LINE_COMMANDS}
"""All that a host says, by record; behind `AT`."""

_FROM: Final = "source destination"
_RECEIVED: Final = "duration_us rssi_db integrity velocity_m_s"
_RECEIVED_1_6: Final = "bit_rate_bps rssi_db integrity propagation_us velocity_m_s"

PAYLOAD_RECORDS: Final = (
    Row(said.RecvIm, "RECVIM", columns=f"{_FROM} flag {_RECEIVED}"),
    Row(said.RecvIms, "RECVIMS", columns=f"{_FROM} timestamp_us {_RECEIVED}"),
    Row(said.RecvPbm, "RECVPBM", columns=f"{_FROM} {_RECEIVED}"),
    Row(said.Recv, "RECV", columns=f"{_FROM} {_RECEIVED_1_6}"),
    Row(Noise, "NOISE"),
)
"""Records that end with a payload."""
FIRMWARE_1_6: Final[dict[type, Row]] = {
    said.RecvIm: Row(said.RecvIm, "RECVIM", columns=f"{_FROM} flag {_RECEIVED_1_6}"),
    said.RecvPbm: Row(said.RecvPbm, "RECVPBM", columns=f"{_FROM} {_RECEIVED_1_6}"),
}
"""Rows of older firmware, where they differ."""
LINE_RECORDS: Final = (
    Row(said.RecvStart, "RECVSTART", option="ZX"),
    Row(said.RecvEnd, "RECVEND", option="ZX"),
    Row(said.RecvFailed, "RECVFAILED", option="ZX"),
    Row(said.RecvSrv, "RECVSRV", option="ZX"),
    Row(said.RecvProbe, "RECVPROBE"),
    Row(said.SendStart, "SENDSTART", option="ZX"),
    Row(said.SendEnd, "SENDEND", option="ZX"),
    Row(said.Delivered, "DELIVERED"),
    Row(said.Failed, "FAILED"),
    Row(said.DeliveredIm, "DELIVEREDIM"),
    Row(said.FailedIm, "FAILEDIM"),
    Row(said.CanceledIm, "CANCELEDIM"),
    Row(said.CanceledIms, "CANCELEDIMS"),
    Row(said.CanceledPbm, "CANCELEDPBM"),
    Row(said.ExpiredIms, "EXPIREDIMS"),
    Row(said.BitRate, "BITRATE", option="ZX"),
    Row(said.RemoteAddress, "RADDR", option="ZX"),
    Row(said.SourceLevel, "SRCLEVEL", option="ZX"),
    Row(said.DropCount, "DROPCNT"),
    Row(said.PhyOn, "PHYON", option="ZX"),
    Row(said.PhyOff, "PHYOFF", option="ZX"),
    Row(said.Status, "STATUS", option="ZX"),
    Row(usbl.UsblLong, "USBLLONG", option="ZU"),
    Row(usbl.UsblAngles, "USBLANGLES", option="ZU"),
    Row(usbl.UsblPhyD, "USBLPHYD", option="ZU"),
    Row(usbl.UsblPhyP, "USBLPHYP", option="ZU"),
    Row(said.ExternalClock, "ECLK", option="ZA"),
    Row(said.ClockOffset, "RTO", option="ZX"),
    Row(said.AsyncError, "ERROR ", "{fault}"),
    Row(said.Extension, "%{key}", "{parameters}"),
)
"""Records without a payload. Sources differ in some of those with extended notifications, `ZX`."""
NOTIFICATIONS: Final[dict[type, Row]] = {row.record: row for row in PAYLOAD_RECORDS + LINE_RECORDS}
"""All that a modem says unasked, and its recording of noise, by record; of firmware 1.9."""

ANSWERS: Final[dict[type, Form[Any]]] = {
    form.record: form
    for form in (
        Form(replies.Accepted, "{starred}OK"),
        Form(replies.Refused, "{kind}{reason}"),
        Form(replies.Number, "{starred}{value}"),
        Form(replies.Measurement, "{value}"),
        Form(replies.ModeReply, "{interpreter}"),
        Form(replies.DeliveryReply, "{state}", surplus=r"(?:(?<=DELIVERED)[^,]*)?(?:,(?s:.*))?"),
        Form(replies.LinkStatus, "{state}{free_bytes}"),
        Form(
            replies.NetStatus, "{local_address}\n{remote_address}\n{state}\n{pool}\n{promiscuous}"
        ),
        Form(replies.SettingsReply, "{settings}"),
        Form(replies.MultipathReply, "{paths}"),
        Form(replies.PositionReply, "{measured_s},{address},{x_m},{y_m},{z_m}"),
    )
}
"""All that a modem answers, by record; other text is a `TextReply`."""
ANSWERS_TO: Final[dict[str, tuple[type, ...]]] = {
    "?MODE": (replies.ModeReply,),
    "?DI": (replies.DeliveryReply,),
    "?S": (replies.NetStatus, replies.LinkStatus),
    "?P": (replies.MultipathReply,),
    "?UP": (replies.PositionReply,),
    "?UPX": (replies.PositionReply,),
    "?E": (replies.Measurement,),
    "?V": (replies.Measurement,),
    "?BV": (replies.Measurement,),
    "&V": (replies.SettingsReply,),
    "A": (replies.LinkStatus,),
    "N": (replies.LinkStatus,),
    "S": (replies.LinkStatus,),
}
"""Answers to commands, by their names, besides those that fit every command; other queries are
answered by a number."""
SEVERAL_LINES: Final = frozenset({"?ZSL", "?P", "&V"})
"""Commands whose answers have several lines; besides help, and `?S` of the NET interpreter."""
