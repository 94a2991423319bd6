"""A TCP proxy between a link and its device that can cut the line and send nonsense on it."""

import asyncio

from zacoustic.errors import LinkOpenError


class StreamProxy:
    """Passes bytes between its clients and a target, with one connection for each client.

    Args:
        host: Host at which the target listens.
        port: Its port.
    """

    def __init__(self, host: str, port: int) -> None:
        self._target = (host, port)
        self._server: asyncio.Server | None = None
        self._lines: set[_Line] = set()
        self._connected = asyncio.Event()
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def address(self) -> str:
        """`HOST:PORT` at which the proxy listens.

        Raises:
            LinkOpenError: The proxy does not listen.
        """
        if self._server is None:
            raise LinkOpenError("the proxy is not open")
        host, port = self._server.sockets[0].getsockname()[:2]
        return f"{host}:{port}"

    async def open(self) -> None:
        """Listen at 127.0.0.1, at any free port."""
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)

    async def close(self) -> None:
        """Cut all lines and stop listening. May be called again."""
        server, self._server = self._server, None
        if server is not None:
            server.close()
        self.cut()
        while self._tasks:
            await asyncio.wait(tuple(self._tasks))
        if server is not None:
            await server.wait_closed()

    async def wait_connected(self) -> None:
        """Wait until a client is connected to the target, so that `cut` and `inject` reach it.

        A TCP client may believe that earlier, because the kernel accepts the connection.
        """
        await self._connected.wait()

    def cut(self) -> None:
        """Cut all lines; clients may reconnect."""
        for line in tuple(self._lines):
            line.cut()
            self._remove(line)

    def inject(self, nonsense: bytes) -> None:
        """Send these bytes to all clients as if the target had."""
        for line in tuple(self._lines):
            line.to_client.write(nonsense)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        try:
            there_reader, there_writer = await asyncio.open_connection(*self._target)
        except OSError:
            writer.transport.abort()
            self._tasks.discard(task)
            return
        line = _Line(writer, there_writer)
        self._lines.add(line)
        self._connected.set()
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(line.pass_on(reader, there_writer))
                group.create_task(line.pass_on(there_reader, writer))
        finally:
            self._remove(line)
            self._tasks.discard(task)

    def _remove(self, line: "_Line") -> None:
        self._lines.discard(line)
        if not self._lines:
            self._connected.clear()


class _Line:
    """One client and its connection to the target."""

    def __init__(self, to_client: asyncio.StreamWriter, to_target: asyncio.StreamWriter) -> None:
        self.to_client = to_client
        self.to_target = to_target

    async def pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Pass bytes on in one direction; if it ends, the other one ends, too."""
        try:
            while data := await reader.read(65_536):
                writer.write(data)
                await writer.drain()
        except ConnectionError:
            pass
        finally:
            self.cut()

    def cut(self) -> None:
        self.to_client.transport.abort()
        self.to_target.transport.abort()
