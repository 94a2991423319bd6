"""The progress of a large sample: a bar on a terminal, lines elsewhere."""

import sys
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final, Self

from zacoustic.app.cli.support.atwork import AT_WORK
from zacoustic.app.cli.support.printing import print_line, print_note

if TYPE_CHECKING:
    from zacoustic.app.tools.field.following import Step

_EVERY_PERCENT: Final = 10


class ProgressLine:
    """Shows steps of one transfer; a context manager.

    On a terminal it draws two bars on standard error, for sent and arrived bytes (rich, the
    extra `terminal`); elsewhere a line there for each tenth, and with `--json` one on standard
    output for each step.

    Args:
        key: What is published.
        as_json: Print JSON.
    """

    def __init__(self, key: str, *, as_json: bool) -> None:
        self._key = key
        self._as_json = as_json
        self._percent = -_EVERY_PERCENT
        self._bars: Any = None
        self._tasks: tuple[Any, Any] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._bars is not None:
            self._bars.stop()

    def show(self, step: "Step") -> None:
        """Show a step."""
        AT_WORK.end()
        if self._as_json:
            record = {
                "key": self._key,
                "event": "progress",
                "sent_bytes": step.sent_bytes,
                "done_bytes": step.done_bytes,
                "total_bytes": step.total_bytes,
            }
            print_line(record, "", as_json=True)
        elif not self._draw(step):
            self._write(step)

    def _draw(self, step: "Step") -> bool:
        """Draw bars; False: there is no terminal, or no rich."""
        if self._bars is None:
            if not sys.stderr.isatty():
                return False
            try:
                from rich.console import Console
                from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn
            except ModuleNotFoundError:
                return False
            columns = (TextColumn("{task.description:>5}"), BarColumn(40), DownloadColumn())
            self._bars = Progress(*columns, console=Console(file=sys.stderr))
            self._tasks = tuple(
                self._bars.add_task(name, total=step.total_bytes) for name in ("sent", "there")
            )
            self._bars.start()
        assert self._tasks is not None
        self._bars.update(self._tasks[0], completed=step.sent_bytes)
        self._bars.update(self._tasks[1], completed=step.done_bytes)
        return True

    def _write(self, step: "Step") -> None:
        percent = step.sent_bytes * 100 // max(step.total_bytes, 1)
        is_there = step.done_bytes == step.total_bytes
        if percent >= self._percent + _EVERY_PERCENT or is_there:
            self._percent = 100 + _EVERY_PERCENT if is_there else percent // 10 * 10
            done_percent = step.done_bytes * 100 // max(step.total_bytes, 1)
            print_note(f"{self._key}: {percent} % sent, {done_percent} % there")
