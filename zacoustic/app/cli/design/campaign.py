"""The verb `zacoustic sim campaign`."""

from pathlib import Path
from typing import Final

from zacoustic.app.cli.support.printing import print_json, print_text
from zacoustic.app.cli.support.progress import RunsProgress
from zacoustic.app.cli.support.rows import flag, option, seconds, whole, word
from zacoustic.app.cli.support.verb import Verb

_MOST_WORKERS: Final = 1024
_PATIENCE_S: Final = 30.0


class Campaign(Verb):
    """Sweep parameters of a scenario over all cores, or over a dask scheduler.

    the file names a scenario, the values to sweep, by paths into it or into its config,
    and the seeds of each cell; docs/sim.md has its keys. Each finished run is kept:
    an interrupted campaign continues. Needs the extra `campaign`

    Example:
      zacoustic sim campaign campaign.json5
      zacoustic sim campaign campaign.json5 --scheduler tcp://10.0.0.1:8786 --parquet
    """

    prints_late = False

    file: str = word("FILE", "campaign, JSON5")
    output: Path | None = option(
        "FOLDER", "for rows, tables and page (default: the name of FILE with .results)", type=Path
    )
    workers: int | None = whole(
        "N",
        "processes here (default: one for each core)",
        least=1,
        most=_MOST_WORKERS,
        either="where",
    )
    scheduler: str | None = option(
        "ADDRESS", "workers of a dask scheduler: tcp://HOST:PORT", either="where"
    )
    timeout: float = seconds("how long scheduler and workers may be away, s", _PATIENCE_S)
    parquet: bool = flag("Parquet instead of CSV")

    def work(self) -> None:
        """Run it.

        Raises:
            ConfigError: A file or an argument is wrong.
            CampaignError: A run, or the scheduler, has failed.
            TimeoutError: There is no scheduler, or no worker.
        """
        from zacoustic.app.tools.design.campaign.conducting import (
            PAGE,
            CampaignOptions,
            run_campaign,
        )

        path = Path(self.file)
        folder = self.output or path.parent / f"{path.stem}.results"
        options = CampaignOptions(
            scheduler=self.scheduler,
            workers=self.workers,
            patience_s=self.timeout,
            parquet=self.parquet,
        )
        with RunsProgress() as progress:
            result, text = run_campaign(path, folder, options, progress=progress.show)
        if self.json:
            print_json(result)
        else:
            print_text(text)
            print_text(f"\n{result.runs} runs, {result.ran} of them now; {folder / PAGE}: written")
