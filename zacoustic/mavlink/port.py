"""Where MAVLink packets come from and go to: UDP, TCP or a serial port.

The words are those of MAVLink tools: `udpin:HOST:PORT` listens, `udpout:HOST:PORT` sends there
and reads what comes back, `tcp:HOST:PORT` and `serial:PORT` connect, and reconnect for ever.

At `udpin` anybody may send. The first one that says what the other end would say is the peer, until
it has been silent for some seconds; all others are ignored meanwhile.
"""

import asyncio
import socket
import time
from collections.abc import Callable
from typing import Any, Final

from zacoustic.core.base.clock import Clock, seconds_to_ns
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.link.bytestream import ByteStream
from zacoustic.link.serving import cannot_listen, place_name

ALLOWED: Final = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:PORT"
"""Places that there are."""
BAUDRATE: Final = 57_600
"""Usual speed of a telemetry port of an autopilot, baud."""
PEER_SILENCE_NS: Final = seconds_to_ns(5.0)
"""A peer at `udpin` is gone after this time without a datagram: five heartbeats."""

Receive = Callable[[bytes, int], None]
"""Takes received bytes and the instant, ns."""
Accept = Callable[[bytes], bool]
"""Takes a datagram of somebody else than the peer; returns whether it is of the other end."""
Tell = Callable[[str, str, bool], None]
"""Takes the event, the text and whether it is trouble, for people."""


class Port:
    """An open place; on a loop.

    Args:
        place: The text of the user.
        receive: Takes what arrives.
        accept: Says who may become the peer at `udpin`.
        tell: Takes what people should know.
        baudrate: Of a serial port.
        clock: Source of instants.

    Raises:
        ConfigError: There is no such place.
    """

    def __init__(
        self,
        place: str,
        *,
        receive: Receive,
        accept: Accept,
        tell: Tell,
        baudrate: int = BAUDRATE,
        clock: Clock = time.monotonic_ns,
    ) -> None:
        self.place = place
        self._receive = receive
        self._accept = accept
        self._tell = tell
        self._clock = clock
        self._stream: ByteStream | None = None
        self._transport: asyncio.DatagramTransport | None = None
        self._peer: Any = None
        self._peer_at = 0
        self._has_others = False
        kind, _, rest = place.partition(":")
        if kind in ("udpin", "udpout"):
            self._kind, self._host_port = kind, _host_port(place, rest)
        elif kind in ("tcp", "serial"):
            self._stream = ByteStream(place, baudrate=baudrate, clock=clock)
        else:
            raise ConfigError(f"--mavlink {place!r}; allowed: {ALLOWED}")

    async def open(self) -> None:
        """Open the place.

        Raises:
            LinkOpenError: Another program has the UDP port, or there is no such host.
        """
        if self._stream is not None:
            self._stream.open(_Streamed(self._receive, self._tell))
            return
        host, port = self._host_port
        loop = asyncio.get_running_loop()
        is_listening = self._kind == "udpin"
        try:
            self._transport, _ = await loop.create_datagram_endpoint(
                lambda: _Datagrams(self._take),
                local_addr=(host, port) if is_listening else None,
                remote_addr=None if is_listening else (host, port),
            )
        except OSError as error:
            if self._kind == "udpin":
                raise cannot_listen(host, port, error, rival="another program") from error
            reason = error.strerror or str(error)
            raise LinkOpenError(f"--mavlink {self.place}: {reason}") from error

    def write(self, packet: bytes) -> None:
        """Send a packet; without a connection, or without a peer yet, it is lost."""
        if self._stream is not None:
            self._stream.write(packet)
        elif self._transport is not None and (self._kind == "udpout" or self._peer is not None):
            self._transport.sendto(packet, self._peer)

    async def close(self) -> None:
        """Close the place. May be called again."""
        if self._stream is not None:
            await self._stream.close()
        elif self._transport is not None:
            self._transport.close()
            self._transport = None

    @property
    def has_datagrams(self) -> bool:
        """Whether received bytes come as whole packets."""
        return self._stream is None

    @property
    def name(self) -> str:
        """The place, with the port that the system has chosen for port 0."""
        if self._transport is None or self._kind == "udpout":
            return self.place
        host, port = self._transport.get_extra_info("socket").getsockname()[:2]
        return f"udpin:{place_name(host, port)}"

    def _take(self, data: bytes, sender: Any) -> None:  # noqa: ANN401 (of the system)
        now = self._clock()
        if self._kind == "udpout" or self._is_of_peer(data, sender, now):
            self._receive(data, now)

    def _is_of_peer(self, data: bytes, sender: Any, now: int) -> bool:  # noqa: ANN401
        if sender != self._peer:
            if self._peer is not None and now - self._peer_at < PEER_SILENCE_NS:
                if not self._has_others:
                    self._has_others = True
                    places = (place_name(*each[:2]) for each in (sender, self._peer))
                    self._tell("other", "{} is ignored: {} is the peer".format(*places), True)
                return False
            if not self._accept(data):
                return False
            self._peer, self._has_others = sender, False
            self._tell("peer", place_name(*sender[:2]), False)
        self._peer_at = now
        return True


class _Datagrams(asyncio.DatagramProtocol):
    """Passes datagrams on; that nobody listens at the other end is no error."""

    def __init__(self, take: Callable[[bytes, Any], None]) -> None:
        self._take = take

    def datagram_received(self, data: bytes, addr: Any) -> None:  # noqa: ANN401 (of the base)
        self._take(data, addr)


class _Streamed:
    """Passes on what a byte stream says."""

    def __init__(self, receive: Receive, tell: Tell) -> None:
        self._receive = receive
        self._tell = tell
        self._is_lost = False

    def stream_opened(self) -> None:
        if self._is_lost:
            self._tell("mavlink", "connected", False)
        self._is_lost = False

    def bytes_received(self, data: bytes, received_at: int) -> None:
        self._receive(data, received_at)

    def stream_lost(self, reason: str) -> None:
        if not self._is_lost:
            self._tell("mavlink_lost", reason, True)
        self._is_lost = True


def _host_port(place: str, rest: str) -> tuple[str, int]:
    host, _, port = rest.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not (host and port.isascii() and port.isdigit() and int(port) <= 65_535):
        raise ConfigError(f"--mavlink {place!r}; allowed: {ALLOWED}, port 0..65535")
    try:
        socket.getaddrinfo(host, int(port), type=socket.SOCK_DGRAM)
    except OSError as error:
        raise ConfigError(f"--mavlink {place!r}: {error.strerror or error}") from error
    return host, int(port)
