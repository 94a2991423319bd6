"""The verb `zacoustic codec bench`: the bytes of recorded telemetry in every codec."""

import argparse

from zacoustic.app.cli.support.arguments import add_json, add_telemetry, window_of
from zacoustic.app.cli.support.printing import print_note, print_result
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command

_DEFAULT_SEED = 1


class BenchCommand(Command):
    """Measures the cost of recorded telemetry in every codec."""

    name = "bench"
    summary = "the bytes of recorded telemetry in every codec, with all decodes verified"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare recordings, configuration, losses and form of the output."""
        add_telemetry(
            parser,
            config="the streams, the types and, perhaps, the model",
            window="samples within this time share a frame",
        )
        parser.add_argument(
            "--seed", type=int, default=_DEFAULT_SEED, metavar="N",
            help="of the losses (default: %(default)d)",
        )  # fmt: skip
        add_json(parser)
        parser.epilog = (
            "exits with 1 when anything is decoded to something else than what was sent, or is\n"
            "larger than a frame and can never cross\n\n"
            "example:\n"
            "  zacoustic codec bench monday.jsonl.gz --config fleet.json5"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Measure and print; fails if a decoded value differs.

        Raises:
            ConfigError: A file or an argument is wrong.
        """
        from zacoustic.app.tools.design.telemetry.measuretext import as_text
        from zacoustic.app.tools.design.telemetry.measuring import measure
        from zacoustic.app.tools.design.telemetry.recording import read_recordings
        from zacoustic.app.tools.fleetfile import read_fleet
        from zacoustic.core.streams.specs import in_parts

        window_s = window_of(arguments)
        config = read_fleet(arguments.config, with_model=True)
        table = config.table
        files: list[str] = arguments.recordings
        recordings = read_recordings(
            files, table, only_dense=False, window_s=window_s, ros=config.ros
        )
        report = measure(files, recordings, table, window_s=window_s, seed=arguments.seed)
        print_result(report, as_text, as_json=arguments.json)
        for row in report.streams:
            if row.too_large:
                spec = table.by_id(row.stream_id).spec
                what = f"{row.too_large} of {row.frames} samples are larger than a frame"
                print_note(f"zacoustic codec bench: {row.name}: {what} ({in_parts(spec)})")
        if report.different:
            what = f"{report.different} of {report.decoded} frames were decoded to something else"
            print_note(f"zacoustic codec bench: {what}")
            return EXIT_FAILED
        return EXIT_FAILED if any(row.too_large for row in report.streams) else EXIT_OK
