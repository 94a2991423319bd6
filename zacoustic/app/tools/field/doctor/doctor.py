"""Runs all checks of one node, on its own computer."""

import asyncio
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.app.tools.design.plan.fleet import AssumedChannel
from zacoustic.app.tools.design.plan.report import plan
from zacoustic.app.tools.field.doctor.host import (
    Synchronised,
    check_clock,
    check_journal,
    kernel_synchronised,
)
from zacoustic.app.tools.field.doctor.network import Running, look
from zacoustic.app.tools.field.doctor.ntp import ask_time
from zacoustic.app.tools.field.doctor.rosnodes import judge_nodes
from zacoustic.app.tools.field.doctor.running import judge
from zacoustic.app.tools.security.keycheck import check_keys, check_room, check_running
from zacoustic.channel.profiles import profile_named
from zacoustic.config import Config, read_config
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.errors import ConfigError, LinkUnavailableError
from zacoustic.link import registry
from zacoustic.link.contract import Finding, Link
from zacoustic.text.safetext import without_secrets

DEFAULT_PATIENCE_S: Final = 10.0
"""Time for a device to answer, s."""
_PLANNED_HOURS: Final = 0.5
_OTHER_RATE: Final = 2.0
"""A link that differs from the profile's rate by this factor is another modem."""


class DoctorReport(msgspec.Struct, frozen=True, kw_only=True):
    """The result of `zacoustic config doctor`."""

    file: str
    """The configuration."""
    address: int
    """Address of the node."""
    findings: tuple[Finding, ...]
    """The faults."""
    examined: tuple[str, ...]
    """What was examined."""
    left_out: tuple[str, ...]
    """What was not examined, and why."""


class Options(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments that override the file."""

    address: int | None = None
    """Address of the node; None: the file's."""
    locator: str | None = None
    """The modem; None: the file's."""
    connect: tuple[str, ...] = ()
    """Endpoints of the router; none: the file's."""
    ntp: str | None = None
    """Time server, `HOST` or `HOST:PORT`."""
    recordings: tuple[str, ...] = ()
    """Recordings with rates, for the plan."""
    channel: AssumedChannel = AssumedChannel()
    """Channel of the plan."""
    patience_s: float = DEFAULT_PATIENCE_S
    """Time for a device to answer, s."""


async def diagnose(
    file: str | Path, options: Options, *, synchronised: Synchronised = kernel_synchronised
) -> DoctorReport:
    """Examine a node.

    Args:
        file: Its configuration.
        options: The other arguments.
        synchronised: Tells whether something synchronises the clock.

    Raises:
        ConfigError: The file or an option is wrong.
    """
    config = read_config(file, address=options.address, locator=options.locator)
    rounds = _Rounds(config, options, synchronised)
    await rounds.go()
    return DoctorReport(
        file=str(file),
        address=config.address,
        findings=tuple(map(_without_secrets, rounds.findings)),
        examined=tuple(rounds.examined),
        left_out=tuple(map(without_secrets, rounds.left_out)),
    )


def _without_secrets(finding: Finding) -> Finding:
    return Finding(
        what=without_secrets(finding.what),
        why=without_secrets(finding.why),
        cure=without_secrets(finding.cure),
    )


class _Rounds:
    def __init__(self, config: Config, options: Options, synchronised: Synchronised) -> None:
        self.findings: list[Finding] = []
        self.examined: list[str] = []
        self.left_out: list[str] = []
        self._config = config
        self._options = options
        self._synchronised = synchronised

    async def go(self) -> None:
        """Run all checks."""
        config = self._config
        running, found = await look(config, self._options.connect)
        self.findings += found
        if running.is_joined or found:
            self.examined.append("router")
        if running.tokens:
            self.examined.append("nodes of ROS 2")
            self.findings += judge_nodes(config, running)
        link = self._link(running.locator)
        if running.health:
            self.examined.append(f"gateway of node {config.address}, which runs")
            self.findings += judge(config, running)
            if link is not None:
                self.left_out.append("the modem itself: the gateway that runs has it")
                self.findings += link.assess(running.health)
        elif link is not None:
            self.examined.append("modem")
            self.findings += await link.examine(self._options.patience_s)
        self._seal(link, running)
        self.findings += check_journal(config)
        if config.journal is not None:
            self.examined.append("journal")
        await self._clock()
        await self._airtime(link)

    def _seal(self, link: Link | None, running: Running) -> None:
        """Check key file, life records and the seal of a running gateway."""
        config, fingerprint = self._config, None
        if config.security is not None:
            check = check_keys(config, is_running=bool(running.health))
            fingerprint = check.fingerprint
            self.findings += check.findings
            self.examined.append("seal")
            capabilities = getattr(link, "capabilities", None)
            if isinstance(capabilities, LinkCapabilities):
                self.findings += check_room(config, capabilities)
        if running.health:
            self.findings += check_running(config, running.health, fingerprint)

    def _link(self, running: str) -> Link | None:
        """Return the link; that of a running gateway may come from its command line."""
        locators = [each.locator for each in self._config.links]
        if not running and not locators:
            self.left_out.append("the modem: the file names no link, and there is no --link")
            return None
        # A running gateway publishes its locator without passwords.
        known = (each for each in locators if without_secrets(each) == running)
        locator = next(known, running or locators[0])
        try:
            return registry.create(locator, self._config.address)
        except LinkUnavailableError as error:
            self.findings.append(
                Finding(
                    what=str(error.args[0]),
                    why="the gateway does not start without its link",
                    cure=error.hint or "zacoustic links lists what is installed",
                )
            )
            return None

    async def _clock(self) -> None:
        offset = None
        if self._options.ntp is not None:
            offset = await ask_time(self._options.ntp)
            if offset is None:
                self.left_out.append(f"the clock: {self._options.ntp} does not tell the time")
                return
        self.findings += check_clock(self._config, offset, self._synchronised)
        self.examined.append("clock")

    async def _airtime(self, link: Link | None) -> None:
        """Check the airtime with the plan, if any rates are known."""
        config, options = self._config, self._options
        profile = profile_named(options.channel.profile)
        capabilities = getattr(link, "capabilities", None)
        if isinstance(capabilities, LinkCapabilities):
            times = capabilities.bit_rate_bps / profile.bit_rate_bps
            if times > _OTHER_RATE or times < 1 / _OTHER_RATE:
                self.left_out.append(
                    f"airtime: the link has {capabilities.bit_rate_bps:g} bit/s, {profile.name} "
                    f"{profile.bit_rate_bps:.0f}; --profile names a modem like yours"
                )
                return
        if config.table.wire is not WireProfile.NATIVE:
            self.left_out.append("airtime: plans are for the native wire")
            return
        try:
            report = await asyncio.to_thread(
                plan, config.source, channel=options.channel, recordings=options.recordings,
                hours=_PLANNED_HOURS,
            )  # fmt: skip
        except ConfigError as error:
            if options.recordings:
                raise
            self.left_out.append(f"airtime: {error.args[0]}")
            return
        self.examined.append("airtime")
        if not report.fits:
            cures = "; ".join(change.what for change in report.changes)
            self.findings.append(
                Finding(
                    what=f"more data than fits: {'; '.join(report.misfits)}",
                    why=f"all of it would take {report.demand:.0%} of the time: samples are pushed "
                    "out or come too late, and commands wait behind them",
                    cure=cures or "zacoustic config plan shows what takes how much",
                )
            )
