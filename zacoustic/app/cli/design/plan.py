"""The verb `zacoustic config plan`: does the traffic fit the channel?"""

import argparse
import math
from typing import TYPE_CHECKING

from zacoustic.app.cli.support.arguments import add_json, add_load
from zacoustic.app.cli.support.atwork import AT_WORK
from zacoustic.app.cli.support.printing import print_result
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command

if TYPE_CHECKING:
    from zacoustic.app.tools.design.plan.slots import ScheduleOptions


class PlanCommand(Command):
    """Runs the engines with the traffic in virtual time, for some seconds."""

    name = "plan"
    summary = "airtime, latency and energy of the traffic; what would make it fit"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare file, recordings, channel and form of the output."""
        parser.add_argument(
            "file", metavar="FILE", help="scenario with traffic, or config with plugins.acoustic"
        )
        add_load(
            parser, recording="take sizes and rates from this recording", profile=", of a config"
        )
        parser.add_argument(
            "--link-profile", action="append", default=[], metavar="LINK=NAME",
            help="modem of another link of a config than its first; may be given again",
        )  # fmt: skip
        parser.add_argument(
            "--range", type=float, metavar="M", help="distance of the nodes of a config, m (1000)"
        )
        parser.add_argument(
            "--loss", type=float, metavar="SHARE",
            help="share of the frames of a config that are lost, 0 to 0.9 (0)",
        )  # fmt: skip
        parser.add_argument(
            "--hours",
            type=float,
            metavar="H",
            help="how long to simulate, h (4, or less)",
        )
        parser.add_argument(
            "--transmit-w", type=float, metavar="W",
            help="what the modem takes while it transmits, W (default: from its source level)",
        )  # fmt: skip
        parser.add_argument(
            "--schedule",
            action="store_true",
            help="also print a schedule for these nodes, as the table access of their configs",
        )
        parser.add_argument(
            "--clock-error", type=float, metavar="S", help="of a schedule: of any clock, s (0.01)"
        )
        parser.add_argument(
            "--clock",
            type=int,
            metavar="ADDRESS",
            help="of a schedule: the node whose clock all follow (default: UTC from each host)",
        )
        parser.add_argument(
            "--drift",
            type=float,
            metavar="M",
            help="of a schedule: how far each node may be from its place, m (0)",
        )
        parser.add_argument(
            "--hears", type=float, metavar="M",
            help="of a schedule: nodes farther apart do not hear each other, m (all do)",
        )  # fmt: skip
        add_json(parser)
        parser.epilog = (
            "rates come from the scenario's traffic, as in `zacoustic sim`; or the\n"
            "recording; or min_interval_s and deadline_s of the config. Exits with 1 when it does\n"
            "not fit. docs/plan.md explains the figures\n\n"
            "example:\n"
            "  zacoustic config plan water.json5\n"
            "  zacoustic config plan fleet.json5 --recording monday.jsonl --loss 0.2 --range 1500\n"
            "  zacoustic config plan water.json5 --schedule --drift 100"
        )

    def run(self, arguments: argparse.Namespace) -> int:
        """Print the plan; fails if something does not fit.

        Raises:
            ConfigError: A file or an argument is wrong.
        """
        import msgspec

        from zacoustic.app.tools.design.plan.fleet import DEFAULT_RANGE_M, AssumedChannel
        from zacoustic.app.tools.design.plan.report import DEFAULT_HOURS, plan
        from zacoustic.app.tools.design.plan.text import as_text

        hours = arguments.hours
        if hours is not None:
            hours = _within("--hours", hours, DEFAULT_HOURS, 0.1, 240.0)
        transmit_w = arguments.transmit_w
        if transmit_w is not None:
            transmit_w = _within("--transmit-w", transmit_w, 0.0, 0.0, 10_000.0)
        channel = AssumedChannel(
            range_m=_within("--range", arguments.range, DEFAULT_RANGE_M, 1.0, 100_000.0),
            loss=_within("--loss", arguments.loss, 0.0, 0.0, 0.9),
        )
        if arguments.profile is not None:
            channel = msgspec.structs.replace(channel, profile=arguments.profile)
        channel = msgspec.structs.replace(channel, others=_profiles(arguments.link_profile))
        report = plan(
            arguments.file, channel=channel, recordings=arguments.recording, hours=hours,
            transmit_w=transmit_w, schedule=_schedule_options(arguments), progress=AT_WORK.show,
        )  # fmt: skip
        print_result(report, as_text, as_json=arguments.json)
        return EXIT_OK if report.fits else EXIT_FAILED


def _profiles(given: list[str]) -> dict[str, str]:
    found = {}
    for each in given:
        link, is_pair, profile = each.partition("=")
        if not (link and is_pair and profile):
            raise ConfigError(f"--link-profile {each}; allowed: LINK=NAME, such as radio=ideal")
        found[link] = profile
    return found


def _schedule_options(arguments: argparse.Namespace) -> "ScheduleOptions | None":
    from zacoustic.app.tools.design.plan.slots import CLOCK_ERROR_S, ScheduleOptions

    given = (arguments.clock_error, arguments.clock, arguments.drift, arguments.hears)
    if not arguments.schedule:
        if any(each is not None for each in given):
            raise ConfigError(
                "--clock-error, --clock, --drift, --hears: of a schedule; allowed: with --schedule"
            )
        return None
    if arguments.clock is not None and not 1 <= arguments.clock <= 254:
        raise ConfigError(f"--clock {arguments.clock}; allowed: 1 to 254")
    hears = arguments.hears
    return ScheduleOptions(
        clock_error_s=_within("--clock-error", arguments.clock_error, CLOCK_ERROR_S, 0.0, 10.0),
        clock=arguments.clock,
        drift_m=_within("--drift", arguments.drift, 0.0, 0.0, 100_000.0),
        hearing_m=None if hears is None else _within("--hears", hears, 0.0, 1.0, 100_000.0),
    )


def _within(name: str, given: float | None, default: float, least: float, most: float) -> float:
    if given is None:
        return default
    if not (math.isfinite(given) and least <= given <= most):
        raise ConfigError(f"{name} {given:g}; allowed: {least:g} to {most:g}")
    return given
