"""A server for pages of our own, on a thread of its own: visitors do not delay the modem."""

import asyncio
import socket
import threading
from collections.abc import Collection
from functools import partial

import uvicorn
from uvicorn.server import ServerState

from zacoustic.run.inbox import tell_loop
from zacoustic.run.web.connections import Limits, lengthen_queue, uvicorn_options
from zacoustic.run.web.gatekeeper import Application, Gatekeeper, own_names


class Front:
    """Serves an ASGI application behind limits and gatekeeper.

    Args:
        application: Answers requests, on the server's thread.
        host: Host to listen at.
        port: Port to listen at; 0: any free one.
        names: Names under which visitors find it, besides this computer's own.
        hint: How a user adds a name.
        limits: What visitors may take.
    """

    def __init__(
        self,
        application: Application,
        host: str,
        port: int,
        *,
        names: Collection[str] = (),
        hint: str,
        limits: Limits | None = None,
    ) -> None:
        self._application = Gatekeeper(application, own_names(host, *names), hint=hint)
        self._limits = limits or Limits()
        self.host = host
        self.port = port
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop: asyncio.Event | None = None
        self._thread: threading.Thread | None = None

    async def open(self) -> None:
        """Begin to listen.

        Raises:
            OSError: It cannot listen there.
        """
        listening = await asyncio.to_thread(self._listen)
        self.port = listening.getsockname()[1]
        has_begun = threading.Event()
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve(listening, has_begun)), name="web", daemon=True
        )
        self._thread.start()
        await asyncio.to_thread(has_begun.wait)

    async def close(self) -> None:
        """Stop to listen, and end all connections. May be called again."""
        thread, self._thread = self._thread, None
        if thread is not None and self._loop is not None and self._stop is not None:
            tell_loop(self._loop, self._stop.set)
            await asyncio.to_thread(thread.join)

    def _listen(self) -> socket.socket:
        found = socket.getaddrinfo(
            self.host, self.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        family, _, _, _, address = found[0]
        return socket.create_server((str(address[0]), int(address[1])), family=family)

    async def _serve(self, listening: socket.socket, has_begun: threading.Event) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        options = uvicorn_options(self._limits)
        config = uvicorn.Config(
            self._application,
            interface="asgi3", lifespan="off", ws="none", log_config=None, log_level="error",
            **options,
        )  # fmt: skip
        config.load()
        state = ServerState()
        server = await self._loop.create_server(
            partial(options["http"], config=config, server_state=state, app_state={}),
            sock=listening,
            backlog=options["backlog"],
        )
        lengthen_queue(server)
        has_begun.set()
        await self._stop.wait()
        server.close()
        for connection in [*state.connections]:
            connection.transport.abort()
