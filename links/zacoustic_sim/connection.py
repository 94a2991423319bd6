"""A simulated modem's connection to the medium: over TCP here, in one process in `medium`."""

import time
from typing import Final, Protocol

from zacoustic.bytestream import ByteStream
from zacoustic.core.clock import Clock
from zacoustic_sim.messages import (
    VERSION,
    Hello,
    MalformedMessageError,
    MessageDecoder,
    ServerMessage,
    Transmit,
    encode_message,
)

START_HINT: Final = "start it: zacoustic run medium SCENARIO --listen {address}"
"""Hint when nothing listens at `address`."""


class ConnectionReceiver(Protocol):
    """Takes the events of a connection; called only on the loop, never from within a call to it."""

    def message_received(self, message: ServerMessage, received_at: int) -> None:
        """Take a message of the medium, read at `received_at`, ns."""
        ...

    def connection_lost(self, reason: str) -> None:
        """Note that the medium was lost or not reached; the connection keeps trying."""
        ...


class Connection(Protocol):
    """A connection to the medium; it sends `Hello` by itself, again after each loss."""

    address: str
    """Place of the medium, for messages to people."""
    hint: str
    """What to do if it is not there."""

    def open(self, receiver: ConnectionReceiver) -> None:
        """Start connecting; returns at once."""
        ...

    def send(self, message: Transmit) -> bool:
        """Send a message; return whether it could be sent."""
        ...

    async def close(self) -> None:
        """Stop; no callback follows. May be called again."""
        ...


class StreamConnection:
    """A connection to a medium in another process.

    Args:
        address: `HOST:PORT`.
        node_address: Acoustic address to ask for.
        clock: Source of instants.

    Raises:
        ConfigError: The address is not valid.
    """

    def __init__(
        self, address: str, *, node_address: int, clock: Clock = time.monotonic_ns
    ) -> None:
        self.address = address
        self.hint = START_HINT.format(address=address)
        self._stream = ByteStream(f"tcp:{address}", clock=clock)
        self._node_address = node_address
        self._receiver: ConnectionReceiver | None = None
        self._decoder = MessageDecoder[ServerMessage](ServerMessage)

    def open(self, receiver: ConnectionReceiver) -> None:
        """Start to connect."""
        self._receiver = receiver
        self._stream.open(self)

    def send(self, message: Transmit) -> bool:
        """Send a message, if connected."""
        return self._stream.write(encode_message(message))

    async def close(self) -> None:
        """Close the stream."""
        self._receiver = None
        await self._stream.close()

    def stream_opened(self) -> None:
        """Ask for the node's place; called by the stream."""
        self._decoder = MessageDecoder[ServerMessage](ServerMessage)
        self._stream.write(encode_message(Hello(VERSION, self._node_address)))

    def bytes_received(self, data: bytes, received_at: int) -> None:
        """Read messages; called by the stream."""
        try:
            messages = self._decoder.feed(data)
        except MalformedMessageError as error:
            self._stream.reset(f"this is no medium: {error}")
            return
        for message in messages:
            if self._receiver is not None:
                self._receiver.message_received(message, received_at)

    def stream_lost(self, reason: str) -> None:
        """Pass the loss on; called by the stream."""
        if self._receiver is not None:
            self._receiver.connection_lost(reason.removeprefix(f"tcp:{self.address}: "))
