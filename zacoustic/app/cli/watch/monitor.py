"""The verb `zacoustic monitor`: gateways live on a terminal, or as lines of JSON."""

import asyncio
import os
import sys
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.printing import print_json
from zacoustic.app.cli.support.rows import flag, seconds
from zacoustic.app.cli.watch.watcher import Watcher

if TYPE_CHECKING:
    from rich.console import Console

    from zacoustic.app.tools.watch.views import GatewayView
    from zacoustic.app.tools.watch.watching import Watch

_PIPE_WIDTH = 120
"""Width of output to a file or a pipe, columns."""


class Monitor(Watcher):
    """Watch gateways live: streams, rates, ages, queues, airtime, signal, errors.

    It costs no airtime. Ctrl-C ends it.

    Examples:
      zacoustic monitor --connect tcp/127.0.0.1:7447
      zacoustic monitor --config router.json5 --once
      zacoustic monitor --node 2 --json --interval 10 --connect tcp/192.168.0.12:7447
    """

    prints_late = False
    runs_on = True

    once: bool = flag("what holds now, and end")
    all: bool = flag("quiet streams as well")
    interval: float = seconds("time between two pictures, or lines of JSON, s", 1.0)

    async def work(self) -> None:
        """Show them until Ctrl-C, or once.

        Raises:
            SessionError: No router can be reached.
            DeliveryError: With --once, no gateway is there.
        """
        if not self.json:
            import rich  # noqa: F401 (fails at once, not at the first drawing)
        async with self.watch() as watch:
            if self.once:
                self._show_once(self.chosen(watch))
            elif self.json:
                while True:
                    _print_json(self.wanted(watch))
                    await asyncio.sleep(self.interval)
            else:
                await self._draw(watch)

    def _show_once(self, views: "list[GatewayView]") -> None:
        if self.json:
            _print_json(views)
            return
        from zacoustic.app.tools.watch.terminal import picture

        _console().print(picture(views, is_complete=self.all))

    async def _draw(self, watch: "Watch") -> None:
        from zacoustic.app.tools.watch.terminal import Terminal, picture, waiting_picture

        where = ", ".join(self.connect or [self.config or "this network"])
        with Terminal(_console()) as terminal:
            while True:
                views = self.wanted(watch)
                drawn = picture(views, is_complete=self.all) if views else waiting_picture(where)
                terminal.show(drawn)
                await asyncio.sleep(self.interval)


def _print_json(views: "list[GatewayView]") -> None:
    from zacoustic.app.tools.watch.views import told

    for view in views:
        print_json(told(view), flush=True)


def _console() -> "Console":
    """Return a console; output that is no terminal has unlimited room."""
    from rich.console import Console

    has_width = sys.stdout.isatty() or "COLUMNS" in os.environ
    return Console(file=sys.stdout, width=None if has_width else _PIPE_WIDTH)
