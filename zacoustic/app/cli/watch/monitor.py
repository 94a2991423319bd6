"""The verb `zacoustic monitor`: gateways live on a terminal, or as lines of JSON."""

import argparse
import asyncio
import os
import sys
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.arguments import check_positive
from zacoustic.app.cli.support.printing import print_json
from zacoustic.app.cli.watch.topics import add_watch_arguments, chosen, make_watch
from zacoustic.link.command import EXIT_OK, Command
from zacoustic.link.serving import run_until_stopped

if TYPE_CHECKING:
    from rich.console import Console

    from zacoustic.app.tools.watch.views import GatewayView
    from zacoustic.app.tools.watch.watching import Watch

_PIPE_WIDTH = 120
"""Width of output to a file or a pipe, columns."""

_EXAMPLE = """It costs no airtime. Ctrl-C ends it.

examples:
  zacoustic monitor --connect tcp/127.0.0.1:7447
  zacoustic monitor --config router.json5 --once
  zacoustic monitor --node 2 --json --interval 10 --connect tcp/192.168.0.12:7447
"""


class MonitorCommand(Command):
    """Shows gateways live."""

    name = "monitor"
    summary = "watch gateways live: streams, rates, ages, queues, airtime, signal, errors"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare gateways, their network, period, and the form of the output."""
        parser.epilog = _EXAMPLE
        add_watch_arguments(parser)
        parser.add_argument("--once", action="store_true", help="what holds now, and end")
        parser.add_argument("--all", action="store_true", help="quiet streams as well")
        parser.add_argument(
            "--interval", type=float, default=1.0, metavar="S",
            help="time between two pictures, or lines of JSON, s (default: %(default)g)",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Show them until Ctrl-C, or once.

        Raises:
            SessionError: No router can be reached.
            DeliveryError: With --once, no gateway is there.
        """
        check_positive(arguments, "interval")
        if not arguments.json:
            import rich  # noqa: F401 (fails at once, not at the first drawing)
        run_until_stopped(lambda stop: _watch(arguments))
        return EXIT_OK


async def _watch(arguments: argparse.Namespace) -> None:
    async with make_watch(arguments) as watch:
        if arguments.once:
            _show_once(chosen(watch, arguments.node), arguments)
        elif arguments.json:
            await _print_lines(watch, arguments)
        else:
            await _draw(watch, arguments)


def _show_once(views: "list[GatewayView]", arguments: argparse.Namespace) -> None:
    if arguments.json:
        _print_json(views)
        return
    from zacoustic.app.tools.watch.terminal import picture

    _console().print(picture(views, is_complete=arguments.all))


async def _print_lines(watch: "Watch", arguments: argparse.Namespace) -> None:
    while True:
        _print_json(_wanted(watch, arguments))
        await asyncio.sleep(arguments.interval)


def _print_json(views: "list[GatewayView]") -> None:
    from zacoustic.app.tools.watch.views import told

    for view in views:
        print_json(told(view), flush=True)


async def _draw(watch: "Watch", arguments: argparse.Namespace) -> None:
    from zacoustic.app.tools.watch.terminal import Terminal, picture, waiting_picture

    where = ", ".join(arguments.connect or [arguments.config or "this network"])
    with Terminal(_console()) as terminal:
        while True:
            views = _wanted(watch, arguments)
            drawn = picture(views, is_complete=arguments.all) if views else waiting_picture(where)
            terminal.show(drawn)
            await asyncio.sleep(arguments.interval)


def _console() -> "Console":
    """Return a console; output that is no terminal has unlimited room."""
    from rich.console import Console

    has_width = sys.stdout.isatty() or "COLUMNS" in os.environ
    return Console(file=sys.stdout, width=None if has_width else _PIPE_WIDTH)


def _wanted(watch: "Watch", arguments: argparse.Namespace) -> "list[GatewayView]":
    return [view for view in watch.board.views() if arguments.node in (None, view.address)]
