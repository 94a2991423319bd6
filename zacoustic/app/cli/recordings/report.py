"""The verb `zacoustic report`: figures of a recording, as text, JSON or a page."""

import argparse
from pathlib import Path

from zacoustic.app.cli.support.arguments import add_json
from zacoustic.app.cli.support.atwork import AT_WORK
from zacoustic.app.cli.support.newfile import new_file
from zacoustic.app.cli.support.printing import print_result, print_text
from zacoustic.link.command import EXIT_OK, Command


class ReportCommand(Command):
    """Reports delivery, latency, airtime and link quality."""

    name = "report"
    summary = "delivery, latency, airtime and link quality of a recording, also as a page"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare recordings, page and form of the output."""
        parser.add_argument(
            "recordings", metavar="FILE", nargs="+",
            help="recordings, MCAP: those of both ends of one trial are put together",
        )  # fmt: skip
        parser.add_argument("--html", type=Path, metavar="PAGE", help="write a page with plots")
        add_json(parser)
        parser.epilog = (
            "delivery and latency between two nodes need the recordings of both; one shows\n"
            "what its node knew: outcomes of reliable samples, ages, link quality\n\n"
            "examples:\n"
            "  zacoustic report trial.mcap --html trial.html\n"
            "  zacoustic report shore.mcap auv1.mcap --json"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print the figures, and write the page.

        Raises:
            ConfigError: A file or an argument is wrong.
        """
        from zacoustic.app.tools.inspect.recordings.facts.gathering import gather
        from zacoustic.app.tools.inspect.recordings.report.figures import figures_of
        from zacoustic.app.tools.inspect.recordings.report.reporttext import as_text

        with new_file("--html", arguments.html) as page:
            facts = gather(arguments.recordings, lean=True, progress=AT_WORK.show)
            figures = figures_of(facts)
            if page is not None:
                from zacoustic.app.tools.inspect.recordings.report.page import as_page
                from zacoustic.app.tools.inspect.recordings.report.plots import plots_of

                title = " and ".join(Path(name).name for name in arguments.recordings)
                page.write(as_page(figures, plots_of(facts, figures), title=title).encode())
        print_result(figures, as_text, as_json=arguments.json)
        if arguments.html is not None and not arguments.json:
            print_text(f"\n{arguments.html}: written")
        return EXIT_OK
