"""The verb `zacoustic config plan`."""

from typing import TYPE_CHECKING, Final

from zacoustic.app.cli.support.atwork import AT_WORK
from zacoustic.app.cli.support.rows import (
    MOST_NODES,
    flag,
    modem_profile,
    real,
    repeated,
    whole,
    word,
)
from zacoustic.app.cli.support.verb import Verb
from zacoustic.errors import ConfigError
from zacoustic.link.command import EXIT_FAILED, EXIT_OK

if TYPE_CHECKING:
    from zacoustic.app.tools.design.schedule import ScheduleOptions

_FARTHEST_M: Final = 100_000.0


class Plan(Verb):
    """Airtime, latency and energy of the traffic; what would make it fit.

    rates come from the scenario's traffic, as in `zacoustic sim`; or the
    recording; or min_interval_s and deadline_s of the config. Exits with 1 when it does
    not fit. docs/plan.md explains the figures

    Example:
      zacoustic config plan water.json5
      zacoustic config plan fleet.json5 --recording monday.jsonl --loss 0.2 --range 1500
      zacoustic config plan water.json5 --schedule --drift 100
    """

    file: str = word("FILE", "scenario with traffic, or config with plugins.acoustic")
    recording: list[str] = repeated("RECORDING", "take sizes and rates from this recording")
    profile: str | None = modem_profile(", of a config")
    link_profile: list[str] = repeated(
        "LINK=NAME", "modem of another link of a config than its first"
    )
    range: float | None = real(
        "M", "distance of the nodes of a config, m (1000)", least=1.0, most=_FARTHEST_M
    )
    loss: float | None = real(
        "SHARE", "share of the frames of a config that are lost, 0 to 0.9 (0)", least=0.0, most=0.9
    )
    hours: float | None = real("H", "how long to simulate, h (4, or less)", least=0.1, most=240.0)
    transmit_w: float | None = real(
        "W",
        "what the modem takes while it transmits, W (default: from its source level)",
        least=0.0,
        most=10_000.0,
    )
    schedule: bool = flag(
        "also print a schedule for these nodes, as the table access of their configs"
    )
    clock_error: float | None = real(
        "S", "of a schedule: of any clock, s (0.01)", least=0.0, most=10.0
    )
    clock: int | None = whole(
        "ADDRESS",
        "of a schedule: the node whose clock all follow (default: UTC from each host)",
        least=1,
        most=MOST_NODES,
    )
    drift: float | None = real(
        "M",
        "of a schedule: how far each node may be from its place, m (0)",
        least=0.0,
        most=_FARTHEST_M,
    )
    hears: float | None = real(
        "M",
        "of a schedule: nodes farther apart do not hear each other, m (all do)",
        least=1.0,
        most=_FARTHEST_M,
    )

    def work(self) -> int:
        """Print the plan; fails if something does not fit.

        Raises:
            ConfigError: A file or an argument is wrong.
        """
        from zacoustic.app.tools.design.plan.fleet import DEFAULT_RANGE_M, AssumedChannel
        from zacoustic.app.tools.design.plan.report import plan
        from zacoustic.app.tools.design.plan.text import as_text
        from zacoustic.channel.profiles import DEFAULT_PROFILE

        channel = AssumedChannel(
            range_m=DEFAULT_RANGE_M if self.range is None else self.range,
            loss=self.loss or 0.0,
            profile=self.profile or DEFAULT_PROFILE,
            others=_profiles(self.link_profile),
        )
        report = plan(
            self.file, channel=channel, recordings=self.recording, hours=self.hours,
            transmit_w=self.transmit_w, schedule=self._schedule_options(), progress=AT_WORK.show,
        )  # fmt: skip
        self.show(report, as_text)
        return EXIT_OK if report.fits else EXIT_FAILED

    def _schedule_options(self) -> "ScheduleOptions | None":
        from zacoustic.app.tools.design.schedule import CLOCK_ERROR_S, ScheduleOptions

        given = (self.clock_error, self.clock, self.drift, self.hears)
        if not self.schedule:
            if any(each is not None for each in given):
                options = "--clock-error, --clock, --drift, --hears"
                raise ConfigError(f"{options}: of a schedule; allowed: with --schedule")
            return None
        return ScheduleOptions(
            clock_error_s=CLOCK_ERROR_S if self.clock_error is None else self.clock_error,
            clock=self.clock,
            drift_m=self.drift or 0.0,
            hearing_m=self.hears,
        )


def _profiles(given: list[str]) -> dict[str, str]:
    found = {}
    for each in given:
        link, is_pair, profile = each.partition("=")
        if not (link and is_pair and profile):
            raise ConfigError(f"--link-profile {each}; allowed: LINK=NAME, such as radio=ideal")
        found[link] = profile
    return found
