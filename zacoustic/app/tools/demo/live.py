"""The live view of the demo: the channel, the last frames with their contents, the streams.

Needs rich, the extra `terminal`. It draws only when called: each `tick` draws once.
"""

import io
import re
import time
from collections.abc import Iterator, Sequence
from typing import IO, Final

from rich import box
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from zacoustic.app.tools.demo.logbook import Frame, Logbook, network_name
from zacoustic.app.tools.demo.networks import SHORE, VEHICLE
from zacoustic.app.tools.demo.notes import AnyNote
from zacoustic.app.tools.demo.verdict import Summary, as_text
from zacoustic.app.tools.demo.views import View, shown

WIDTH: Final = 108
"""Columns of the saved picture."""
FRAMES_SHOWN: Final = 7
"""Number of last frames to show."""
# The picture uses the reader's own font, so that it loads nothing.
_FONT: Final = re.compile(r"@font-face \{.*?\}\s*", re.DOTALL)
_MEDIUM_CELLS: Final = 92
_BESIDE_MEDIUM: Final = 15  # names of the two sides, and the frame around it
_CURSOR_LINES: Final = 1
_PAPER_LINES: Final = 60
_COLOURS: Final = {SHORE: "yellow", VEHICLE: "cyan"}


class LiveView(View):
    """Draws on a terminal.

    Args:
        console: The console to draw on; default: a new one on standard output.
        screenshot: Takes a picture of it as SVG, or None.
        title: Its title.
    """

    def __init__(
        self, *, console: Console | None = None, screenshot: IO[bytes] | None = None, title: str
    ) -> None:
        self._console = console or Console()
        self._screenshot = screenshot
        self._paper = Console(
            record=True, width=WIDTH, height=_PAPER_LINES, file=io.StringIO(), force_terminal=True
        )
        self._title = title
        self._logbook: Logbook | None = None
        self._live: Live | None = None
        self._picture_with_sound: RenderableType | None = None

    def begin(self, logbook: Logbook) -> None:
        """Take over the terminal."""
        self._logbook = logbook
        self._live = Live(console=self._console, auto_refresh=False, transient=False)
        self._live.start()

    def note(self, note: AnyNote) -> None:
        """Draw nothing: the next tick shows it."""

    def tick(self) -> None:
        """Draw."""
        if self._live is None:
            return
        picture = self._picture(self._console)
        self._live.update(picture, refresh=True)
        if self._logbook is not None and _is_under_way(self._logbook):
            self._picture_with_sound = self._picture(self._paper)

    def stop(self) -> None:
        """Give the terminal back."""
        if self._live is not None:
            self._live.stop()
            self._live = None

    def conclude(self, summary: Summary) -> None:
        """Print the summary; save a picture with sound in it, with the summary below."""
        closing = Text(f"\n{as_text(summary)}")
        self._console.print(closing)
        if self._screenshot is not None:
            paper = self._paper
            paper.print(self._picture_with_sound or self._picture(paper))
            paper.print(closing)
            drawn = _FONT.sub("", paper.export_svg(title="make demo"))
            self._screenshot.write(drawn.encode())

    def _picture(self, console: Console) -> RenderableType:
        """Return the picture, with as many frames as leave room for the rest."""
        logbook = self._logbook
        assert logbook is not None
        width = min(WIDTH, console.width)
        head = _line(f"{self._title}   {logbook.elapsed_s:5.1f} s", style="bold")
        medium = Panel(
            _medium(logbook, width), title="in the water now", title_align="left", width=width
        )
        lanes = _lanes(logbook, width)
        around: list[RenderableType] = [head, medium, _frames([], logbook, width), lanes]
        taken = len(console.render_lines(Group(*around), pad=False))
        frames = _newest(logbook.frames[-FRAMES_SHOWN:], console.height - taken - _CURSOR_LINES)
        return Group(head, medium, _frames(frames, logbook, width), lanes)


def _line(text: str, *, style: str = "") -> Text:
    """Return a line that is cut at the edge of the terminal."""
    return Text(text, style=style, no_wrap=True, overflow="ellipsis")


def _newest(frames: Sequence[Frame], lines: int) -> Sequence[Frame]:
    """Return the last frames that fit that many lines."""
    first = len(frames)
    while first and (lines := lines - max(1, len(frames[first - 1].carried))) >= 0:
        first -= 1
    return frames[first:]


