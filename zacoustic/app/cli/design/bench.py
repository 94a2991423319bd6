"""The verb `zacoustic codec bench`."""

from zacoustic.app.cli.design.telemetry import Telemetry
from zacoustic.app.cli.support.rows import option, whole
from zacoustic.link.command import EXIT_FAILED, EXIT_OK


class Bench(Telemetry):
    """The bytes of recorded telemetry in every codec, with all decodes verified.

    exits with 1 when anything is decoded to something else than what was sent, or is
    larger than a frame and can never cross

    Example:
      zacoustic codec bench monday.jsonl.gz --config fleet.json5
    """

    config: str = option(
        "FILE", "file with the streams, the types and, perhaps, the model", required=True
    )
    seed: int = whole("N", "of the losses", 1)

    def work(self) -> int:
        """Measure and print; fails if a decoded value differs.

        Raises:
            ConfigError: A file is wrong.
        """
        from zacoustic.app.tools.design.telemetry.measuretext import as_text
        from zacoustic.app.tools.design.telemetry.measuring import measure
        from zacoustic.app.tools.design.telemetry.recording import read_recordings
        from zacoustic.app.tools.fleetfile import read_fleet
        from zacoustic.core.streams.specs import in_parts

        config = read_fleet(self.config, with_model=True)
        table, files, window_s = config.table, self.recordings, self.window
        recordings = read_recordings(
            files, table, only_dense=False, window_s=window_s, ros=config.ros
        )
        report = measure(files, recordings, table, window_s=window_s, seed=self.seed)
        self.show(report, as_text)
        for row in report.streams:
            if row.too_large:
                spec = table.by_id(row.stream_id).spec
                what = f"{row.too_large} of {row.frames} samples are larger than a frame"
                self.note(f"{row.name}: {what} ({in_parts(spec)})")
        if report.different:
            what = f"{report.different} of {report.decoded} frames were decoded to something else"
            self.note(what)
            return EXIT_FAILED
        return EXIT_FAILED if any(row.too_large for row in report.streams) else EXIT_OK
