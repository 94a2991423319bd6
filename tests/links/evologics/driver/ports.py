"""The scripted modem behind a real port: a TCP server, or a pseudo-terminal."""

import asyncio
import contextlib
import os
import time
import tty

from tests.links.evologics.driver.bench import ScriptedModem


class TcpModem:
    """A scripted modem on a TCP port."""

    def __init__(self, modem: ScriptedModem) -> None:
        self.modem = modem
        self.port = 0
        self.writers: set[asyncio.StreamWriter] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._server: asyncio.Server | None = None

    @property
    def address(self) -> str:
        return f"tcp:127.0.0.1:{self.port}"

    async def open(self) -> None:
        loop = asyncio.get_running_loop()
        self.modem.schedule = lambda after_s, act: (loop.call_later(after_s, act), None)[1]
        self.modem.write = self._write
        self.modem.instant = time.monotonic_ns
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    def cut(self) -> None:
        for writer in tuple(self.writers):
            writer.transport.abort()

    async def close(self) -> None:
        assert self._server is not None
        self._server.close()
        self.cut()
        while self._tasks:
            await asyncio.wait(tuple(self._tasks))
        await self._server.wait_closed()

    def _write(self, raw: bytes) -> None:
        for writer in self.writers:
            writer.write(raw)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        self.writers.add(writer)
        try:
            with contextlib.suppress(ConnectionError):
                while data := await reader.read(65_536):
                    self.modem.feed(data)
        finally:
            writer.transport.abort()
            self.writers.discard(writer)
            self._tasks.discard(task)


class SerialModem:
    """A scripted modem on a pseudo-terminal."""

    def __init__(self, modem: ScriptedModem) -> None:
        self.modem = modem
        self.path = ""
        self._ours = self._theirs = -1

    @property
    def address(self) -> str:
        return f"serial:{self.path}"

    async def open(self) -> None:
        loop = asyncio.get_running_loop()
        self.modem.schedule = lambda after_s, act: (loop.call_later(after_s, act), None)[1]
        self.modem.write = self._write
        self.modem.instant = time.monotonic_ns
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.path = os.ttyname(self._theirs)
        os.set_blocking(self._ours, False)
        loop.add_reader(self._ours, self._read)

    def unplug(self) -> None:
        asyncio.get_running_loop().remove_reader(self._ours)
        os.close(self._ours)
        os.close(self._theirs)
        self._ours = self._theirs = -1

    async def close(self) -> None:
        if self._ours >= 0:
            self.unplug()

    def _write(self, raw: bytes) -> None:
        if self._ours >= 0:
            os.write(self._ours, raw)

    def _read(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self.modem.feed(os.read(self._ours, 65_536))
