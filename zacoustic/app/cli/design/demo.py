"""The verb `zacoustic run demo`: two local networks joined by a simulated channel."""

import asyncio
import sys
from pathlib import Path
from typing import IO, TYPE_CHECKING

from zacoustic.app.cli.support.newfile import new_file
from zacoustic.app.cli.support.printing import print_text
from zacoustic.app.cli.support.rows import OBJECT_PER_LINE, check_within, flag, option
from zacoustic.app.cli.support.verb import Verb
from zacoustic.app.tools.demo.media import MEDIA
from zacoustic.link.command import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK
from zacoustic.text.installing import with_extra

if TYPE_CHECKING:
    from zacoustic.app.tools.demo.views import View


class Demo(Verb):
    """Show it: two Zenoh networks joined through a simulated channel, in half a minute.

    exits with 0 only if everything that should cross did

    Examples:
      zacoustic run demo
      zacoustic run demo --link evologics
    """

    prints_late = False

    duration: float | None = option("S", "how long the vehicle reports, 20..40 s", type=float)
    link: str = option(
        None,
        "the channel: the simulator, emulated S2C modems on TCP ports (evologics) or on "
        "pseudo-terminals (evologics-serial), or a stand-in for DESERT",
        next(iter(MEDIA)),
        choices=tuple(MEDIA),
    )
    plain: bool = flag("lines instead of the live view, as without a TTY")
    screenshot: Path | None = option("FILE", "save a picture of the live view as SVG", type=Path)
    json: bool = flag(OBJECT_PER_LINE)

    def work(self) -> int:
        """Run it.

        Raises:
            ConfigError: The duration is out of range.
        """
        from zacoustic.app.tools.demo.mission import DURATION_S, LONGEST_S, SHORTEST_S, Mission

        duration_s = DURATION_S if self.duration is None else self.duration
        check_within("--duration", duration_s, SHORTEST_S, LONGEST_S, unit=" s")
        medium = MEDIA[self.link]()
        with new_file("--screenshot", self.screenshot) as picture:
            view = self._view(medium.title, picture)
            mission = Mission(view, medium, duration_s=duration_s)
            summary = asyncio.run(mission.run())
            if mission.is_interrupted:
                return EXIT_INTERRUPTED
            view.conclude(summary)
        return EXIT_OK if summary.ok else EXIT_FAILED

    def _view(self, title: str, picture: IO[bytes] | None) -> "View":
        from zacoustic.app.tools.demo.views import JsonView, LinesView

        if self.json:
            return JsonView()
        wants_picture = sys.stdout.isatty() or self.screenshot is not None
        if self.plain or not wants_picture:
            return LinesView()
        try:
            from zacoustic.app.tools.demo.live import LiveView
        except ModuleNotFoundError as error:
            if self.screenshot is not None or not (error.name or "").startswith("rich"):
                raise
            print_text(f"{self.program}: plain lines; for the live view, {with_extra('terminal')}")
            return LinesView()
        return LiveView(title=title, screenshot=picture)
