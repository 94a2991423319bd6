"""The verb `zacoustic sim`: a scenario with its traffic, in virtual time."""

from collections.abc import Callable
from pathlib import Path
from typing import IO, TYPE_CHECKING

from zacoustic.app.cli.support.newfile import new_file
from zacoustic.app.cli.support.rows import option, seconds, whole, word
from zacoustic.app.cli.support.verb import Verb
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK

if TYPE_CHECKING:
    from zacoustic.core.base.trace import TraceRecord


class Sim(Verb):
    """Run a scenario with its traffic in virtual time: hours in seconds.

    the scenario has the positions (nodes), the streams (config: FILE, or
    none: each topic is opaque bytes), the payloads and rates (traffic), and the
    faults (loss, faults); docs/sim.md has all keys

    Example:
      zacoustic sim water.json5 --until 86400 --trace trace.jsonl
      zacoustic decode --config fleet.json5 < trace.jsonl
      zacoustic sim water.json5 --record trial.mcap && zacoustic report trial.mcap
      zacoustic sim --random 1234    exits with 1 if something is lost, altered, doubled
      zacoustic sim campaign --help  many runs with parameters swept
    """

    scenario: str | None = word(
        "SCENARIO", "scenario with traffic, JSON5", "?", either="what", required=True
    )
    random: int | None = whole(
        "SEED",
        "instead of a file: the random scenario of this seed, as `make soak` runs it",
        either="what",
    )
    seed: int | None = whole(None, "replaces the seed of the scenario")
    until: float | None = seconds("length, s of virtual time (default: 3600)")
    trace: Path | None = option("FILE", "write what every engine did, as JSON lines", type=Path)
    record: Path | None = option("FILE", "record every engine, as MCAP", type=Path)

    def work(self) -> int:
        """Run it.

        Raises:
            ConfigError: The scenario or an argument is wrong.
        """
        from zacoustic.app.tools.design.sim.recorder import recorded_to

        if self.random is not None:
            return self._run_random(self.random)
        from zacoustic.app.tools.design.sim.simulation import DEFAULT_UNTIL_S, simulate
        from zacoustic.app.tools.design.sim.text import as_text

        with new_file("--trace", self.trace) as file, recorded_to(self.record) as record:
            result = simulate(
                self.scenario or "",
                seed=self.seed,
                until_s=self.until or DEFAULT_UNTIL_S,
                trace=_writer(file),
                record=record,
            )
        self.show(result, as_text)
        return EXIT_OK

    def _run_random(self, seed: int) -> int:
        """Run a random scenario.

        Raises:
            ConfigError: A random scenario lacks an argument.
        """
        from zacoustic.app.tools.design.sim.randomscenario import run_random_scenario
        from zacoustic.app.tools.design.sim.recorder import recorded_to
        from zacoustic.app.tools.design.sim.text import scenario_as_text

        for name in ("seed", "until"):
            if getattr(self, name) is not None:
                raise ConfigError(f"--{name} with --random; allowed: with a scenario")
        with new_file("--trace", self.trace) as file, recorded_to(self.record) as record:
            result = run_random_scenario(seed, trace=_writer(file), record=record)
        self.show(result, scenario_as_text)
        return EXIT_FAILED if result.violations else EXIT_OK


def _writer(file: IO[bytes] | None) -> "Callable[[TraceRecord], None] | None":
    """Return a function that writes trace records to a file; None without a file."""
    if file is None:
        return None
    import msgspec

    encoder, write = msgspec.json.Encoder(), file.write

    def write_line(record: "TraceRecord") -> None:
        write(encoder.encode(record) + b"\n")

    return write_line
