"""A web page, served until it is interrupted. Needs nicegui, the extra `console`.

NiceGUI and uvicorn serve it, with the limits and the gatekeeper of `zacoustic.run.web`. This module
changes three things, since a console and a screen on the bridge run for days, and people read their
standard error:

- A browser that leaves before its answer has begun causes no error. Starlette raises one if a
  middleware waits for the answer, and so does Engine.IO, both with a traceback.
- A client that does not speak HTTP, such as a Zenoh node that looks for its router, causes no
  warning.
- The first interrupt ends everything in order; further ones are ignored. Uvicorn would raise the
  signal again at the end, and not wait after a second one.
"""

import asyncio
import math
import signal
import time
from collections.abc import Awaitable, Callable, Collection, Iterable
from types import FrameType
from typing import Any, Final

from nicegui import app, background_tasks, ui
from nicegui.events import GenericEventArguments
from nicegui.server import Server

from zacoustic.app.tools.pages.truth import SCRIPT, STYLE, Alarm, beat_html
from zacoustic.app.tools.pages.visitors import Visitors
from zacoustic.run.web.connections import lengthen_queue, uvicorn_options
from zacoustic.run.web.gatekeeper import Gatekeeper, own_names

CURRENT_S: Final = 4.0
"""Clicks older than this are ignored, s."""
_BEATS_KEPT: Final = 64
_TRIES: Final = 1200
# NiceGUI gives its pages no language, and its loading bar no name: screen readers want both.
_FOR_READERS: Final = """
document.documentElement.lang = "en";
addEventListener("DOMContentLoaded", () => {
  const name = () => document.querySelectorAll(".q-loading-bar:not([aria-label])")
    .forEach((bar) => bar.setAttribute("aria-label", "loading"));
  new MutationObserver(name).observe(document.body, { childList: true });
  name();
});
"""

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


def serve_page(
    root: Callable[[], None],
    *,
    host: str,
    port: int,
    start: Callable[[], Awaitable[None]],
    stop: Callable[[], Awaitable[None]],
    names: Collection[str] = (),
    **look: Any,  # noqa: ANN401 (options of NiceGUI)
) -> None:
    """Serve a page until SIGINT or SIGTERM.

    Args:
        root: Builds the page for each browser.
        host: Host to listen at.
        port: Port to listen at.
        start: Awaited on the loop before the first visitor is served.
        stop: Awaited on the loop after the last one.
        names: Names under which browsers find it, besides this computer's own (`gatekeeper`).
        look: Further arguments of `ui.run`.
    """

    async def begin() -> None:
        for number in _SIGNALS:
            signal.signal(number, _interrupted)
        stack = app.middleware_stack
        assert stack is not None
        app.middleware_stack = Gatekeeper(Visitors(stack), own_names(host, *names))
        background_tasks.create(_lengthen_queues())
        await start()

    app.on_startup(begin)
    app.on_shutdown(stop)
    ui.run(
        root,
        host=host,
        port=port,
        reload=False,
        show=False,
        show_welcome_message=False,
        uvicorn_logging_level="error",
        **uvicorn_options(),
        **look,
    )
    for number in _SIGNALS:  # nothing remains to be interrupted
        signal.signal(number, signal.SIG_IGN)


class Banner:
    """The banner of one page with its failures (`truth`); made with the page.

    Args:
        what: Beginning of its text when the page's server is gone.
    """

    def __init__(self, what: str) -> None:
        ui.add_css(STYLE)
        ui.add_body_html(f"<script>{SCRIPT}</script>")
        ui.add_head_html(f"<script>{_FOR_READERS}</script>")
        self._what = what
        self._number = 0
        self._sent_at_s: dict[int, float] = {}
        self._echoed: int | None = None
        ui.on("za-echo", self._hear)
        self._element = ui.html(sanitize=False).style("display: none").mark("beat")

    def beat(self, alarm: Alarm | None = None, *, taken: Iterable[str] = ()) -> None:
        """Show that the server runs; call it at least every second.

        Args:
            alarm: A known failure; None: none.
            taken: Ids of the newest commands that were accepted, without spaces.
        """
        self._number += 1
        self._sent_at_s[self._number] = time.monotonic()
        self._sent_at_s.pop(self._number - _BEATS_KEPT, None)
        self._element.set_content(beat_html(self._number, alarm, what=self._what, taken=taken))

    def is_current(self) -> bool:
        """Tell whether the browser's input is recent.

        A click made while the connection hung arrives when it is back, perhaps minutes later. The
        browser echoes each heartbeat, so input after an old echo is old.
        """
        if self._echoed is None:
            return True
        sent_at_s = self._sent_at_s.get(self._echoed, -math.inf)
        return time.monotonic() - sent_at_s < CURRENT_S

    def _hear(self, event: GenericEventArguments) -> None:
        if isinstance(event.args, int):
            self._echoed = event.args


async def _lengthen_queues() -> None:
    """Lengthen the queues of uvicorn, which opens them after the application has begun."""
    running = Server.instance
    for _ in range(_TRIES):
        if running.started:
            for server in running.servers:
                lengthen_queue(server)
            return
        await asyncio.sleep(0.05)


def _interrupted(number: int, _: FrameType | None) -> None:
    """End everything, in order; at most some seconds."""
    app.shutdown()
