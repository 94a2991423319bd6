"""MAVLink packets as bytes: the only module that knows pymavlink.

The rest of the package has messages as their name and their fields, so its rules need no pymavlink,
and nothing outside depends on classes that are generated at its build. Packets that are sent are
MAVLink 2; both versions are read.
"""

import importlib
import struct
from typing import Any, Final

import msgspec

AUTOPILOT: Final = 1
"""Component id of an autopilot (MAV_COMP_ID_AUTOPILOT1)."""


class Message(msgspec.Struct, frozen=True):
    """A MAVLink message."""

    name: str
    """Its name, such as `HEARTBEAT`."""
    fields: dict[str, Any]
    """Values by field, in the units of the MAVLink definition."""


class Received(msgspec.Struct, frozen=True, kw_only=True):
    """A message with its sender."""

    message: Message
    """The message."""
    system: int
    """System id of the sender, 1..255."""
    component: int
    """Component id of the sender."""
    sequence: int | None = None
    """Number of the packet, 0..255; a sender counts its packets. None: not known."""


class PacketCodec:
    """Packs messages and finds them in received bytes.

    Raises:
        ModuleNotFoundError: pymavlink is not installed.
    """

    def __init__(self) -> None:
        # Generated code without type hints: everything of it ends in this class.
        self._dialect: Any = importlib.import_module("pymavlink.dialects.v20.common")
        self._reader = self._new_reader()
        self._writer: Any = self._dialect.MAVLink(None)
        self._known: dict[str, Any] = {
            each.msgname: each for each in self._dialect.mavlink_map.values()
        }

    def pack(self, message: Message, *, system: int, component: int) -> bytes:
        """Return a packet.

        Args:
            message: The message; a field that MAVLink 2 has as an extension may be missing.
            system: System id of the sender.
            component: Component id of the sender.

        Raises:
            ValueError: A field cannot have this value.
        """
        writer = self._writer
        writer.srcSystem, writer.srcComponent = system, component
        try:
            packet: bytes = self._known[message.name](**message.fields).pack(writer)
        except (struct.error, TypeError) as error:
            raise ValueError(f"{message.name}: {error}") from error
        writer.seq = (writer.seq + 1) % 256
        return packet

    def feed(self, data: bytes, *, is_whole: bool = False) -> list[Received]:
        """Return the messages that some bytes complete; skip damage and unknown messages.

        Args:
            data: The bytes.
            is_whole: No packet goes on in the next bytes, as in datagrams. In a stream, a damaged
                length takes packets behind it along.
        """
        if is_whole:
            self._reader = self._new_reader()
        received = []
        for packet in self._reader.parse_buffer(data) or ():
            name = packet.get_type()
            if name not in self._known:
                continue
            fields = packet.to_dict()
            fields.pop("mavpackettype", None)
            received.append(
                Received(
                    message=Message(name, fields),
                    system=packet.get_srcSystem(),
                    component=packet.get_srcComponent(),
                    sequence=packet.get_seq(),
                )
            )
        return received

    def _new_reader(self) -> Any:  # noqa: ANN401 (generated code)
        reader = self._dialect.MAVLink(None)
        reader.robust_parsing = True
        return reader
