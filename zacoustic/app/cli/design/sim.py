"""The verb `zacoustic sim`: a scenario with its traffic, in virtual time."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import IO, TYPE_CHECKING

from zacoustic.app.cli.support.newfile import new_file
from zacoustic.app.cli.support.printing import print_result
from zacoustic.core.base.clock import DURATIONS, is_duration
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command

if TYPE_CHECKING:
    from zacoustic.core.base.trace import TraceRecord


class SimCommand(Command):
    """Runs a scenario; the same seed gives the same trace."""

    name = "sim"
    summary = "run a scenario with its traffic in virtual time: hours in seconds"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare scenario or seed, length, trace and form of the output."""
        what = parser.add_mutually_exclusive_group(required=True)
        what.add_argument(
            "scenario", metavar="SCENARIO", nargs="?", help="scenario with traffic, JSON5"
        )
        what.add_argument(
            "--random",
            type=int,
            metavar="SEED",
            help="instead of a file: the random scenario of this seed, as `make soak` runs it",
        )
        parser.add_argument("--seed", type=int, help="replaces the seed of the scenario")
        parser.add_argument(
            "--until", type=float, metavar="S", help="length, s of virtual time (default: 3600)"
        )
        parser.add_argument(
            "--trace", type=Path, metavar="FILE", help="write what every engine did, as JSON lines"
        )
        parser.add_argument(
            "--record", type=Path, metavar="FILE", help="record every engine, as MCAP"
        )
        parser.add_argument("--json", action="store_true", help="one JSON object")
        parser.epilog = (
            "the scenario has the positions (nodes), the streams (config: FILE, or\n"
            "none: each topic is opaque bytes), the payloads and rates (traffic), and the\n"
            "faults (loss, faults); docs/sim.md has all keys\n\n"
            "example:\n"
            "  zacoustic sim water.json5 --until 86400 --trace trace.jsonl\n"
            "  zacoustic decode --config fleet.json5 < trace.jsonl\n"
            "  zacoustic sim water.json5 --record trial.mcap && zacoustic report trial.mcap\n"
            "  zacoustic sim --random 1234    exits with 1 if something is lost, altered, doubled"
            "\n  zacoustic sim campaign --help  many runs with parameters swept"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Run it.

        Raises:
            ConfigError: The scenario or an argument is wrong.
        """
        if arguments.random is not None:
            return _tell(arguments)
        from zacoustic.app.tools.design.sim.recorder import recorded_to
        from zacoustic.app.tools.design.sim.simulation import DEFAULT_UNTIL_S, simulate
        from zacoustic.app.tools.design.sim.text import as_text

        until_s = DEFAULT_UNTIL_S if arguments.until is None else arguments.until
        if not is_duration(until_s):
            raise ConfigError(f"--until {until_s:g}; allowed: seconds, above 0, {DURATIONS}")
        with new_file("--trace", arguments.trace) as file, recorded_to(arguments.record) as record:
            result = simulate(
                arguments.scenario,
                seed=arguments.seed,
                until_s=until_s,
                trace=_writer(file),
                record=record,
            )
        print_result(result, as_text, as_json=arguments.json)
        return EXIT_OK


def _tell(arguments: argparse.Namespace) -> int:
    """Run a random scenario.

    Raises:
        ConfigError: A random scenario lacks this argument.
    """
    from zacoustic.app.tools.design.sim.randomscenario import run_random_scenario
    from zacoustic.app.tools.design.sim.recorder import recorded_to
    from zacoustic.app.tools.design.sim.text import scenario_as_text

    for name in ("seed", "until"):
        if getattr(arguments, name) is not None:
            raise ConfigError(f"--{name} with --random; allowed: with a scenario")
    with new_file("--trace", arguments.trace) as file, recorded_to(arguments.record) as record:
        result = run_random_scenario(arguments.random, trace=_writer(file), record=record)
    print_result(result, scenario_as_text, as_json=arguments.json)
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