def _is_under_way(logbook: Logbook) -> bool:
    """Tell whether sound is in the middle of the channel."""
    now = time.monotonic()
    return any(
        0.6 < (now - frame.began_at) / logbook.propagation_s < 0.9
        for frame in logbook.on_the_channel()
    )


def _medium(logbook: Logbook, width: int) -> RenderableType:
    """Return the two sides with the sound between them, at its present place."""
    now = time.monotonic()
    count = max(10, min(_MEDIUM_CELLS, width - _BESIDE_MEDIUM))
    cells = ["·"] * count
    styles = ["dim"] * count
    under_way = logbook.on_the_channel()
    for frame in under_way:
        for far in _cells_of(frame, now, logbook.propagation_s, count):
            position = far if frame.source == SHORE else count - 1 - far
            cells[position] = ")" if frame.source == SHORE else "("
            styles[position] = f"bold {_COLOURS[frame.source]}"
    line = Text("shore ", style=f"bold {_COLOURS[SHORE]}")
    for cell, style in zip(cells, styles, strict=True):
        line.append(cell, style=style)
    line.append(" auv1", style=f"bold {_COLOURS[VEHICLE]}")
    said = " · ".join(
        f"{network_name(frame.source)} → {network_name(frame.target)}: {frame.frame_bytes} bytes, "
        f"{frame.airtime_s:.3f} s of airtime"
        for frame in under_way
    ) or _waiting(logbook)
    if logbook.began_at is None:
        said = f"starting; ready: {', '.join(sorted(logbook.ready)) or 'nothing yet'}"
    return Group(line, _line(said or "silence", style="" if said else "dim"))


def _waiting(logbook: Logbook) -> str:
    """Return which node waits for medium access, if none transmits."""
    return " · ".join(
        f"{network_name(source)} listens before it sends" + (f", {count} wait" * (count > 1))
        for source, count in sorted(logbook.waiting.items())
        if count
    )


def _cells_of(frame: Frame, now: float, propagation_s: float, count: int) -> range:
    """Return the cells between which a frame sounds, counted from its sender."""
    first_s, last_s = now - frame.began_at, now - frame.began_at - frame.sound_s
    far = round(min(1.0, first_s / propagation_s) * count)
    near = round(min(1.0, max(0.0, last_s / propagation_s)) * count)
    return range(near, far)


def _frames(frames: Sequence[Frame], logbook: Logbook, width: int) -> Table:
    table = Table(width=width - 2, box=box.SIMPLE_HEAD, pad_edge=False)
    for name in ("at", "frame", "bytes", "airtime", "delay"):
        table.add_column(name, justify="left" if name == "frame" else "right", no_wrap=True)
    table.add_column("what it carried", ratio=1)
    began_at = logbook.began_at or 0.0
    for frame in frames:
        table.add_row(
            f"{frame.began_at - began_at:.1f} s",
            Text(
                f"{network_name(frame.source)} → {network_name(frame.target)}",
                style=_COLOURS[frame.source],
            ),
            str(frame.frame_bytes),
            f"{frame.airtime_s:.3f} s",
            "\n".join(f"{note.delay_s:.2f} s" for note in frame.carried),
            Text("\n".join(_carried(frame)), no_wrap=True, overflow="ellipsis"),
        )
    return table


def _carried(frame: Frame) -> Iterator[str]:
    if frame.outcome is None:
        yield "…"
    elif frame.outcome != "received":
        yield f"lost: {frame.outcome}"
    elif not frame.carried:
        yield "–"
    for note in frame.carried:
        yield f"{note.stream}: {shown(note.value)}"


def _lanes(logbook: Logbook, width: int) -> Table:
    table = Table(width=width - 2, box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("stream", ratio=1)
    for name in ("from", "sent", "crossed", "mean delay", "bytes"):
        table.add_column(name, justify="left" if name == "from" else "right")
    for lane in logbook.lanes:
        delay_s = lane.mean_delay_s
        table.add_row(
            lane.name,
            Text(network_name(lane.source), style=_COLOURS[lane.source]),
            str(lane.sent),
            str(lane.crossed),
            "" if delay_s is None else f"{delay_s:.2f} s",
            "" if lane.transmitted_bytes is None else str(lane.transmitted_bytes),
        )
    return table
