"""The verb `zacoustic plan`: does the traffic fit the channel?"""

import argparse
import math

from zacoustic.app.cli.support.arguments import add_json, add_load
from zacoustic.app.cli.support.printing import print_result
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK, Command


class PlanCommand(Command):
    """Computes with a model of the traffic, in seconds."""

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
            help="how long the model goes, h (4, or less)",
        )
        parser.add_argument(
            "--transmit-w", type=float, metavar="W",
            help="what the modem takes while it transmits, W (default: from its source level)",
        )  # fmt: skip
        add_json(parser)
        parser.epilog = (
            "rates come from the scenario's traffic, as in `zacoustic sim`; or the\n"
            "recording; or min_interval_s and deadline_s of the config. Exits with 1 when it does\n"
            "not fit. docs/plan.md explains the figures\n\n"
            "example:\n"
            "  zacoustic plan water.json5\n"
            "  zacoustic plan fleet.json5 --recording monday.jsonl.gz --loss 0.2 --range 1500"
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
        report = plan(
            arguments.file, channel=channel, recordings=arguments.recording, hours=hours,
            transmit_w=transmit_w,
        )  # fmt: skip
        print_result(report, as_text, as_json=arguments.json)
        return EXIT_OK if report.fits else EXIT_FAILED


def _within(name: str, given: float | None, default: float, least: float, most: float) -> float:
    if given is None:
        return default
    if not (math.isfinite(given) and least <= given <= most):
        raise ConfigError(f"{name} {given:g}; allowed: {least:g} to {most:g}")
    return given
