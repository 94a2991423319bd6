"""`make auv`: vehicle, modems and gateways in processes, and the console's page in this one."""

import asyncio
import contextlib
import tempfile
from pathlib import Path
from typing import Any

from nicegui import app, ui

from examples.auv.desk import Desk
from examples.auv.expedition import Expedition, expedition
from examples.auv.page import Page
from examples.auv.session import open_session
from examples.auv.shore import Shore
from examples.auv.zenohshore import ZenohShore
from zacoustic.errors import ZacousticError

_PERIOD_S = 0.2


def run_console(*, port: int, loss: float, ros: bool = False) -> None:
    """Serve the page until it is interrupted."""
    desk = Desk(Shore())
    stack = contextlib.AsyncExitStack()
    working: list[asyncio.Task[None]] = []

    async def work() -> None:
        try:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="zacoustic-auv-"))
            under_way = expedition(Path(folder), _ignore, loss=loss, ros=ros)
            running = await stack.enter_async_context(under_way)
            session = await asyncio.to_thread(open_session, running.shore_endpoint)
            stack.enter_context(session)
            await attend(desk, ZenohShore(session, desk.shore, ros=ros), running)
        except ZacousticError as error:
            desk.trouble = str(error)

    async def start() -> None:
        working.append(asyncio.create_task(work()))

    async def stop() -> None:
        for task in working:
            task.cancel()
        await asyncio.gather(*working, return_exceptions=True)
        await stack.aclose()

    def root() -> None:
        Page(desk)

    app.on_startup(start)
    app.on_shutdown(stop)
    print(f"the console is at http://127.0.0.1:{port}", flush=True)
    ui.run(root, host="127.0.0.1", port=port, reload=False, show=False, show_welcome_message=False)


async def attend(desk: Desk, carrier: ZenohShore, running: Expedition) -> None:
    """Carry words between the desk and Zenoh until a process dies.

    Raises:
        ZacousticError: One has.
    """
    desk.carrier, desk.cancel, desk.health = carrier, carrier.cancel_goal, carrier.health
    while not running.failed.done():
        carrier.drain(desk.now_s)
        desk.tick()
        await asyncio.sleep(_PERIOD_S)
    running.failed.result()


def _ignore(name: str, said: dict[str, Any]) -> None:
    """The page shows what Zenoh tells."""
