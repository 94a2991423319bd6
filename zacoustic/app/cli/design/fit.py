"""The verb `zacoustic codec fit`: a model of dense topics from recordings."""

import argparse
from pathlib import Path

from zacoustic.app.cli.support.arguments import add_json, add_telemetry, window_of
from zacoustic.app.cli.support.newfile import new_file
from zacoustic.app.cli.support.printing import print_note, print_result, print_text
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command


class FitCommand(Command):
    """Fits a model, and tests whether it helps."""

    name = "fit"
    summary = "fit a model of the dense topics to recordings, and report whether it helps"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare recordings, configuration, model and form of the output."""
        add_telemetry(
            parser,
            config="the streams and types",
            window="samples within this time share a frame",
        )
        parser.add_argument(
            "--output",
            type=Path,
            metavar="MODEL",
            help="write the model, which the key `model` names",
        )
        add_json(parser)
        parser.epilog = (
            "exits with 1 when frames are no smaller with the model; it is written all the same\n\n"
            "example:\n"
            "  zacoustic codec fit monday.jsonl.gz tuesday.jsonl.gz --config fleet.json5 "
            "--output survey.model.json"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Fit, print, write; fails if the model does not help.

        Raises:
            ConfigError: A file or an argument is wrong.
        """
        import msgspec

        from zacoustic.app.tools.design.telemetry.modelling import fit_recordings
        from zacoustic.app.tools.design.telemetry.modeltext import as_text
        from zacoustic.app.tools.design.telemetry.recording import read_recordings
        from zacoustic.app.tools.fleetfile import read_fleet

        window_s = window_of(arguments)
        config = read_fleet(arguments.config, with_model=False)
        table = config.table
        if all(stream.dense_type is None or stream.type is None for stream in table):
            raise ConfigError(
                f"{arguments.config}: no stream is dense; allowed: topics with a type",
                hint='give a topic a type and codec: "dense"; without a type nothing can be fitted',
            )
        with new_file("--output", arguments.output) as model:
            recordings = read_recordings(
                arguments.recordings, table, only_dense=True, window_s=window_s, ros=config.ros
            )
            fitted, report = fit_recordings(recordings, table, window_s=window_s)
            if model is not None:
                model.write(msgspec.json.encode(fitted, order="sorted") + b"\n")
        print_result(report, as_text, as_json=arguments.json)
        if arguments.output is not None and not arguments.json:
            print_text(f"{arguments.output}: written; name it under the key model, at both ends")
        if not report.helps:
            print_note("zacoustic codec fit: the model does not help: do without it")
            return EXIT_FAILED
        return EXIT_OK
