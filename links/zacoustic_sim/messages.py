"""Messages between a simulated modem and the medium, in one process or over TCP.

A conversation: the modem sends `Hello`; the medium answers `Welcome`, or `Refused` and closes the
connection. Then the modem sends `Transmit`. The medium sends `Finished` for each of those, `Heard`
for each arrival, `Carrier` when another node becomes audible or silent, and `Answered` for each
acknowledgement, after its `Finished`.

Over TCP each message is a mark of two bytes, a length of two bytes, big-endian, and a tagged
msgpack map. The mark reveals nonsense at once, instead of after as many bytes as its first ones
announce. No clock crosses the line: a message says how long ago something was, and the reader
subtracts that from the instant of reading.

All durations are those of the node's clock. At a time scale of 100 this is a modem a hundred times
as fast, on a channel with sound a hundred times as fast.
"""

from typing import Final, Generic, TypeAlias, TypeVar

import msgspec

from zacoustic.core.linktypes import LinkCapabilities, LinkMetrics, TransmitOutcome

VERSION: Final = 2
"""Version of this conversation; the medium refuses another one."""
MESSAGE_LIMIT_BYTES: Final = 65_535
"""Longest message: a hundred times the largest frame of known modems."""

_MARK: Final = b"\x5a\x5e"
_HEAD_BYTES: Final = len(_MARK) + 2


class Hello(msgspec.Struct, frozen=True, tag="hello"):
    """A modem asks for its place on the channel."""

    version: int
    """Version of the conversation."""
    address: int
    """Acoustic address, one of the scenario's nodes."""


class Transmit(msgspec.Struct, frozen=True, tag="transmit"):
    """A modem wants to send a frame."""

    transmission_id: int
    """Comes back in `Finished`."""
    destination: int
    """Address, or `BROADCAST`."""
    frame_bytes: bytes
    """The frame."""
    acknowledge: bool = False
    """Ask the modem at the destination for an acknowledgement."""


class Welcome(msgspec.Struct, frozen=True, tag="welcome"):
    """The modem is attached."""

    capabilities: LinkCapabilities
    """Its capabilities, in the node's clock."""
    profile: str
    """Name of the modem's profile."""
    time_scale: float
    """How many times faster than real time the channel is."""


class Refused(msgspec.Struct, frozen=True, tag="refused"):
    """The modem is not attached; the medium closes the connection."""

    reason: str
    """Reason, one line."""


class Finished(msgspec.Struct, frozen=True, tag="finished"):
    """A transmission has ended."""

    transmission_id: int
    """Id of the transmission."""
    outcome: TransmitOutcome
    """Its outcome."""
    lasted_ns: int = 0
    """Its airtime, ns; 0 if it was never on the air."""
    ago_ns: int = 0
    """How long before this message it ended, ns."""
    detail: str = ""
    """Why it was rejected."""


class Heard(msgspec.Struct, frozen=True, tag="heard"):
    """A frame has arrived."""

    source: int
    """Address of the sender."""
    destination: int
    """Address of the receiver, or `BROADCAST`."""
    frame_bytes: bytes
    """The frame, damaged if `damaged`."""
    metrics: LinkMetrics = LinkMetrics()
    """Measurements of the modem."""
    damaged: bool = False
    """A modem that checks its frames drops it."""
    ago_ns: int = 0
    """How long before this message its last bit arrived, ns."""


class Carrier(msgspec.Struct, frozen=True, tag="carrier"):
    """Another node became audible, or the last one fell silent."""

    busy: bool
    """Whether another node is audible."""


class Answered(msgspec.Struct, frozen=True, tag="answered"):
    """An acknowledgement has arrived, with the modem's measurements."""

    source: int
    """Address of the node whose modem has acknowledged."""
    metrics: LinkMetrics
    """Measurements, including the propagation delay."""
    ago_ns: int = 0
    """How long before this message it had arrived, ns."""


ClientMessage: TypeAlias = Hello | Transmit
"""Messages of a modem."""
ServerMessage: TypeAlias = Welcome | Refused | Finished | Heard | Carrier | Answered
"""Messages of the medium."""

MessageT = TypeVar("MessageT")


class MalformedMessageError(Exception):
    """Not a message of this conversation; the reader closes the connection."""


class MessageDecoder(Generic[MessageT]):
    """Splits a byte stream into messages; stores less than one message.

    Args:
        kind: `ClientMessage` or `ServerMessage`.
    """

    def __init__(self, kind: "type[MessageT] | object") -> None:
        self._decoder: msgspec.msgpack.Decoder[MessageT] = msgspec.msgpack.Decoder(kind)
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[MessageT]:
        """Take bytes, return the messages that they complete.

        Raises:
            MalformedMessageError: The stream is useless from here on.
        """
        self._buffer += data
        messages: list[MessageT] = []
        start = 0
        while len(self._buffer) - start >= _HEAD_BYTES:
            body = start + _HEAD_BYTES
            if not self._buffer.startswith(_MARK, start):
                raise MalformedMessageError("a message begins with something else than its mark")
            length = int.from_bytes(self._buffer[start + len(_MARK) : body], "big")
            if len(self._buffer) - body < length:
                break
            try:
                messages.append(self._decoder.decode(self._buffer[body : body + length]))
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
                raise MalformedMessageError(str(error)) from error
            start = body + length
        del self._buffer[:start]
        return messages


_encoder = msgspec.msgpack.Encoder()


def encode_message(message: ClientMessage | ServerMessage) -> bytes:
    """Return a message as bytes, mark and length included.

    Raises:
        MalformedMessageError: It is longer than `MESSAGE_LIMIT_BYTES`.
    """
    body = _encoder.encode(message)
    if len(body) > MESSAGE_LIMIT_BYTES:
        raise MalformedMessageError(f"{len(body)} bytes; allowed: {MESSAGE_LIMIT_BYTES}")
    return _MARK + len(body).to_bytes(2, "big") + body
