"""The link of the shore: messages of one modem by DirectIP, both ways.

The gateway connects here for each message of the modem, and tries again if it is not accepted; what
comes again has the same number, and is handed on once. Anybody may connect: a message counts only
with the modem's number, and on a sealed fleet only with a seal. A message for the modem waits at
the gateway until the modem looks.
"""

import asyncio
import contextlib
import logging
import time
from collections import OrderedDict
from typing import Final

from zacoustic.core.clock import Clock
from zacoustic.core.linktypes import LinkState, TransmitOutcome
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.link import LinkReceiver
from zacoustic_iridium.config import IridiumConfig
from zacoustic_iridium.directip import (
    HEAD_BYTES,
    Confirmed,
    ForModem,
    FromModem,
    Message,
    decode,
    encode,
    whole_bytes,
)
from zacoustic_iridium.link import IridiumLink

_LIMIT_S: Final = 20.0
_MOST_KNOWN: Final = 256
_WHOLE: Final = range(3)
_logger = logging.getLogger(__name__)


class ShoreLink(IridiumLink):
    """DirectIP, to and from one modem.

    Args:
        name: `directip:HOST:PORT`, where the gateway connects to.
        config: The settings; with `gateway` and `imei`.
        clock: Source of instants.

    Raises:
        ConfigError: An address is not valid, a setting is missing, or there is no budget.
    """

    def __init__(
        self, name: str, config: IridiumConfig, *, clock: Clock = time.monotonic_ns
    ) -> None:
        super().__init__(name, config, clock=clock)
        self._here = _place(name.partition(":")[2], f"iridium/{name}")
        self._gateway = _place(config.gateway, "gateway")
        if not (len(config.imei) == 15 and config.imei.isdigit()):
            raise ConfigError(f"imei is {config.imei!r}; allowed: 15 digits, those of the modem")
        self._server: asyncio.Server | None = None
        self._sending: asyncio.Task[None] | None = None
        self._serving: set[asyncio.Task[None]] = set()
        self._known: OrderedDict[int, None] = OrderedDict()
        self._client_id = 0

    async def open(self, receiver: LinkReceiver) -> None:
        """Listen for the gateway.

        Raises:
            LinkOpenError: The port is in use, or not of this machine.
        """
        await super().open(receiver)
        try:
            self._server = await asyncio.start_server(self._accept, *self._here)
        except OSError as error:
            self._receiver = None
            raise LinkOpenError(f"iridium/{self._name}: {error.strerror or error}") from error
        self._change_state(LinkState.UP, f"listens for the gateway at {self._name}")

    async def close(self) -> None:
        """Release the port; report an outstanding frame as ABORTED."""
        await super().close()
        tasks = [*self._serving, *([self._sending] if self._sending is not None else [])]
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()
            self._server = None

    @property
    def port(self) -> int:
        """Port at which it listens, for tests that let the system choose."""
        assert self._server is not None
        return int(self._server.sockets[0].getsockname()[1])

    def _begin(self, frame_bytes: bytes, now: int) -> None:
        self._client_id += 1
        message = ForModem(self._config.imei, self._client_id, frame_bytes)
        self._sending = asyncio.get_running_loop().create_task(self._send(message))

    def _soon(self) -> None:
        asyncio.get_running_loop().call_soon(self._flush)

    async def _send(self, message: ForModem) -> None:
        """Give a message to the gateway, and report."""
        outcome, detail = TransmitOutcome.ABORTED, ""
        try:
            async with asyncio.timeout(_LIMIT_S):
                answer = await self._exchange(message)
            if isinstance(answer, Confirmed) and answer.status > 0:
                outcome = TransmitOutcome.SENT
                self._budget.spend(len(message.data), self._clock())
            else:
                outcome, detail = TransmitOutcome.REJECTED, f"the gateway says {answer}"
        except (OSError, EOFError) as error:  # a TimeoutError is an OSError
            detail = f"the gateway at {self._config.gateway}: {error or 'no answer'}"
        self._finish(outcome, detail)

    async def _exchange(self, message: Message) -> Message | None:
        reader, writer = await asyncio.open_connection(*self._gateway)
        try:
            writer.write(encode(message))
            return await _read(reader)
        finally:
            writer.close()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._serving.add(task)
        try:
            async with asyncio.timeout(_LIMIT_S):
                message = await _read(reader)
            self._take(message)
        except (OSError, EOFError) as error:
            _logger.debug("iridium/%s: %s", self._name, error)
        finally:
            self._serving.discard(task)
            with contextlib.suppress(OSError):
                writer.close()

    def _take(self, message: Message | None) -> None:
        if not isinstance(message, FromModem) or message.imei != self._config.imei:
            self._counts["failed"] += 1
            return
        if message.number in self._known or message.status not in _WHOLE:
            return
        self._known[message.number] = None
        if len(self._known) > _MOST_KNOWN:
            self._known.popitem(last=False)
        if message.data:
            self._hear(message.data, self._clock())


async def _read(reader: asyncio.StreamReader) -> Message | None:
    """Read a message; None: it is not one of DirectIP.

    Raises:
        EOFError: The other side has closed before its end.
    """
    head = await reader.readexactly(HEAD_BYTES)
    size_bytes = whole_bytes(head)
    if size_bytes is None:
        return None
    return decode(head + await reader.readexactly(size_bytes - HEAD_BYTES))


def _place(written: str, name: str) -> tuple[str, int]:
    host, colon, port = written.rpartition(":")
    if not (colon and host and port.isascii() and port.isdigit() and int(port) <= 65_535):
        raise ConfigError(f"{name} is {written!r}; allowed: HOST:PORT")
    return host.removeprefix("[").removesuffix("]"), int(port)
