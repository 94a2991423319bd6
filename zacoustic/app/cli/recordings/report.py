"""The verb `zacoustic report`."""

from pathlib import Path

from zacoustic.app.cli.support.atwork import AT_WORK
from zacoustic.app.cli.support.newfile import new_file
from zacoustic.app.cli.support.printing import print_text
from zacoustic.app.cli.support.rows import option, word
from zacoustic.app.cli.support.verb import Verb


class Report(Verb):
    """Delivery, latency, airtime and link quality of a recording, also as a page.

    delivery and latency between two nodes need the recordings of both; one shows
    what its node knew: outcomes of reliable samples, ages, link quality

    Examples:
      zacoustic report trial.mcap --html trial.html
      zacoustic report shore.mcap auv1.mcap --json
    """

    recordings: list[str] = word(
        "FILE", "recordings, MCAP: those of both ends of one trial are put together", "+"
    )
    html: Path | None = option("PAGE", "write a page with plots", type=Path)

    def work(self) -> None:
        """Print the figures, and write the page.

        Raises:
            ConfigError: A file or an argument is wrong.
        """
        from zacoustic.app.tools.inspect.recordings.facts.gathering import gather
        from zacoustic.app.tools.inspect.recordings.report.figures import figures_of
        from zacoustic.app.tools.inspect.recordings.report.reporttext import as_text

        with new_file("--html", self.html) as page:
            facts = gather(self.recordings, lean=True, progress=AT_WORK.show)
            figures = figures_of(facts)
            if page is not None:
                from zacoustic.app.tools.inspect.recordings.report.page import as_page
                from zacoustic.app.tools.inspect.recordings.report.plots import plots_of

                title = " and ".join(Path(name).name for name in self.recordings)
                page.write(as_page(figures, plots_of(facts, figures), title=title).encode())
        self.show(figures, as_text)
        if self.html is not None and not self.json:
            print_text(f"\n{self.html}: written")
