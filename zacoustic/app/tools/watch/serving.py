"""The dashboard's server: one lookout, and a page for each browser."""

import asyncio
import socket
from collections.abc import Sequence

from zacoustic.app.tools.pages.webpage import serve_page
from zacoustic.app.tools.watch.lookout import Lookout
from zacoustic.app.tools.watch.page import Page
from zacoustic.link.serving import cannot_listen


def serve(lookout: Lookout, host: str, port: int, names: Sequence[str] = ()) -> None:
    """Serve the page until it is interrupted.

    Args:
        lookout: The data; runs as long as the server does.
        host: Host to listen at.
        port: Port to listen at.
        names: Names under which browsers find it, besides this computer's own.
    """
    working: list[asyncio.Task[None]] = []

    async def start() -> None:
        working.append(asyncio.create_task(lookout.run()))

    async def stop() -> None:
        for task in working:
            task.cancel()
        await asyncio.gather(*working, return_exceptions=True)

    def root() -> None:
        Page(lookout)

    serve_page(root, host=host, port=port, start=start, stop=stop, names=names, title="zacoustic")


def free_place(host: str, port: int) -> int:
    """Return the port to listen at: a free one for 0.

    Raises:
        LinkOpenError: The port cannot be used.
    """
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        with socket.create_server((host, port), family=family) as probe:
            return int(probe.getsockname()[1])
    except OSError as error:
        raise cannot_listen(host, port, error, rival="another dashboard") from error
