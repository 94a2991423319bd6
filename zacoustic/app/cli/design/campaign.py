"""The verb `zacoustic sim campaign`: a scenario with varied parameters, on all cores."""

import argparse
import sys
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from zacoustic.app.cli.support.arguments import add_json, check_positive
from zacoustic.app.cli.support.printing import print_json, print_note, print_text
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_OK, Command

_MOST_WORKERS: Final = 1024
_EVERY_PERCENT: Final = 10
_PATIENCE_S: Final = 30.0


class CampaignCommand(Command):
    """Runs every cell of a campaign with every seed; a second start runs the missing ones."""

    name = "campaign"
    summary = "sweep parameters of a scenario over all cores, or over a dask scheduler"

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, folder, workers and form of the output."""
        parser.add_argument("file", metavar="FILE", help="campaign, JSON5")
        parser.add_argument(
            "--output", type=Path, metavar="FOLDER",
            help="for rows, tables and page (default: the name of FILE with .results)",
        )  # fmt: skip
        where = parser.add_mutually_exclusive_group()
        where.add_argument(
            "--workers", type=int, metavar="N", help="processes here (default: one for each core)"
        )
        where.add_argument(
            "--scheduler", metavar="ADDRESS", help="workers of a dask scheduler: tcp://HOST:PORT"
        )
        parser.add_argument(
            "--timeout", type=float, default=_PATIENCE_S, metavar="S",
            help="how long scheduler and workers may be away, s (default: %(default)g)",
        )  # fmt: skip
        parser.add_argument("--parquet", action="store_true", help="Parquet instead of CSV")
        add_json(parser)
        parser.epilog = (
            "the file names a scenario, the values to sweep, by paths into it or into its config,\n"
            "and the seeds of each cell; docs/sim.md has its keys. Each finished run is kept:\n"
            "an interrupted campaign continues. Needs the extra `campaign`\n\n"
            "example:\n"
            "  zacoustic sim campaign campaign.json5\n"
            "  zacoustic sim campaign campaign.json5 --scheduler tcp://10.0.0.1:8786 --parquet"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Run it.

        Raises:
            ConfigError: A file or an argument is wrong.
            CampaignError: A run, or the scheduler, has failed.
            TimeoutError: There is no scheduler, or no worker.
        """
        check_positive(arguments, "timeout")
        workers: int | None = arguments.workers
        if workers is not None and not 1 <= workers <= _MOST_WORKERS:
            raise ConfigError(f"--workers {workers}; allowed: 1 to {_MOST_WORKERS}")
        from zacoustic.app.tools.design.campaign.conducting import (
            PAGE,
            CampaignOptions,
            run_campaign,
        )

        path = Path(arguments.file)
        folder = arguments.output or path.parent / f"{path.stem}.results"
        options = CampaignOptions(
            scheduler=arguments.scheduler,
            workers=workers,
            patience_s=arguments.timeout,
            parquet=arguments.parquet,
        )
        with _Progress() as progress:
            result, text = run_campaign(path, folder, options, progress=progress.show)
        if arguments.json:
            print_json(result)
        else:
            print_text(text)
            print_text(f"\n{result.runs} runs, {result.ran} of them now; {folder / PAGE}: written")
        return EXIT_OK


class _Progress:
    """Shows how many runs are done: a bar on a terminal, a line for each tenth elsewhere."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._task: Any = None
        self._percent = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def show(self, done: int, runs: int) -> None:
        """Show the progress."""
        if self._bar is None and sys.stderr.isatty():
            self._bar = _bar()
            if self._bar is not None:
                self._task = self._bar.add_task("runs", total=runs)
                self._bar.start()
        if self._bar is not None:
            self._bar.update(self._task, completed=done)
            return
        percent = done * 100 // runs
        if percent >= self._percent + _EVERY_PERCENT:
            self._percent = percent // _EVERY_PERCENT * _EVERY_PERCENT
            print_note(f"{done} of {runs} runs done")


def _bar() -> Any:  # noqa: ANN401 (an object of rich, which may be absent)
    """Return a bar of rich; None without it."""
    try:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )
    except ModuleNotFoundError:
        return None
    return Progress(
        TextColumn("{task.description}"), BarColumn(40), MofNCompleteColumn(),
        TimeElapsedColumn(), TimeRemainingColumn(), console=Console(file=sys.stderr),
    )  # fmt: skip
