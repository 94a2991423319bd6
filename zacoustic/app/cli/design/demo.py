"""The verb `zacoustic run demo`: two local networks joined by a simulated channel."""

import argparse
import asyncio
import sys
from pathlib import Path
from typing import IO, TYPE_CHECKING

from zacoustic.app.cli.support.newfile import new_file
from zacoustic.app.cli.support.printing import print_text
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK, Command
from zacoustic.text.installing import with_extra

if TYPE_CHECKING:
    from zacoustic.app.tools.demo.views import View


class DemoCommand(Command):
    """Shows two networks joined by a simulated acoustic channel."""

    name = "demo"
    summary = "show it: two Zenoh networks joined through a simulated channel, in half a minute"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare duration, link and form of the output."""
        from zacoustic.app.tools.demo.media import MEDIA

        parser.add_argument(
            "--duration", type=float, metavar="S", help="how long the vehicle reports, 20..40 s"
        )
        parser.add_argument(
            "--link", choices=tuple(MEDIA), default=next(iter(MEDIA)),
            help="the channel: the simulator, emulated S2C modems on TCP ports "
            "(evologics) or on pseudo-terminals (evologics-serial), or a stand-in for DESERT "
            "(default: %(default)s)",
        )  # fmt: skip
        parser.add_argument("--json", action="store_true", help="one JSON object per line")
        parser.add_argument(
            "--plain", action="store_true", help="lines instead of the live view, as without a TTY"
        )
        parser.add_argument(
            "--screenshot", metavar="FILE", type=Path, help="save a picture of the live view as SVG"
        )
        parser.epilog = (
            "exits with 0 only if everything that should cross did\n\n"
            "examples:\n  zacoustic run demo\n  zacoustic run demo --link evologics"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Run it.

        Raises:
            ConfigError: The duration is out of range.
        """
        from zacoustic.app.tools.demo.media import MEDIA
        from zacoustic.app.tools.demo.mission import DURATION_S, LONGEST_S, SHORTEST_S, Mission

        duration_s = DURATION_S if arguments.duration is None else arguments.duration
        if not SHORTEST_S <= duration_s <= LONGEST_S:
            raise ConfigError(
                f"--duration {duration_s:g}; allowed: {SHORTEST_S:g}..{LONGEST_S:g} s"
            )
        medium = MEDIA[arguments.link]()
        with new_file("--screenshot", arguments.screenshot) as picture:
            view = _view(arguments, medium.title, picture)
            mission = Mission(view, medium, duration_s=duration_s)
            summary = asyncio.run(mission.run())
            if mission.is_interrupted:
                return EXIT_INTERRUPTED
            view.conclude(summary)
        return EXIT_OK if summary.ok else EXIT_FAILED


def _view(arguments: argparse.Namespace, title: str, picture: IO[bytes] | None) -> "View":
    from zacoustic.app.tools.demo.views import JsonView, LinesView

    if arguments.json:
        return JsonView()
    wants_picture = sys.stdout.isatty() or arguments.screenshot is not None
    if arguments.plain or not wants_picture:
        return LinesView()
    try:
        from zacoustic.app.tools.demo.live import LiveView
    except ModuleNotFoundError as error:
        if arguments.screenshot is not None or not (error.name or "").startswith("rich"):
            raise
        print_text(f"zacoustic run demo: plain lines; for the live view, {with_extra('terminal')}")
        return LinesView()
    return LiveView(title=title, screenshot=picture)
