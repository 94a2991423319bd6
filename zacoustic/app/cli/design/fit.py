"""The verb `zacoustic codec fit`."""

from pathlib import Path

from zacoustic.app.cli.design.telemetry import Telemetry
from zacoustic.app.cli.support.newfile import new_file
from zacoustic.app.cli.support.printing import print_text
from zacoustic.app.cli.support.rows import option
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK


class Fit(Telemetry):
    """Fit a model of the dense topics to recordings, and report whether it helps.

    exits with 1 when frames are no smaller with the model; it is written all the same

    Example:
      zacoustic codec fit monday.jsonl.gz tuesday.jsonl.gz --config fleet.json5 --output survey.model.json
    """  # noqa: E501 (wide on a terminal)

    output: Path | None = option("MODEL", "write the model, which the key `model` names", type=Path)

    def work(self) -> int:
        """Fit, print, write; fails if the model does not help.

        Raises:
            ConfigError: A file or an argument is wrong.
        """
        import msgspec

        from zacoustic.app.tools.design.telemetry.modelling import fit_recordings
        from zacoustic.app.tools.design.telemetry.modeltext import as_text
        from zacoustic.app.tools.design.telemetry.recording import read_recordings
        from zacoustic.app.tools.fleetfile import read_fleet

        config = read_fleet(self.config, with_model=False)
        table, window_s = config.table, self.window
        if all(stream.dense_type is None or stream.type is None for stream in table):
            raise ConfigError(
                f"{self.config}: no stream is dense; allowed: topics with a type",
                hint='give a topic a type and codec: "dense"; without a type nothing can be fitted',
            )
        with new_file("--output", self.output) as model:
            recordings = read_recordings(
                self.recordings, table, only_dense=True, window_s=window_s, ros=config.ros
            )
            fitted, report = fit_recordings(recordings, table, window_s=window_s)
            if model is not None:
                model.write(msgspec.json.encode(fitted, order="sorted") + b"\n")
        self.show(report, as_text)
        if self.output is not None and not self.json:
            print_text(f"{self.output}: written; name it under the key model, at both ends")
        if not report.helps:
            self.note("the model does not help: do without it")
            return EXIT_FAILED
        return EXIT_OK
