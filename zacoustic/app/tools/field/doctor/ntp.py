"""The error of this computer's clock, by a time server (SNTP, RFC 4330)."""

import asyncio
import struct
import time
from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec

from zacoustic.errors import ConfigError
from zacoustic.text.digits import whole_number

_PORT: Final = 123
_UNIX_AT_S: Final = 2_208_988_800
"""1970 on a clock that begins in 1900, s."""
_CLIENT: Final = bytes((0x23,)) + bytes(47)
_ATTEMPTS: Final = 3
_PATIENCE_S: Final = 1.0


class Offset(msgspec.Struct, frozen=True, kw_only=True):
    """The error of the clock."""

    server: str
    """The time server."""
    offset_s: float
    """Our clock less the server's, s."""
    error_s: float
    """Uncertainty of that, s: half of the round-trip time."""


async def ask_time(server: str, clock: Callable[[], float] = time.time) -> Offset | None:
    """Query a server; None: it does not answer.

    Args:
        server: `HOST` or `HOST:PORT`.
        clock: The examined clock, s since 1970.

    Raises:
        ConfigError: The server is not valid.
    """
    host, colon, port = server.rpartition(":")
    number = whole_number(port) if colon else _PORT
    if number is None:
        raise ConfigError(f"--ntp {server}; allowed: HOST or HOST:PORT")
    place = (host if colon else server, number)
    loop = asyncio.get_running_loop()
    for _ in range(_ATTEMPTS):
        answered: asyncio.Future[bytes] = loop.create_future()
        try:
            transport, _protocol = await loop.create_datagram_endpoint(
                partial(_Client, answered), remote_addr=place
            )
        except OSError:
            return None
        try:
            sent_s = clock()
            transport.sendto(_CLIENT)
            async with asyncio.timeout(_PATIENCE_S):
                packet = await answered
            return _offset(server, packet, sent_s, clock())
        except (TimeoutError, OSError):
            continue
        finally:
            transport.close()
    return None


def _offset(server: str, packet: bytes, sent_s: float, received_s: float) -> Offset | None:
    if len(packet) < len(_CLIENT):
        return None
    arrived_s, answered_s = (_seconds(packet, at) for at in (32, 40))
    ahead_s = ((sent_s - arrived_s) + (received_s - answered_s)) / 2
    error_s = max(0.0, (received_s - sent_s) - (answered_s - arrived_s)) / 2
    return Offset(server=server, offset_s=ahead_s, error_s=error_s)


def _seconds(packet: bytes, at: int) -> float:
    whole, fraction = struct.unpack_from(">II", packet, at)
    return float(whole - _UNIX_AT_S + fraction / 2**32)


class _Client(asyncio.DatagramProtocol):
    def __init__(self, answered: asyncio.Future[bytes]) -> None:
        self._answered = answered

    def datagram_received(self, data: bytes, addr: object) -> None:
        if not self._answered.done():
            self._answered.set_result(data)

    def error_received(self, exc: Exception) -> None:
        if not self._answered.done():
            self._answered.set_exception(exc)
