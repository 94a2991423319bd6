"""How far counted work is: bars on a terminal, a line for each tenth elsewhere."""

import sys
from typing import TYPE_CHECKING, Any, Final, Self

from zacoustic.app.cli.support.atwork import AT_WORK
from zacoustic.app.cli.support.printing import print_line, print_note

if TYPE_CHECKING:
    from zacoustic.app.tools.field.following import Step

_EVERY_PERCENT: Final = 10


class Progress:
    """Shows progress on standard error; a context manager.

    On a terminal it draws a bar for each count (rich, the extra `terminal`), elsewhere a line for
    each tenth.
    """

    columns: tuple[str, ...]
    """What stands behind a bar: classes of `rich.progress`."""

    def __init__(self) -> None:
        self._shown_percent = 0
        self._bars: Any = None
        self._tasks: dict[str, Any] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bars is not None:
            self._bars.stop()

    def draw(self, total: int, **done: int) -> bool:
        """Draw a bar for each count; False: there is no terminal, or no rich."""
        if self._bars is None:
            if not sys.stderr.isatty():
                return False
            try:
                from rich import progress
                from rich.console import Console
            except ModuleNotFoundError:
                return False
            width = max(map(len, done))
            self._bars = progress.Progress(
                progress.TextColumn(f"{{task.description:>{width}}}"),
                progress.BarColumn(40),
                *(getattr(progress, each)() for each in self.columns),
                console=Console(file=sys.stderr),
            )
            self._tasks = {name: self._bars.add_task(name, total=total) for name in done}
            self._bars.start()
        for name, count in done.items():
            self._bars.update(self._tasks[name], completed=count)
        return True

    def is_next_tenth(self, done: int, total: int) -> bool:
        """Whether a further tenth is done since the last line."""
        percent = done * 100 // max(total, 1)
        if percent < self._shown_percent + _EVERY_PERCENT:
            return False
        self._shown_percent = percent // _EVERY_PERCENT * _EVERY_PERCENT
        return True


class RunsProgress(Progress):
    """The progress of a campaign."""

    columns = ("MofNCompleteColumn", "TimeElapsedColumn", "TimeRemainingColumn")

    def show(self, done: int, runs: int) -> None:
        """Show how many runs are done."""
        if not self.draw(runs, runs=done) and self.is_next_tenth(done, runs):
            print_note(f"{done} of {runs} runs done")


class ProgressLine(Progress):
    """The progress of one transfer: sent and arrived bytes; as JSON, a line for each step.

    Args:
        key: What is published.
        as_json: Print JSON on standard output.
    """

    columns = ("DownloadColumn",)

    def __init__(self, key: str, *, as_json: bool) -> None:
        super().__init__()
        self._key = key
        self._as_json = as_json
        self._shown_percent = -_EVERY_PERCENT
        self._is_over = False

    def show(self, step: "Step") -> None:
        """Show a step."""
        AT_WORK.end()
        sent, done, total = step.sent_bytes, step.done_bytes, step.total_bytes
        if self._as_json:
            counts = {"sent_bytes": sent, "done_bytes": done, "total_bytes": total}
            print_line({"key": self._key, "event": "progress", **counts}, "", as_json=True)
        elif not self.draw(total, sent=sent, there=done) and not self._is_over:
            self._is_over = done == total
            if self.is_next_tenth(sent, total) or self._is_over:
                percents = [each * 100 // max(total, 1) for each in (sent, done)]
                print_note(f"{self._key}: {percents[0]} % sent, {percents[1]} % there")
