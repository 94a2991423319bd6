"""`make auv`: vehicle, modems and gateways in processes, and the console's page in this one."""

import asyncio
import contextlib
import socket
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

from examples.auv.controlstation import ControlStation
from examples.auv.expedition import Expedition, expedition
from examples.auv.page import Page
from examples.auv.session import open_session
from examples.auv.shore import Shore
from examples.auv.zenohshore import ZenohShore
from zacoustic import ZacousticError
from zacoustic.console import one_line, serve_page

_HOST: Final = "127.0.0.1"
_PERIOD_S: Final = 0.2
# Messages that NiceGUI keeps for a browser that comes back; one that was away longer reloads.
_HISTORY: Final = 60


def run_console(*, port: int, loss: float, ros: bool = False) -> int:
    """Serve the page until it is interrupted; returns the exit code."""
    if (trouble := _why_not(port)) is not None:
        sys.stderr.write(f"{trouble}\n")
        return 1
    station = ControlStation(Shore())
    stack = contextlib.AsyncExitStack()
    working: list[asyncio.Task[None]] = []

    async def work() -> None:
        try:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="zacoustic-auv-"))
            under_way = expedition(Path(folder), _ignore, loss=loss, ros=ros)
            running = await stack.enter_async_context(under_way)
            session = await asyncio.to_thread(open_session, running.shore_endpoint)
            stack.enter_context(session)
            print("the vehicle is in the water", flush=True)
            await attend(
                station, ZenohShore(session, station.shore, station.watch, ros=ros), running
            )
        except ZacousticError as error:
            _note_trouble(station, error)

    async def start() -> None:
        working.append(asyncio.create_task(work()))
        print(f"the console is at http://{_HOST}:{port}; Ctrl+C ends everything", flush=True)

    async def stop() -> None:
        for task in working:
            task.cancel()
        await asyncio.gather(*working, return_exceptions=True)
        await stack.aclose()

    def root() -> None:
        Page(station)

    serve_page(
        root,
        host=_HOST,
        port=port,
        start=start,
        stop=stop,
        dark=True,
        message_history_length=_HISTORY,
    )
    print("stopped", flush=True)
    return 1 if station.trouble else 0


async def attend(station: ControlStation, carrier: ZenohShore, running: Expedition) -> None:
    """Carry words between the station and Zenoh, until it is cancelled.

    Also when a process has died: the page must stay true about the others.
    """
    station.carrier, station.cancel = carrier, carrier.cancel_goal
    station.watch.answered_at_s = station.now_s
    while True:
        carrier.ask_gateway()
        carrier.drain(station.now_s)
        station.tick()
        if running.failed.done() and not station.trouble:
            _note_trouble(station, running.failed.exception())
        await asyncio.sleep(_PERIOD_S)


def _note_trouble(station: ControlStation, error: BaseException | None) -> None:
    station.trouble = one_line(error)
    sys.stderr.write(f"{station.trouble}\n")


def _why_not(port: int) -> str | None:
    """Say why nothing can listen at a port; None: it can."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((_HOST, port))
        except OSError as error:
            reason = error.strerror or str(error)
            return f"--port {port}: {reason}; name another one, as --port {port + 1}"
    return None


def _ignore(name: str, said: dict[str, Any]) -> None:
    """The page shows what Zenoh delivers."""
